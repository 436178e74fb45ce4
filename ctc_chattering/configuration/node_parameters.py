# Copyright 2026 The ctc_chattering maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Parameters of the executables besides those of controller, plant and reference themselves.

One class per executable; with the configuration class of the same title it makes up the parameters
of that node.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import Any, ClassVar

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.parameters import Config, Parameter, parameter, unit_text
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig


def _wait_for() -> Any:
    return parameter(
        'wait_for', 'str[]', ('',),
        'Nodes that must have subscribed before the first message (set by bringup).',
        shape='any', read_only=True)


@dataclasses.dataclass(frozen=True)
class RealTimeSettings(Config):
    """Parameters of the scheduling of a process, named as those of ros2_control's manager."""

    title: ClassVar[str] = 'real time'

    thread_priority: int = parameter(
        'thread_priority', 'int', 0,
        'Real time: SCHED_FIFO priority; 0 for none.',
        minimum=0, maximum=99, read_only=True)
    lock_memory: bool = parameter(
        'lock_memory', 'bool', False,
        'Real time: memory is never swapped out.',
        read_only=True)
    cpu_affinity: int = parameter(
        'cpu_affinity', 'int', -1, 'Processor to run on; -1 for any.',
        minimum=-1, maximum=1023, read_only=True)


@dataclasses.dataclass(frozen=True)
class PlantSettings(Config):
    """Parameters of the plant node besides the physics."""

    title: ClassVar[str] = 'plant'

    hold_at: float = parameter(
        'hold_at', 'float', 0.0,
        'Lockstep: simulated time stops before the first state at or after this time, until it '
        'is set again; 0 for never.', unit='s', minimum=0.0)
    command_timeout: float = parameter(
        'command_timeout', 'float', 0.02,
        'Real time: after this time without a command (at least three control periods), torque 0 '
        'and brakes until the next one. At most 1/Kv, or the motion may diverge.',
        unit='s', minimum=0.0, exclusive=True, maximum=3600.0)
    wait_for: tuple[str, ...] = _wait_for()


@dataclasses.dataclass(frozen=True)
class ControllerSettings(Config):
    """Parameters of the controller node besides the law."""

    title: ClassVar[str] = 'controller'

    state_timeout: float = parameter(
        'state_timeout', 'float', 0.02,
        'Real time: after this time without a state (at least three control periods), or such a '
        'gap of its stamps, the law restarts.', unit='s', minimum=0.0,
        exclusive=True, maximum=3600.0, read_only=True)
    predicted_periods: int = parameter(
        'predicted_periods', 'int', 5,
        'Real time: so many periods without a state are answered by the torque for the predicted '
        'one, none from state_timeout on; 0 for none.', minimum=0, maximum=100)
    reference_timeout: float = parameter(
        'reference_timeout', 'float', 0.1,
        'A late reference continues at its last velocity for this time, then stands.',
        unit='s', minimum=0.0, maximum=3600.0, read_only=True)
    restart_duration: float = parameter(
        'restart_duration', 'float', 2.0,
        "Time over which the desired motion returns from the robot's position to the reference "
        'after 0.1 s without a torque; 0 for none.', unit='s', minimum=0.0,
        maximum=3600.0)
    enabled: bool = parameter(
        'enabled', 'bool', True, 'Send torques from the start; see ~/enable.',
        read_only=True)
    state_decimation: int = parameter(
        'state_decimation', 'int', 10,
        'Topics under ~/ carry every Nth sample; plots of a bag recompute all.',
        minimum=1, maximum=1_000_000)
    wait_for: tuple[str, ...] = _wait_for()


@dataclasses.dataclass(frozen=True)
class ReferenceSettings(Config):
    """Parameters of the reference node besides the motion."""

    title: ClassVar[str] = 'reference'

    horizon: float = parameter(
        'horizon', 'float', 0.5, 'Time by which the motion is published ahead.', unit='s',
        minimum=0.01, maximum=60.0, read_only=True)
    wait_for: tuple[str, ...] = _wait_for()


@dataclasses.dataclass(frozen=True)
class RecorderSettings(Config):
    """Parameters of the recorder node."""

    title: ClassVar[str] = 'recorder'

    bag: str = parameter(
        'bag', 'str', 'bag', 'Directory to create for the bag.', read_only=True)


@dataclasses.dataclass(frozen=True)
class BringupSettings(Config):
    """Parameters of bringup."""

    title: ClassVar[str] = 'bringup'

    events: tuple[str, ...] = parameter(
        'events', 'str[]', ('',),
        'Parameters to set during the run, each "time node parameter value", time in s.',
        shape='any', read_only=True)


#: The configurations that make up the parameters of each executable.
NODES: dict[str, Sequence[type[Config]]] = {
    'plant': (PlantConfig, PlantSettings, RealTimeSettings),
    'controller': (ControllerConfig, ControllerSettings, RealTimeSettings),
    'reference': (ReferenceConfig, ReferenceSettings, RealTimeSettings),
    'recorder': (RecorderSettings,),
    'bringup': (BringupSettings,),
}


#: Parameters by which bringup, the live page and tests drive the nodes: no user sets them.
INTERNAL = ('wait_for', 'hold_at', 'compiled')

#: The nodes of the control loop.
LOOP = ('plant', 'controller', 'reference')


def parameters_of(node: str) -> dict[str, Parameter]:
    """Return all parameters of the executable `node` by name."""
    return {name: spec for config in NODES[node] for name, spec in config.parameters().items()}


#: Description of each node for its --help.
NODE_DESCRIPTIONS = {
    'plant': 'The simulated robot: receives torques, publishes joint states.',
    'controller': 'The controller: answers each joint state with torques.',
    'reference': 'The reference: publishes the desired motion in advance.',
    'recorder': 'The recorder: records every message of the graph in a bag.'}


def parameter_help(node: str) -> str:
    """Return the parameters of an executable, one a line."""
    return '\n'.join(f'  {spec.name} ({spec.kind}, {_shown(spec.default)}): {spec.meaning}'
                     for spec in parameters_of(node).values() if spec.name not in INTERNAL)


def parameter_table() -> str:
    """Return all parameters of all executables as Markdown, under the nodes that have them."""
    nodes: dict[str, list[str]] = {}
    for node in NODES:
        for spec in parameters_of(node).values():
            if spec.name not in INTERNAL:
                nodes.setdefault(_row(spec), []).append(node)
    sections: dict[str, list[str]] = {}
    for row, names in nodes.items():
        sections.setdefault(', '.join(names), []).append(row)
    return '\n\n'.join(
        '\n'.join((f'## {title}\n',
                   '| parameter | allowed | default | unit | while running | meaning |',
                   '|---|---|---|---|---|---|', *rows)) for title, rows in sections.items())


def _row(spec: Parameter) -> str:
    """Return the cells of a parameter in the tables."""
    allowed = spec.allowed.replace('|', '\\|')
    return (f'| `{spec.name}` | {allowed} | `{_shown(spec.default)}` | {unit_text(spec.unit)} | '
            f'{"" if spec.read_only else "yes"} | {spec.meaning} |')


def _shown(value: object) -> str:
    """Return a default for the table; one number stands for every joint."""
    if isinstance(value, tuple):
        return f'[{", ".join(map(_shown, value))}]'
    if isinstance(value, float):
        return f'{value:g}'.replace('inf', '.inf')
    return str(value).lower() if isinstance(value, bool) else str(value) or "''"

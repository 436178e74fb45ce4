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

"""Parameter files in the syntax of ROS 2, read and checked without ROS."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
import dataclasses
from pathlib import Path
from typing import Any

from ctc_chattering.configuration.events import parse_events
from ctc_chattering.configuration.node_parameters import LOOP, NODES, parameters_of
from ctc_chattering.configuration.robot_description import read_description
from ctc_chattering.configuration.trajectory_file import read_trajectory
from ctc_chattering.configuration.yaml_file import Dumper, read_yaml
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import CtcError, near, ParameterError, UsageError
from ctc_chattering.numerics.time_grid import period_ns
from ctc_chattering.parameters import C, Config
from ctc_chattering.simulation.closed_loop import Event
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.simulation.registry import check_start
from ctc_chattering.trajectory.joint_limits import DescribedLimits
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig
from ctc_chattering.trajectory.waypoints import Route
import yaml

Values = dict[str, Any]
#: Values by node and parameter that override those of a file; node ``/**`` for all nodes.
Overrides = Mapping[str, Mapping[str, Any]]
#: Section whose parameters apply to every node that has them.
EVERY_NODE = '/**'
#: Parameters of the plant that say where it starts, and of the reference that change no motion.
_STARTS, _TIMING = {'initial_position', 'initial_velocity'}, {'control_period'}
#: Parameters of every ROS node; without ROS they have no effect.
OF_ROS = ('use_sim_time', 'start_type_description_service')


@dataclasses.dataclass(frozen=True)
class Setup:
    """
    The checked contents of a parameter file.

    Attributes
    ----------
    plant, controller, reference
        Configurations of the core.
    events : tuple of Event
        Parameters that change during the run, in the order of time.
    values : mapping
        Every parameter's value, by executable and parameter.
    route : Route or None
        Contents of the reference's `trajectory_file`, in the order of its joints.
    descriptions : mapping
        Text of the robot's description by node, for those that need one and name a file.

    """

    plant: PlantConfig
    controller: ControllerConfig
    reference: ReferenceConfig
    events: tuple[Event, ...]
    values: Mapping[str, Values]
    route: Route | None = None
    descriptions: Mapping[str, str] = dataclasses.field(default_factory=dict)


def load(path: Path | None, overrides: Overrides | None = None) -> Setup:
    """
    Read a parameter file for the whole graph.

    Parameters
    ----------
    path : Path or None
        None for the defaults: the paper's first experiment.
    overrides : mapping, optional
        Values that override the file's.

    Raises
    ------
    CtcError
        If the file cannot be read, or has an unknown node or parameter, a value that is not
        allowed, or contradictory values; or if its file of waypoints is wrong.

    """
    sections = read(path) if path is not None else {}
    for name in sections:
        if name not in (*NODES, EVERY_NODE):
            raise CtcError(f'{path}: no node is called {name}; allowed: '
                           f'{", ".join((*NODES, EVERY_NODE))}{near(name, NODES)}')
    values = {node: node_values(sections, node, str(path))
              | node_values(overrides or {}, node, 'overrides') for node in NODES}
    values['plant'].setdefault('experiment', path.stem if path is not None else 'friction')
    configs: dict[str, list[Any]] = {
        node: [_build(kind, values[node], node) for kind in kinds]
        for node, kinds in NODES.items()}
    plant, controller, reference, bringup = (configs[node][0] for node in (*LOOP, 'bringup'))
    _check_agreement(plant, controller, reference)
    if values['plant'].get('use_sim_time') is True and plant.pacing == 'real_time':
        raise UsageError('use_sim_time: true contradicts real_time, the pacing of plant: it '
                         'gives the time itself, in lockstep on clock')
    events = parse_events(bringup.events, {'plant': plant, 'controller': controller})
    resolved = {node: {name: value for config in configs[node]
                       for name, value in config.as_mapping().items()} for node in NODES}
    route = read_trajectory(Path(reference.trajectory_file), reference.joint_names
                            ) if reference.trajectory_file else None
    descriptions = {node: read_description(config.description)
                    for node, config in zip(LOOP, (plant, controller, reference))
                    if config.described and config.description}
    setup = Setup(plant, controller, reference, events, resolved, route, descriptions)
    _check_motion(setup)
    return setup


def changed(setup: Setup, values: Overrides) -> Setup:
    """
    Return a setup with some parameters of its loop changed, checked as `load` checks them.

    Files are not read again, so that no parameter which names one may change; nor may the joints.

    Parameters
    ----------
    setup : Setup
        Anything.
    values : mapping
        New values by node, one of `LOOP`, and parameter.

    Raises
    ------
    CtcError
        If a value is not allowed, or contradicts another.

    """
    configs: dict[str, Any] = {
        node: _made(node, getattr(setup, node).changed, mine)
        for node, mine in values.items() if mine}
    resolved = {node: {**setup.values[node], **config.as_mapping()}
                for node, config in configs.items()}
    made = dataclasses.replace(setup, **configs, values={**setup.values, **resolved})
    _check_agreement(made.plant, made.controller, made.reference)
    if _STARTS & set(values.get('plant', ())) or set(values.get('reference', ())) - _TIMING:
        _check_motion(made)
    return made


def dump(values: Mapping[str, Values], path: Path) -> None:
    """
    Write a parameter file.

    Parameters
    ----------
    values : mapping
        Values by node and parameter.
    path : Path
        File to write.

    """
    tree = {node: {'ros__parameters': {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in mine.items()}} for node, mine in values.items()}
    path.write_text(yaml.dump(tree, Dumper=Dumper, default_flow_style=None), encoding='utf-8')


def read(path: Path) -> dict[str, Values]:
    """
    Return the sections of a parameter file: node name to flat parameter values.

    A node's namespace is left out; ``/**`` stays as it is.

    Raises
    ------
    CtcError
        If the file cannot be read or is no parameter file.

    """
    sections: dict[str, Values] = {}
    for name, values in full_sections(path):
        last = name.rsplit('/', 1)[1]
        sections.setdefault(EVERY_NODE if '*' in last else last, {}).update(values)
    return sections


def full_sections(path: Path) -> list[tuple[str, Values]]:
    """Return the sections of a parameter file in order: full name and flat values; see `read`."""
    tree = read_yaml(path)
    if not isinstance(tree, dict):
        raise CtcError(f'{path}: not a parameter file; it needs node names at the top')
    try:
        sections = list(_sections(tree, '', path))
    except RecursionError:
        raise CtcError(f'{path}: not a parameter file; it contains itself') from None
    _each_once(str(path), 'section', [name for name, _ in sections])
    return sections


def _each_once(where: str, kind: str, names: Iterable[str]) -> None:
    """Raise `CtcError` for a name that two spellings give, such as a.b and a: {b: …}."""
    for name, count in Counter(names).items():
        if count > 1:
            raise CtcError(f'{where}: {kind} {name} is given twice, in two spellings')


def _sections(tree: Mapping[Any, Any], prefix: str, path: Path) -> Iterator[tuple[str, Values]]:
    for key, below in tree.items():
        name = f'{prefix}/{key}'.replace('//', '/')
        if not isinstance(below, dict):
            raise CtcError(f'{path}: {name}: ros__parameters is missing')
        if 'ros__parameters' in below:
            values = below['ros__parameters']
            if not (values is None or isinstance(values, dict)):
                raise CtcError(f'{path}: {name}: ros__parameters holds no parameters')
            flat = list(_flat(values or {}, ''))
            _each_once(f'{path}: {name}', 'parameter', [key for key, _ in flat])
            yield name, dict(flat)
        else:
            yield from _sections(below, name, path)


def _flat(values: Mapping[Any, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', value


def node_values(sections: Overrides, node: str, source: str) -> Values:
    """
    Return the values that `node` takes from the sections of a file.

    Raises
    ------
    CtcError
        For a parameter that the node, or under ``/**`` any node, does not have.

    """
    known = parameters_of(node)
    everyone = {name for other in NODES for name in parameters_of(other)}
    values = {}
    for section, allowed in ((EVERY_NODE, everyone), (node, set(known))):
        for name, value in sections.get(section, {}).items():
            if name in known or name in OF_ROS:
                values[name] = value
            elif name not in allowed:
                raise CtcError(f'{source}: {section} has no parameter {name}; allowed: '
                               f'{", ".join(sorted(allowed))}{near(name, allowed)}')
    return values


def _build(kind: type[Config], values: Values, node: str) -> Config:
    known = kind.parameters()
    return _made(node, kind.from_mapping, {
        name: x for name, x in values.items() if name in known})


def _made(node: str, make: Callable[[Mapping[str, Any]], C], values: Mapping[str, Any]) -> C:
    """Return what `make` makes of values; an error names the node."""
    try:
        return make(values)
    except ParameterError as error:
        raise ParameterError(f'{node}: {error.name}', error.value, error.allowed) from None


def _check_agreement(plant: PlantConfig, controller: ControllerConfig,
                     reference: ReferenceConfig) -> None:
    """Raise `CtcError` if the nodes' values contradict each other."""
    names = ['joint_names', 'gravity']
    if plant.plant_backend == 'builtin':
        names += ['model', 'locked']
    for name in names:
        if getattr(controller, name) != getattr(plant, name):
            raise _contradiction(name, 'controller', controller, 'plant', plant)
    for node, config in (('controller', controller), ('reference', reference)):
        if period_ns(config.control_period) != period_ns(plant.control_period):
            raise _contradiction('control_period', node, config, 'plant', plant)
    if not set(controller.joint_names) <= set(reference.joint_names):
        raise _contradiction('joint_names', 'reference', reference, 'controller', controller)


def _contradiction(name: str, node: str, config: Config, other: str, theirs: Config) -> CtcError:
    def shown(x: Any) -> object:
        return list(x) if isinstance(x, tuple) else x
    return CtcError(f'{name}: {shown(getattr(config, name))} of {node} contradicts '
                    f'{shown(getattr(theirs, name))} of {other}; put what nodes share under /**')


def _check_motion(setup: Setup) -> None:
    """Raise `CtcError` if the motion, or its start, is beyond the limits of a URDF."""
    plant, reference = setup.plant, setup.reference
    check_start(plant, setup.descriptions.get('plant', ''))
    description = setup.descriptions.get('reference', '')
    if not description:
        return
    limits = DescribedLimits(description, reference.joint_names)
    start = dict(zip(plant.joint_names, zip(plant.initial_position, plant.initial_velocity)))
    try:
        make_motion(reference, setup.route, start, limits=limits)
    except CtcError as error:
        raise CtcError(f'reference: {error}') from None

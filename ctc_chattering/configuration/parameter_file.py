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
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ctc_chattering.configuration.events import parse_events
from ctc_chattering.configuration.loop_setup import (
    check_agreement,
    check_motion,
    made,
    Overrides,
    Setup,
    Values,
)
from ctc_chattering.configuration.node_parameters import LOOP, NODES, parameters_of
from ctc_chattering.configuration.package_share import read_description
from ctc_chattering.configuration.trajectory_file import read_trajectory
from ctc_chattering.configuration.yaml_file import Dumper, read_yaml
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.recommended_gains import model_torque
from ctc_chattering.dynamics.registry import kept_model_of
from ctc_chattering.errors import CtcError, near, UsageError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import Config
import yaml

#: Section whose parameters apply to every node that has them.
EVERY_NODE = '/**'
#: Parameters of every ROS node; without ROS they have no effect.
OF_ROS = ('use_sim_time', 'start_type_description_service')


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
    check_agreement(plant, controller, reference)
    if values['plant'].get('use_sim_time') is True and plant.pacing == 'real_time':
        raise UsageError('use_sim_time: true contradicts real_time, the pacing of plant: it '
                         'gives the time itself, in lockstep on clock')
    resolved = {node: {name: value for config in configs[node]
                       for name, value in config.as_mapping().items()} for node in NODES}
    route = read_trajectory(Path(reference.trajectory_file), reference.joint_names
                            ) if reference.trajectory_file else None
    descriptions = {node: read_description(config.description)
                    for node, config in zip(LOOP, (plant, controller, reference))
                    if config.described and config.description}

    events = parse_events(bringup.events, {'plant': plant, 'controller': controller},
                          lambda: known_model_torque(controller, descriptions))
    setup = Setup(plant, controller, reference, events, resolved, route, descriptions)
    check_motion(setup)
    return setup


def known_model_torque(config: ControllerConfig, descriptions: Mapping[str, str]) -> Array | None:
    """Return `model_torque` of the controller; None where it waits for its description."""
    text = descriptions.get('controller', '')
    return None if config.described and not text else model_torque(
        config, kept_model_of(config, text))


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
    return made(node, kind.from_mapping, {
        name: x for name, x in values.items() if name in known})

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
Parameter files of ROS 2, without ROS.

`read` returns the sections of a file. `load` gives every node its values, checks them, and returns
a `Setup`. `load_parameters` is `load` for users of the package: it takes names of the package's
files, and gives a law its gains (`with_gains`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from math import inf
from operator import attrgetter
from pathlib import Path
from typing import Any

from ctc_chattering.configuration import yaml_file
from ctc_chattering.configuration.loop_setup import check_motion, Overrides, Setup, Values
from ctc_chattering.configuration.node_parameters import LOOP, NODES
from ctc_chattering.configuration.package_share import find_config, read_description
from ctc_chattering.configuration.trajectory_file import read_trajectory
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.recommended_gains import (
    gain_owner,
    GainChoice,
    GAINS,
    model_torque,
    RECOMMENDED_LAW,
    unknown_torque,
)
from ctc_chattering.controller.trips import check_change
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError, ParameterError, prefixed, suggest, UsageError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.output_files import write_text
from ctc_chattering.simulation.closed_loop import Event

#: Section whose parameters apply to every node that has them.
EVERY_NODE = '/**'
#: Parameters of every ROS node. Without ROS they have no effect.
OF_ROS = ('use_sim_time', 'start_type_description_service')
#: Choice of the gains of the file for a law.
FROM_FILE = 'file'
#: Choice of the recommended gains for a law.
RECOMMENDED = 'recommended'
#: Duration of the smooth start that goes with recommended gains [s].
_START_DURATION = 2.0


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
        allowed, contradictory values, or a wrong file of waypoints.

    """
    sections = read(path) if path else {}
    allowed = (*NODES, EVERY_NODE)
    for name in (*sections, *(overrides or {})):
        if name not in allowed:
            source = path if name in sections else 'overrides'
            raise CtcError(f'{source}: no node is called {name}; allowed: {", ".join(allowed)}'
                           + suggest(name, NODES))
    values = {node: node_values(sections, node, str(path))
              | node_values(overrides or {}, node, 'overrides') for node in NODES}
    values['plant'].setdefault('experiment', path.stem if path else 'friction')
    loop: dict[str, Any] = {}
    node_only: dict[str, Values] = {}
    for node, config in NODES.items():
        with prefixed(f'{node}: '):
            checked = config.from_mapping({
                name: value for name, value in values[node].items() if name not in OF_ROS})
        resolved = checked.as_mapping()
        if node in LOOP:
            names = LOOP[node].parameters()
            loop[node] = LOOP[node].from_mapping({name: resolved.pop(name) for name in names})
        node_only[node] = resolved
    plant, controller, reference = loop.values()
    if values['plant'].get('use_sim_time') is True and plant.pacing == 'real_time':
        raise UsageError('use_sim_time: true contradicts pacing real_time of the plant; change '
                         'one of them')
    file = reference.trajectory_file
    route = read_trajectory(Path(file), reference.joint_names) if file else None
    descriptions = {node: read_description(config.description) for node, config in loop.items()
                    if config.described and config.description}
    events = parse_events(node_only['bringup']['events'],
                          {'plant': plant, 'controller': controller},
                          partial(known_model_torque, controller, descriptions))
    setup = Setup(plant, controller, reference, events, route, descriptions, node_only)
    check_motion(setup)
    return setup


def known_model_torque(config: ControllerConfig, descriptions: Mapping[str, str]) -> Array | None:
    """Return `model_torque` of a controller that has its description."""
    text = descriptions.get('controller', '')
    return None if config.described and not text else model_torque(
        config, model_of(config, text))


def dump(values: Mapping[str, Values], path: Path) -> None:
    """
    Write a parameter file.

    Parameters
    ----------
    values : mapping
        Values by node and parameter.
    path : Path
        File to write.

    Raises
    ------
    CtcError
        If it cannot be written.

    """
    write_text(path, to_text(values))


def to_text(values: Mapping[str, Values]) -> str:
    """Return the text of a parameter file."""
    sections = {}
    for node, parameters in values.items():
        sections[node] = {'ros__parameters': {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in parameters.items()}}
    return yaml_file.yaml_text(sections)


def read(path: Path) -> dict[str, Values]:
    """
    Return the parameters of a file by node.

    A node's namespace is left out. ``/**`` stays as it is.

    Raises
    ------
    CtcError
        If the file cannot be read or is no parameter file.

    """
    sections: dict[str, Values] = {}
    for name, values in full_sections(path).items():
        node = name.rsplit('/', 1)[1]
        sections.setdefault(EVERY_NODE if '*' in node else node, {}).update(values)
    return sections


def full_sections(path: Path) -> dict[str, Values]:
    """Return the parameters by full name of a node."""
    tree = yaml_file.read_yaml(path, yaml_file.FileKind.PARAMETERS)
    if not isinstance(tree, dict):
        raise CtcError(f'{path}: not a parameter file; it needs node names at the top')
    sections: dict[str, Values] = {}
    for key, section in tree.items():
        name = f'/{key}'.replace('//', '/')
        values = section.get('ros__parameters', '') if isinstance(section, dict) else ''
        if not (values is None or isinstance(values, dict)):
            raise CtcError(f'{path}: {name}: ros__parameters is missing, or holds no parameters')
        pairs = list(_flatten(values or {}))
        parameters = dict(pairs)
        if name in sections or len(parameters) < len(pairs):
            raise CtcError(f'{path}: section {name}, or a parameter in it, appears twice')
        sections[name] = parameters
    return sections


def _flatten(values: Mapping[Any, Any], prefix: str = '') -> Iterator[tuple[str, Any]]:
    """Yield names, dotted if nested, and values."""
    for key, value in values.items():
        if isinstance(value, dict):
            yield from _flatten(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', value


def node_values(sections: Overrides, node: str, source: str) -> Values:
    """
    Return a node's values from sections.

    Raises
    ------
    CtcError
        For a parameter that the node, or under ``/**`` any node, does not have.

    """
    names = set(NODES[node].parameters())
    of_any_node = {name for config in NODES.values() for name in config.parameters()}
    values = {}
    for section, allowed in ((EVERY_NODE, of_any_node), (node, names)):
        for name, value in sections.get(section, {}).items():
            if name in names or name in OF_ROS:
                values[name] = value
            elif name not in allowed:
                raise CtcError(f'{source}: {section} has no parameter {name}; allowed: '
                               f'{", ".join(sorted(allowed))}{suggest(name, allowed)}')
    return values


def parse_events(lines: Sequence[str], configs: Mapping[str, Any],
                 torque: Callable[[], Array | None] = unknown_torque) -> tuple[Event, ...]:
    """
    Return the events of lines.

    Each line has "time node parameter value". Where no line has gains, a law comes with those that
    `GainChoice` decides.

    Parameters
    ----------
    lines : sequence of str
        The value is YAML. Empty lines are ignored.
    configs : mapping
        Configuration of each node that can have events, at the start of the run.
    torque : callable, optional
        Returns `model_torque` of the controller. None while it is not known.

    Raises
    ------
    CtcError
        For a line of another form, a parameter that cannot change while the node runs,
        or a value that is not allowed.

    """
    requests = [_parse_event(line, configs) for line in filter(None, lines)]
    requests.sort(key=attrgetter('time'))
    has_gains = any(name in GAINS for request in requests for name in request.values)
    current = dict(configs)
    choice = GainChoice(torque)
    events = []
    for request in requests:
        node = request.node
        values = request.values
        config = current[node]
        if 'law' in values:
            gains = choice.of_law(config.changed(values).law, config)
            if has_gains:
                gains = {name: config.as_mapping()[name] for name in gains}
            values = {**values, **gains}
        current[node] = config.changed(values)
        if node == 'controller':
            check_change(config, current[node])
        changed = current[node].as_mapping()
        events.append(Event(request.time, node, {name: changed[name] for name in values}))
    return tuple(events)


def _parse_event(line: str, configs: Mapping[str, Any]) -> Event:
    """Return the event of a line, with a value not yet checked."""
    try:
        time, node, name, text = line.split(None, 3)
        if not (0.0 <= float(time) < inf and node in configs):
            raise ValueError
        value = yaml_file.parse_value(text)
    except (ValueError, CtcError):
        raise ParameterError('events', line, '"time node parameter value", a time >= 0, '
                             f'node {" | ".join(configs)}, a value in YAML') from None
    spec = configs[node].parameters().get(name)
    if spec is not None and spec.read_only:
        raise ParameterError('events', name, 'a parameter that can change during the run')
    return Event(float(time), node, {name: value})


def with_gains(path: Path | None, overrides: Overrides, gains: str | None = None
               ) -> tuple[dict[str, dict[str, Any]], str]:
    """
    Return overrides with gains for their law.

    Gains are added where a law is chosen without any.

    Parameters
    ----------
    path : Path or None
        As `load` takes it.
    overrides : mapping
        Values by node and parameter.
    gains : {'file', 'recommended'}, optional
        Gains that are taken. By default `GainChoice` decides for a law that file or overrides
        choose without gains.

    Returns
    -------
    overrides : dict
        With gains, and a smooth start where they are recommended ones.
    line : str
        Text for the user about gains that were added, if any.

    Raises
    ------
    UsageError
        If gains of a law are asked for that has no recommended ones.
    CtcError
        As `load` does.

    """
    result = {node: dict(values) for node, values in overrides.items()}
    stated = node_values(result, 'controller', 'overrides')
    in_file = node_values(read(path) if path else {}, 'controller', str(path))
    file_gains = _separate_gains(in_file)
    law_gains = _separate_gains({**in_file, **stated})
    file_suits = law_gains == file_gains
    if law_gains and in_file.keys().isdisjoint(GAINS):
        file_suits = False
    has_gains = file_suits or not stated.keys().isdisjoint(GAINS)
    if gains == FROM_FILE or (gains is None and has_gains):
        return result, ''
    setup = load(path, result)
    law = setup.controller.law
    if gains is not None and not law_gains:
        raise UsageError(f'--gains {gains}: only --law {RECOMMENDED_LAW} has recommended gains, '
                         f'not {law}')
    choice = GainChoice(partial(known_model_torque, setup.controller, setup.descriptions))
    chosen = choice.suitable(law, setup.controller)
    result['controller'] = chosen | stated
    if law_gains:
        result.setdefault('reference', {}).setdefault(
            'start_duration', max(setup.reference.start_duration, _START_DURATION))
    added = ', '.join(f'{name} {x}' for name, x in chosen.items() if name not in stated)
    start = ' and a smooth start' if law_gains else ''
    return result, (f'law {law} takes recommended gains{start}: {added}; --gains file keeps '
                    'the gains of the file')


def _separate_gains(values: Mapping[str, object]) -> str:
    """Return `gain_owner` of the law in parameters of the controller."""
    spec = ControllerConfig.parameters()['law']
    with prefixed('controller: '):
        return gain_owner(spec.checked(values.get('law', spec.default)))


def load_parameters(path: str | Path = 'friction', overrides: Overrides | None = None,
                    gains: str | None = None) -> Setup:
    """
    Return the checked contents of a parameter file.

    A law that the overrides choose without gains takes recommended ones where those of the file
    do not suit it, as under ``ctc simulate --law``: `observer_feedback` has gains of its own.

    Parameters
    ----------
    path : str or Path
        A parameter file, or the name of one of the package: ``friction``, ``disturbance``,
        ``switch``, ``switching`` (the paper's arm), ``panda``, ``ur5``.
    overrides : mapping, optional
        Values by node and parameter that override the file's. Nodes are ``plant``,
        ``controller``, ``reference``, …, or ``/**`` for all that have the parameter. The
        parameters are in docs/parameters.md.
    gains : {'file', 'recommended'}, optional
        Take the gains of the file in any case, or the recommended ones of `observer_feedback`.

    Returns
    -------
    Setup
        For `simulate`.

    Raises
    ------
    CtcError
        If the file cannot be read, or something in it is not allowed.

    Examples
    --------
    >>> from ctc_chattering import load_parameters
    >>> setup = load_parameters('friction', {
    ...     'plant': {'duration': 6.0}, 'controller': {'law': 'integral', 'ki': 50.0}})
    >>> setup.controller.law, setup.controller.ki
    ('integral', (50.0, 50.0))

    """
    file = find_config(path) if isinstance(path, str) else path
    return load(file, with_gains(file, overrides or {}, gains)[0])

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
Parameter files in the syntax of ROS 2, read and checked without ROS.

`read` returns what a file says, section by section; `load` gives every node its values, checks
them, and returns a `Setup`. `load_parameters` is `load` for users of the package: it takes names
of the package's files, and gives a law its gains (`with_gains`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

from ctc_chattering.configuration.loop_setup import (
    check_agreement,
    check_motion,
    check_overrides,
    made,
    Overrides,
    Setup,
    Values,
)
from ctc_chattering.configuration.node_parameters import LOOP, NODES
from ctc_chattering.configuration.package_share import find_config, read_description
from ctc_chattering.configuration.yaml_file import (
    Dumper,
    parse_value,
    read_trajectory,
    read_yaml,
)
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.recommended_gains import (
    GainChoice,
    GAINS,
    LAW,
    model_torque,
    suitable_gains,
)
from ctc_chattering.controller.trips import change_steps
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError, near, ParameterError, UsageError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.closed_loop import Event
import yaml

#: Section whose parameters apply to every node that has them.
EVERY_NODE = '/**'
#: Parameters of every ROS node; without ROS they have no effect.
OF_ROS = ('use_sim_time', 'start_type_description_service')
#: Whose gains a law takes: those of the file, or the recommended ones.
FROM_FILE, RECOMMENDED = 'file', 'recommended'
#: Duration of the smooth start that goes with recommended gains [s].
_START = 2.0


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
    resolved = {node: made(node, kind.from_mapping, {
        name: x for name, x in values[node].items() if name not in OF_ROS}).as_mapping()
        for node, kind in NODES.items()}
    loop: dict[str, Any] = {node: kind.from_mapping({name: resolved[node][name] for name in (
        kind.parameters())}) for node, kind in LOOP.items()}
    plant, controller, reference = loop.values()
    check_agreement(plant, controller, reference)
    if values['plant'].get('use_sim_time') is True and plant.pacing == 'real_time':
        raise UsageError('use_sim_time: true contradicts real_time, the pacing of plant: it '
                         'gives the time itself, in lockstep on clock')
    route = read_trajectory(Path(reference.trajectory_file), reference.joint_names
                            ) if reference.trajectory_file else None
    descriptions = {node: read_description(config.description) for node, config in loop.items()
                    if config.described and config.description}
    events = parse_events(resolved['bringup']['events'],
                          {'plant': plant, 'controller': controller},
                          lambda: known_model_torque(controller, descriptions))
    setup = Setup(plant, controller, reference, events, resolved, route, descriptions)
    check_motion(setup)
    return setup


def known_model_torque(config: ControllerConfig, descriptions: Mapping[str, str]) -> Array | None:
    """Return `model_torque` of the controller; None where it waits for its description."""
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
    for name, values in full_sections(path).items():
        last = name.rsplit('/', 1)[1]
        sections.setdefault(EVERY_NODE if '*' in last else last, {}).update(values)
    return sections


def full_sections(path: Path) -> dict[str, Values]:
    """Return the sections of a parameter file: full name and flat values; see `read`."""
    tree = read_yaml(path)
    if not isinstance(tree, dict):
        raise CtcError(f'{path}: not a parameter file; it needs node names at the top')
    return _each_once(f'{path}: section', _sections(tree, '', path))


def _each_once(what: str, pairs: Iterable[tuple[str, Any]]) -> Values:
    """Return pairs by name; raise for a name that two spellings give, as a.b and a: {b: …}."""
    found: Values = {}
    for name, value in pairs:
        if name in found:
            raise CtcError(f'{what} {name} is given twice, in two spellings')
        found[name] = value
    return found


def _sections(tree: Mapping[Any, Any], prefix: str, path: Path) -> Iterator[tuple[str, Values]]:
    for key, below in tree.items():
        name = f'{prefix}/{key}'.replace('//', '/')
        if not isinstance(below, dict):
            raise CtcError(f'{path}: {name}: ros__parameters is missing')
        if 'ros__parameters' in below:
            values = below['ros__parameters']
            if not (values is None or isinstance(values, dict)):
                raise CtcError(f'{path}: {name}: ros__parameters holds no parameters')
            yield name, _each_once(f'{path}: {name}: parameter', _flat(values or {}, ''))
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
    known = NODES[node].parameters()
    everyone = {name for other in NODES for name in NODES[other].parameters()}
    values = {}
    for section, allowed in ((EVERY_NODE, everyone), (node, set(known))):
        for name, value in sections.get(section, {}).items():
            if name in known or name in OF_ROS:
                values[name] = value
            elif name not in allowed:
                raise CtcError(f'{source}: {section} has no parameter {name}; allowed: '
                               f'{", ".join(sorted(allowed))}{near(name, allowed)}')
    return values


def parse_events(lines: Sequence[str], configs: Mapping[str, Any],
                 model_torque: Callable[[], Array | None] = lambda: None) -> tuple[Event, ...]:
    """
    Return the events that `lines` describe, each "time node parameter value".

    Where no line has gains, a law comes with those that `GainChoice` decides.

    Parameters
    ----------
    lines : sequence of str
        The value is YAML; empty lines are ignored.
    configs : mapping
        Configuration of each node that can have events, at the start of the run.
    model_torque : callable, optional
        Returns `model_torque` of the controller; None while it is not known.

    Raises
    ------
    CtcError
        For a line of another form, a parameter that cannot change while the node runs,
        or a value that is not allowed.

    """
    events = []
    for line in filter(None, lines):
        words = line.split(None, 3)
        try:
            time, (node, name, value) = float(words[0]), words[1:]
            spec = configs[node].parameters().get(name)
        except (ValueError, IndexError, KeyError):
            raise ParameterError(
                'events', line, '"time node parameter value", node ' + ' | '.join(configs)
            ) from None
        if not 0.0 <= time < float('inf'):
            raise ParameterError('events', line, 'a time >= 0')
        if spec is not None and spec.read_only:
            raise ParameterError('events', name, 'a parameter that can change during the run')
        try:
            events.append((time, node, name, parse_value(value)))
        except CtcError:
            raise ParameterError('events', line, 'a value in YAML, not null') from None
    events.sort(key=itemgetter(0))
    current, choice = dict(configs), GainChoice()
    without_gains = not any(name in GAINS for _, _, name, _ in events)
    result = []
    for time, node, name, value in events:
        before, values = current[node], {name: value}
        if name == 'law':
            law = before.changed(values).law
            if law == LAW != before.law:
                choice.torque = model_torque()
            taken = choice.of_law(law, before)
            values |= {x: taken[x] if without_gains else before.as_mapping()[x] for x in taken}
        current[node] = before.changed(values)
        wanted = {x: current[node].as_mapping()[x] for x in values}
        if node == 'controller':  # A file that names a large change confirms it.
            old = before.as_mapping()
            result += [Event(time, node, {x: step}) for x, value in wanted.items()
                       for step in change_steps(before.parameters()[x], old[x], value,
                                                len(old['joint_names']))[:-1]]
        result.append(Event(time, node, wanted))
    return tuple(result)


def with_gains(path: Path | None, overrides: Overrides, gains: str | None = None
               ) -> tuple[dict[str, dict[str, Any]], str]:
    """
    Return overrides with the gains that their law takes where they have none.

    Parameters
    ----------
    path : Path or None
        As `load` takes it.
    overrides : mapping
        Values by node and parameter.
    gains : {'file', 'recommended'}, optional
        Whose gains are taken; where left out, what `GainChoice` decides for a law that file or
        overrides choose without gains.

    Returns
    -------
    overrides : dict
        With gains, and a smooth start where they are recommended ones.
    line : str
        What was added, for the user; empty for nothing.

    Raises
    ------
    UsageError
        If gains of a law are asked for that has no recommended ones.
    CtcError
        As `load` does.

    """
    found = {node: dict(values) for node, values in overrides.items()}
    given = node_values(found, 'controller', 'overrides')
    in_file = node_values(read(path) if path else {}, 'controller', str(path))
    of_file = in_file.get('law')
    law = given.get('law', of_file)
    chosen = given.keys().isdisjoint(GAINS) and (
        in_file.keys().isdisjoint(GAINS) if law == of_file == LAW
        else (law == LAW) != (of_file == LAW))
    if gains == FROM_FILE or (gains is None and not chosen):
        return found, ''
    if gains is not None and law != LAW:
        raise UsageError(f'--gains {gains}: {law} has no recommended '
                         f'gains; allowed with --law {LAW}')
    setup = load(path, found)
    torque = known_model_torque(setup.controller, setup.descriptions) if law == LAW else None
    taken = {name: x for name, x in suitable_gains(str(law), setup.controller, torque).items()
             if name not in given}
    found.setdefault('controller', {}).update(taken)
    text = ', '.join(f'{name} {_shown(x)}' for name, x in taken.items())
    if law == LAW:
        start = found.setdefault('reference', {}).setdefault(
            'start_duration', max(setup.reference.start_duration, _START))
        text += f', and start_duration {start} s for a smooth start'
    return found, (f'law {law} takes recommended gains: {text}; --gains file takes those of the '
                   'file')


def _shown(value: float | tuple[float, ...]) -> str:
    """Return a gain, once if it is the same for all joints."""
    values = value if isinstance(value, tuple) else (value,)
    return f'{values[0]:g}' if len(set(values)) == 1 else '/'.join(f'{x:g}' for x in values)


def load_parameters(path: str | Path = 'friction', overrides: Overrides | None = None,
                    gains: str | None = None) -> Setup:
    """
    Return the configurations of plant, controller and reference, and the events, of a file.

    A law that the overrides choose without gains takes recommended ones where those of the file
    do not suit it, as under ``ctc simulate --law``: `observer_feedback` has gains of its own.

    Parameters
    ----------
    path : str or Path
        A parameter file, or the name of one of the package: ``friction``, ``disturbance``,
        ``switch``, ``switching`` (the paper's arm), ``panda``, ``ur5``.
    overrides : mapping, optional
        Values by node and parameter that override the file's. Nodes are ``plant``,
        ``controller``, ``reference``, …, or ``/**`` for all that have the parameter; the
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
    check_overrides('overrides', overrides or {}, (*NODES, EVERY_NODE))
    if gains not in (None, FROM_FILE, RECOMMENDED):
        raise ParameterError('gains', gains, f'{FROM_FILE} | {RECOMMENDED}')
    file = find_config(path) if isinstance(path, str) else path
    return load(file, with_gains(file, overrides or {}, gains)[0])

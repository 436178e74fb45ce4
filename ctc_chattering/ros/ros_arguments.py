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
The arguments after ``--ros-args``: parameters are ours, all others are parsed by rcl.

rcl refuses a list of integers and other numbers, silently ignores arguments for unknown nodes or
parameters, and between a node's own section and ``/**`` the first one in a file has precedence for
all that follow. Here the last one wins, a node's own section has precedence over ``/**`` of the
same file, and unknown names are refused. What rcl parses is compared with the names that exist.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from itertools import pairwise
from pathlib import Path
import re
from typing import Any, NamedTuple

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Values
from ctc_chattering.configuration.node_parameters import NODES, parameters_of
from ctc_chattering.configuration.yaml_file import parse_value
from ctc_chattering.errors import CtcError, near, UsageError
from ctc_chattering.ros.topics import TOPICS

_ASSIGN, _REMAP = ('-p', '--param'), ('-r', '--remap')
#: Last parts of the names that a remap may name, beside those of `TOPICS`.
_NAMES = {'enable', 'reset', 'rosout', 'parameter_events', 'set_parameters', 'get_parameters',
          'set_parameters_atomically', 'list_parameters', 'describe_parameters',
          'get_parameter_types', 'get_type_description'}


class _Assignment(NamedTuple):
    """The argument ``-p node:name:=value``; `node` is empty for every node."""

    node: str
    name: str
    value: Any


@dataclasses.dataclass(frozen=True)
class RosArguments:
    """
    The arguments after ``--ros-args``.

    Attributes
    ----------
    node : str or None
        Name that ``__node`` gives.
    namespace : str
        Namespace that ``__ns`` gives.
    sources : tuple of Path or _Assignment
        Parameter files and single parameters, in order.
    rest : tuple of str
        Arguments for ROS itself: remaps, logging, security.

    """

    node: str | None = None
    namespace: str = '/'
    sources: tuple[Path | _Assignment, ...] = ()
    rest: tuple[str, ...] = ()

    @property
    def assigned(self) -> set[str]:
        """Return the parameters that ``-p`` gives."""
        return {source.name for source in self.sources if isinstance(source, _Assignment)}

    def values(self, executables: Sequence[str]) -> dict[str, Values]:
        """
        Return the parameters of nodes by these arguments, the last value of each, by executable.

        Raises
        ------
        UsageError
            For a parameter or a file that concerns none of the nodes.
        CtcError
            For a file that is none.

        """
        names = {executable: self.node or executable for executable in executables}
        found: dict[str, Values] = {executable: {} for executable in executables}
        for source in self.sources:
            given = (self._in_file(source, names) if isinstance(source, Path)
                     else _assigned(source, names))
            for executable, values in given.items():
                found[executable] |= values
        return found

    def checked(self, executable: str) -> Values:
        """
        Return the parameters of a node of its own; raise as `values` does, and `ParameterError`.

        What comes from these arguments alone is checked before anything starts.
        """
        values = self.values([executable])[executable]
        for config in NODES[executable]:
            config.from_mapping({
                name: value for name, value in values.items() if name in config.parameters()})
        return values

    def _in_file(self, file: Path, names: Mapping[str, str]) -> dict[str, Values]:
        """Return what a file has for the nodes called `names`, by executable."""
        if not file.exists():
            raise UsageError(f'--params-file {file}: there is no such file')
        paths = {x: f'{self.namespace.rstrip("/")}/{node}' for x, node in names.items()}
        sections = {x: _sections_for(path, x, file) for x, path in paths.items()}
        if not any(sections.values()):
            raise UsageError(
                f'--params-file {file}: no section is for {" or ".join(paths.values())}; there is '
                + ', '.join(parameter_file.full_sections(file)))
        return {x: parameter_file.node_values(mine, x, str(file)) for x, mine in sections.items()}


def _sections_for(path: str, executable: str, file: Path) -> dict[str, Values]:
    """
    Return what a file has for the node at `path`: under its executable's name, and ``/**``.

    A section without a namespace is for that node in any namespace.
    """
    found: dict[str, Values] = {}
    for name, values in parameter_file.full_sections(file).items():
        pattern = re.escape(name).replace(r'/\*\*', r'(/\w+)*').replace(r'\*', r'\w+')
        if re.fullmatch(pattern, path) or name == f'/{path.rsplit("/", 1)[1]}':
            section = parameter_file.EVERY_NODE if '*' in name.rsplit('/', 1)[1] else executable
            found.setdefault(section, {}).update(values)
    return found


def _assigned(given: _Assignment, names: Mapping[str, str]) -> dict[str, Values]:
    """Return what an assignment has for the nodes called `names`, by executable."""
    asked = [x for x, node in names.items() if given.node in ('', node)]
    if not asked:
        raise UsageError(f'-p {given.node}:{given.name}: no node is called {given.node} here; '
                         + ' | '.join(names.values()))
    found = {x: {given.name: given.value} for x in asked
             if given.name in (*parameters_of(x), *parameter_file.OF_ROS)}
    if not found:
        raise UsageError(f'-p {given.name}: {_hint(given.name, asked)}')
    return found


def _hint(name: str, executables: Sequence[str]) -> str:
    """Return what to say of a parameter that none of the executables has."""
    if name.startswith('qos_overrides.'):
        return 'the QoS of topics is fixed'
    known = {x for y in executables for x in parameters_of(y)}
    return (f'{" | ".join(executables)}: no parameter of this name'
            + (near(name, known) or '; ctc parameters lists them'))


def parse(arguments: Sequence[str]) -> tuple[list[str], RosArguments]:
    """
    Split a command line.

    Parameters
    ----------
    arguments : sequence of str
        Without the program's name.

    Returns
    -------
    own : list of str
        The program's own arguments.
    ros : RosArguments
        Those between ``--ros-args`` and ``--`` or the end.

    Raises
    ------
    UsageError
        For an argument that ROS does not have.

    """
    own: list[str] = []
    rest: list[str] = []
    sources: list[Path | _Assignment] = []
    words, into = iter(arguments), own
    for word in words:
        if word == '--ros-args':
            into = rest
        elif into is own or word not in (*_ASSIGN, '--params-file', '--'):
            into.append(word)
        elif word == '--':
            into = own
        elif (value := next(words, '--')).startswith('--'):
            raise UsageError(f'{word} needs a value')
        else:
            sources.append(_assignment(word, value) if word in _ASSIGN else Path(value))
    names = dict(reversed([  # The first one wins in ROS.
        _remap(*pair) for pair in pairwise(rest) if pair[0] in _REMAP]))
    if rest:
        _check(rest)
    return own, RosArguments(names.get('node'), names.get('ns', '/'), tuple(sources), tuple(rest))


def _check(arguments: Sequence[str]) -> None:
    """Have rcl parse arguments for ROS; raise `UsageError` for what it refuses."""
    from rclpy.impl.implementation_singleton import rclpy_implementation as rcl
    try:
        rcl.rclpy_remove_ros_args(['--ros-args', *arguments])
    except rcl.UnknownROSArgsError as error:
        words = ' '.join(re.findall("'(.*?)'", str(error)))
        raise UsageError(f'{words} is not a ROS argument (it follows --ros-args)') from None
    except rcl.RCLInvalidROSArgsError as error:
        raise UsageError(str(error).partition(', at /')[0]) from None


def _assignment(flag: str, rule: str) -> _Assignment:
    """Return the assignment of ``-p``."""
    match = re.fullmatch(r'(?:(\w+):)?([^:=\s]+):=(.*)', rule, re.DOTALL)
    if match is None:
        raise UsageError(f'{flag} {rule}: this is not NAME:=VALUE, nor NODE:NAME:=VALUE')
    node, name, text = match.groups()
    try:
        return _Assignment(node or '', name, parse_value(text))
    except CtcError as error:
        raise UsageError(f'{flag} {rule}: {error}') from None


def _remap(flag: str, rule: str) -> tuple[str, str]:
    """Return the name that ``-r`` changes, and the new one."""
    left, separator, right = rule.partition(':=')
    name = re.sub(r'^\w+:', '', left).removeprefix('rostopic://').removeprefix('rosservice://')
    if not separator or not left or not right:
        raise UsageError(f'{flag} {rule}: this is not FROM:=TO')
    last = name.rsplit('/', 1)[-1]
    if name in ('__node', '__name'):
        return 'node', right
    if name == '__ns':
        return 'ns', right if right.startswith('/') else f'/{right}'
    if last not in _NAMES | {topic.rsplit('/', 1)[-1] for topic in TOPICS}:
        raise UsageError(f'{flag} {rule}: no topic or service is called {name}; topics: '
                         + ', '.join(TOPICS))
    return left, right


def bringup_values(ros: RosArguments) -> dict[str, Values]:
    """
    Return what arguments for all nodes of the graph say, by executable.

    Raises
    ------
    CtcError
        For what is wrong with a parameter.
    UsageError
        For what would rename nodes, or concerns none of them.

    """
    if ros.node is not None or any(re.match(r'\w+:__', word) for word in ros.rest):
        raise UsageError('-r __node:=… and a namespace for one node only are not possible here: '
                         'the nodes would not find each other; -r __ns:=… is for all')
    return ros.values(list(NODES))

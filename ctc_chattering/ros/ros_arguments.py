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
Arguments after ``--ros-args`` of nodes and of bringup.

`cli/node.py` and `cli/bringup.py` read parameters here, by the same rules as `ctc simulate`. All
else is left to rcl. rcl silently ignores ``-p`` when a file has a section for the node, and
ignores unknown names. It refuses a list mixing integers and floats. Here the last value wins, a
node's own section has precedence over ``/**`` of the same file, and an undeclared name is refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
import os
from pathlib import Path
import re
from typing import NamedTuple

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Values
from ctc_chattering.configuration.node_parameters import NODES
from ctc_chattering.configuration.yaml_file import parse_value
from ctc_chattering.errors import CtcError, suggest, UsageError

_FILE = '--params-file'
_ASSIGNMENT = re.compile(r'(?:(?P<node>\w+):)?(?P<name>[^:=\s]+):=(?P<value>.*)', re.DOTALL)


class RosArguments(NamedTuple):
    """
    Arguments after ``--ros-args``.

    Attributes
    ----------
    parameters : tuple of (str, str)
        Flags with their values, in order: files, and assignments of single parameters.
    for_ros : tuple of str
        Arguments for ROS itself: remaps, logging, security.

    """

    parameters: tuple[tuple[str, str], ...] = ()
    for_ros: tuple[str, ...] = ()

    @property
    def assigned(self) -> set[str]:
        """Names that ``-p`` sets, whose errors are usage errors."""
        texts = [text for flag, text in self.parameters if flag != _FILE]
        matches = map(_ASSIGNMENT.fullmatch, texts)
        return {match['name'] for match in matches if match}

    def values(self, executables: Sequence[str]) -> dict[str, Values]:
        """
        Return the parameters by executable, the last value of each.

        Raises
        ------
        UsageError
            For a parameter or a file that applies to none of the nodes.
        CtcError
            For a file that is no parameter file.

        """
        remaps = self._remaps()
        namespace = remaps.get('__ns', '').strip('/')
        nodes = {executable: remaps.get('__node', remaps.get('__name', executable))
                 for executable in executables}
        merged: dict[str, Values] = {executable: {} for executable in executables}
        for flag, text in self.parameters:
            if flag == _FILE:
                values = _read_file(Path(text), f'/{namespace}', nodes)
            else:
                values = _read_assignment(f'{flag} {text}', text, nodes)
            for executable in values:
                merged[executable] |= values[executable]
        return merged

    def _remaps(self) -> dict[str, str]:
        """Return the remaps by name, without the prefix of a node."""
        remaps: dict[str, str] = {}
        for flag, remap in pairwise(self.for_ros):
            if flag in ('-r', '--remap'):
                origin, _, target = remap.partition(':=')
                remaps.setdefault(origin.rpartition(':')[2], target)  # The first one wins in ROS.
        return remaps


def _read_file(file: Path, namespace: str, nodes: Mapping[str, str]) -> dict[str, Values]:
    """
    Return the values that nodes take from a file, by executable.

    A section without a namespace is for that node in any namespace. `nodes` has the names of the
    nodes by executable.
    """
    if not os.path.exists(file):  # noqa: PTH110 - A name may be too long for a system.
        raise UsageError(f'{_FILE} {file}: there is no such file')
    sections = parameter_file.full_sections(file)
    values: dict[str, Values] = {}
    for executable, node in nodes.items():
        full_name = f'{namespace.rstrip("/")}/{node}'
        of_node: dict[str, Values] = {}
        for section, content in sections.items():
            if section == f'/{node}' or _section_matches(section, full_name):
                is_wild = '*' in section.rpartition('/')[2]
                key = parameter_file.EVERY_NODE if is_wild else executable
                of_node.setdefault(key, {}).update(content)
        if of_node:
            values[executable] = parameter_file.node_values(of_node, executable, str(file))
    if not values:
        raise UsageError(
            f'{_FILE} {file}: no section is for {" or ".join(nodes.values())} in namespace '
            f'{namespace}; the sections are {", ".join(sections)}')
    return values


def _section_matches(section: str, full_name: str) -> bool:
    """Return true if a section, which may have wildcards, is for a node."""
    pattern = re.escape(section).replace(r'/\*\*', r'(/\w+)*').replace(r'\*', r'\w+')
    return re.fullmatch(pattern, full_name) is not None


def _read_assignment(argument: str, assignment: str, nodes: Mapping[str, str]
                     ) -> dict[str, Values]:
    """Return the value that nodes take from ``-p``, by executable."""
    match = _ASSIGNMENT.fullmatch(assignment)
    if match is None:
        raise UsageError(f'{argument}: this is neither NAME:=VALUE nor NODE:NAME:=VALUE')
    node, name, text = match.groups()
    declared = {executable: {*NODES[executable].parameters(), *parameter_file.OF_ROS}
                for executable in nodes if node in (None, nodes[executable])}
    if not declared:
        raise UsageError(
            f'{argument}: no node is called {node} here; allowed: {" | ".join(nodes.values())}')
    owners = [executable for executable in declared if name in declared[executable]]
    if not owners:
        hint = (suggest(name, set().union(*declared.values()))
                or '; `ctc parameters` lists all parameters')
        raise UsageError(f'{argument}: {" | ".join(declared)} has no parameter of this name{hint}')
    try:
        value = parse_value(text)
    except CtcError as error:
        raise UsageError(f'{argument}: {error}') from None
    return {executable: {name: value} for executable in owners}


def parse(arguments: Sequence[str]) -> tuple[list[str], RosArguments]:
    """
    Split a command line.

    Parameters
    ----------
    arguments : sequence of str
        Without the program's name.

    Returns
    -------
    for_program : list of str
        Arguments of the program itself.
    ros : RosArguments
        Arguments between ``--ros-args`` and ``--`` or the end.

    """
    for_program: list[str] = []
    for_ros: list[str] = []
    parameters: list[tuple[str, str]] = []
    words, target = iter(arguments), for_program
    for word in words:
        if word == '--ros-args':
            target = for_ros
        elif target is for_ros and word == '--':
            target = for_program
        elif target is for_ros and word in ('-p', '--param', _FILE):
            parameters.append((word, next(words, '')))
        else:
            target.append(word)
    return for_program, RosArguments(tuple(parameters), tuple(for_ros))


def bringup_values(ros: RosArguments) -> dict[str, Values]:
    """
    Return the parameters for all nodes of the graph, by executable.

    Raises
    ------
    CtcError
        For a parameter that is not allowed.
    UsageError
        For a remap that would rename nodes, or a parameter that applies to none of them.

    """
    if any(re.match(r'__(node|name):=|\w+:__', word) for word in ros.for_ros):
        raise UsageError('-r __node:=… and a namespace for one node only are not possible here: '
                         'the nodes would not find each other; -r __ns:=… is for all')
    return ros.values(list(NODES))

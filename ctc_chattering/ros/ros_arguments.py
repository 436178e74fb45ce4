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
The arguments after ``--ros-args``: parameters are read as in `ctc simulate`, rcl has the rest.

rcl would ignore ``-p`` for a parameter that a file gives in the node's own section, and what is
for unknown nodes or parameters, and it refuses a list of integers and other numbers. Here the last
one wins, a node's own section has precedence over ``/**`` of the same file, and a name that is not
declared is refused.
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
_RULE = re.compile(r'(?:(?P<node>\w+):)?(?P<name>[^:=\s]+):=(?P<value>.*)', re.DOTALL)


class RosArguments(NamedTuple):
    """
    The arguments after ``--ros-args``.

    Attributes
    ----------
    sources : tuple of (str, str)
        Flags of parameters with their values, in order: files, and rules of single parameters.
    rest : tuple of str
        Arguments for ROS itself: remaps, logging, security.

    """

    sources: tuple[tuple[str, str], ...] = ()
    rest: tuple[str, ...] = ()

    @property
    def assigned(self) -> set[str]:
        """Return the parameters that ``-p`` gives."""
        return {found['name'] for flag, text in self.sources
                if flag != _FILE and (found := _RULE.fullmatch(text))}

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
        remaps: dict[str, str] = {}
        for flag, rule in pairwise(self.rest):
            if flag in ('-r', '--remap'):
                left, _, right = rule.partition(':=')
                remaps.setdefault(left.rpartition(':')[2], right)  # The first one wins in ROS.
        namespace = '/' + remaps.get('__ns', '').strip('/')
        names = {x: remaps.get('__node', remaps.get('__name', x)) for x in executables}
        found: dict[str, Values] = {executable: {} for executable in executables}
        for flag, text in self.sources:
            given = (_in_file(Path(text), namespace, names) if flag == _FILE
                     else _assigned(f'{flag} {text}', text, names))
            for executable, values in given.items():
                found[executable] |= values
        return found


def _in_file(file: Path, namespace: str, names: Mapping[str, str]) -> dict[str, Values]:
    """
    Return what a file has for the nodes called `names`, by executable.

    A section without a namespace is for that node in any namespace.
    """
    if not os.path.exists(file):  # noqa: PTH110 - A name may be too long for a system.
        raise UsageError(f'{_FILE} {file}: there is no such file')
    found: dict[str, Values] = {}
    everything = parameter_file.full_sections(file)
    for executable, node in names.items():
        sections: dict[str, Values] = {}
        for name, values in everything.items():
            pattern = re.escape(name).replace(r'/\*\*', r'(/\w+)*').replace(r'\*', r'\w+')
            if re.fullmatch(pattern, f'{namespace.rstrip("/")}/{node}') or name == f'/{node}':
                wild = '*' in name.rsplit('/', 1)[1]
                sections.setdefault(
                    parameter_file.EVERY_NODE if wild else executable, {}).update(values)
        if sections:
            found[executable] = parameter_file.node_values(sections, executable, str(file))
    if not found:
        raise UsageError(f'{_FILE} {file}: no section is for {" or ".join(names.values())} in '
                         f'namespace {namespace}; there is '
                         + ', '.join(everything))
    return found


def _assigned(where: str, rule: str, names: Mapping[str, str]) -> dict[str, Values]:
    """Return what ``-p`` gives to the nodes called `names`, by executable."""
    match = _RULE.fullmatch(rule)
    if match is None:
        raise UsageError(f'{where}: this is not NAME:=VALUE, nor NODE:NAME:=VALUE')
    node, name, text = match.groups()
    asked = {x: (*NODES[x].parameters(), *parameter_file.OF_ROS)
             for x in names if node in (None, names[x])}
    if not asked:
        raise UsageError(f'{where}: no node is called {node} here; ' + ' | '.join(names.values()))
    known = {x for parameters in asked.values() for x in parameters}
    if name not in known:
        raise UsageError(f'{where}: {" | ".join(asked)}: no parameter of this name'
                         + (suggest(name, known) or '; ctc parameters lists them'))
    try:
        value = parse_value(text)
    except CtcError as error:
        raise UsageError(f'{where}: {error}') from None
    return {x: {name: value} for x, parameters in asked.items() if name in parameters}


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

    """
    own: list[str] = []
    rest: list[str] = []
    sources: list[tuple[str, str]] = []
    words, into = iter(arguments), own
    for word in words:
        if word == '--ros-args':
            into = rest
        elif into is own or word not in ('-p', '--param', _FILE, '--'):
            into.append(word)
        elif word == '--':
            into = own
        else:
            sources.append((word, next(words, '')))
    return own, RosArguments(tuple(sources), tuple(rest))


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
    if any(re.match(r'__(node|name):=|\w+:__', word) for word in ros.rest):
        raise UsageError('-r __node:=… and a namespace for one node only are not possible here: '
                         'the nodes would not find each other; -r __ns:=… is for all')
    return ros.values(list(NODES))

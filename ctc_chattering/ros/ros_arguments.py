"""
The arguments after ``--ros-args``, parsed by one rule for every executable.

ROS silently ignores arguments for unknown nodes or parameters, and between a node's own section
and ``/**`` the first one in a file has precedence for all that follow. Here the last one wins, a
node's own section has precedence over ``/**`` of the same file, and unknown names are refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import dataclasses
import difflib
from pathlib import Path
import re
from typing import Any, NamedTuple

import yaml

from ctc_chattering.errors import CtcError, UsageError
from ctc_chattering.experiment import parameter_file
from ctc_chattering.experiment.node_parameters import NODES, parameters_of
from ctc_chattering.experiment.yaml_file import Dumper, parse_value
from ctc_chattering.ros.topics import TOPICS

_FLAGS = {f'--{does}able-{what}-logs' for does in ('en', 'dis')
          for what in ('rosout', 'stdout', 'external-lib')}
_WITH_VALUE = {'-r', '--remap', '-p', '--param', '--params-file', '-e', '--enclave',
               '--log-level', '--log-config-file', '--log-file-name'}
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

    def values(self, executable: str) -> dict[str, Any]:
        """
        Return the parameters of a node by these arguments, the last value of each.

        Raises
        ------
        CtcError
            For a parameter that the node does not have, or a file that is none.

        """
        node = self.node or executable
        path = f'{self.namespace.rstrip("/")}/{node}'
        known = parameters_of(executable)
        values: dict[str, Any] = {}
        for source in self.sources:
            if isinstance(source, Path):
                values |= parameter_file.node_values(
                    _sections_for(path, executable, source), executable, str(source))
            elif source.node in ('', node) and source.name in (*known, *parameter_file.OF_ROS):
                values[source.name] = source.value
        return {name: known[name].coerce(value) if name in known else value
                for name, value in values.items()}

    def check(self, executables: Sequence[str]) -> None:
        """
        Check that every parameter and every file concerns a node of these executables.

        Raises
        ------
        UsageError
            If one does not.

        """
        names = {self.node or executable: executable for executable in executables}
        for source in self.sources:
            if isinstance(source, Path):
                self._check_file(source, names)
                continue
            if source.node and source.node not in names:
                raise UsageError(f'-p {source.node}:{source.name}: no node is called '
                                 f'{source.node} here; ' + ' | '.join(names))
            asked = [names[source.node]] if source.node else list(executables)
            _check_name(source.name, asked)

    def _check_file(self, file: Path, names: Mapping[str, str]) -> None:
        """Raise `UsageError` unless a section of a file is for one of the nodes."""
        paths = {f'{self.namespace.rstrip("/")}/{node}': executable
                 for node, executable in names.items()}
        if not any(_sections_for(path, executable, file) for path, executable in paths.items()):
            raise UsageError(
                f'--params-file {file}: no section is for {" or ".join(paths)}; there is '
                + ', '.join(name for name, _ in parameter_file.full_sections(file)))


def _sections_for(path: str, executable: str, file: Path) -> dict[str, parameter_file.Values]:
    """
    Return what a file has for the node at `path`: under its executable's name, and ``/**``.

    A section without a namespace is for that node in any namespace.
    """
    found: dict[str, parameter_file.Values] = {}
    for name, values in parameter_file.full_sections(file):
        pattern = re.escape(name).replace(r'/\*\*', r'(/\w+)*').replace(r'\*', r'\w+')
        if re.fullmatch(pattern, path) or name == f'/{path.rsplit("/", 1)[1]}':
            section = parameter_file.EVERY_NODE if '*' in name.rsplit('/', 1)[1] else executable
            found.setdefault(section, {}).update(values)
    return found


def _check_name(name: str, executables: Sequence[str]) -> None:
    """Raise `UsageError` unless one of the executables has a parameter of this name."""
    known = [x for executable in executables for x in parameters_of(executable)]
    if name in known or name in parameter_file.OF_ROS:
        return
    if name.startswith('qos_overrides.'):
        raise UsageError(f'-p {name}: the QoS of topics is fixed')
    near = difflib.get_close_matches(name, known, 3)
    whose = f'{executables[0]} has no' if len(executables) == 1 else 'no node has a'
    raise UsageError(f'-p {name}: {whose} parameter of this name; '
                     + (f'do you mean {" or ".join(dict.fromkeys(near))}?' if near
                        else '--help lists them' if len(executables) == 1
                        else 'ctc parameters lists them'))


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
    own, rest = [], []
    sources: list[Path | _Assignment] = []
    found: dict[str, str] = {}
    words, inside = iter(arguments), False
    for word in words:
        if word == '--ros-args':
            inside = True
        elif not inside:
            own.append(word)
        elif word == '--':
            inside = False
        elif word in _FLAGS:
            rest.append(word)
        elif word not in _WITH_VALUE:
            raise UsageError(f'{word} is no argument of ROS (it is after --ros-args)')
        elif (value := next(words, '--')).startswith('--'):
            raise UsageError(f'{word} needs a value')
        elif word == '--params-file':
            sources.append(Path(value))
        elif word in ('-p', '--param'):
            sources.append(_assignment(word, value))
        else:
            rest += [word, value]
            if word in ('-r', '--remap'):
                found = dict([_remap(word, value)]) | found  # The first one wins in ROS.
    return own, RosArguments(found.get('node'), found.get('ns', '/'), tuple(sources), tuple(rest))


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


def assignments(values: dict[str, Any]) -> Iterator[str]:
    """Yield arguments for ROS that give the node of this process these parameters."""
    for name, value in values.items():
        # ROS takes an empty list for none; ours begin with an empty string.
        item = list(value) or [''] if isinstance(value, tuple) else value
        text = yaml.dump([item], Dumper=Dumper,
                         default_flow_style=True, width=float('inf'), allow_unicode=True)
        yield from ('-p', f'{name}:={text.strip()[1:-1]}')


def bringup_values(ros: RosArguments) -> dict[str, dict[str, Any]]:
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
    ros.check(list(NODES))
    return {executable: ros.values(executable) for executable in NODES}

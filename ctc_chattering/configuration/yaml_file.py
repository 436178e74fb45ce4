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
YAML files as ROS reads them.

They have parameters, specs, conditions or waypoints. `read_yaml` reads each file that a user
writes. It says which kind of file it has found instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
import io
import json
from pathlib import Path
import re
from typing import Any

from ctc_chattering.errors import CtcError, ParameterError, suggest
from ctc_chattering.input_files import read_bytes
import yaml


class Loader(yaml.SafeLoader):
    """YAML with numbers as ROS reads them."""

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """Return a mapping without equal keys."""
        node: yaml.MappingNode = super().compose_mapping_node(anchor)
        lines: dict[str, int] = {}
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            line = key.start_mark.line + 1
            if key.value in lines:
                raise CtcError(f'{self.name}: key {key.value} appears twice in one mapping, in '
                               f'lines {lines[key.value]} and {line}')
            lines[key.value] = line
        return node


class Dumper(yaml.SafeDumper):
    """YAML that quotes strings such as 1e3."""

    def ignore_aliases(self, data: Any) -> bool:
        """Write equal values twice, without an anchor."""
        del data
        return True


for _class in (Loader, Dumper):  # An integer is one already.
    _class.add_implicit_resolver(
        'tag:yaml.org,2002:float', re.compile(r'[-+]?(\d[\d_]*\.?\d*|\.\d+)([eE][-+]?\d+)?$'),
        list('-+0123456789.'))


def parse_value(text: str) -> Any:
    """
    Return the value of a text in YAML.

    Raises
    ------
    CtcError
        If it is none, or null, or has a key twice.

    """
    try:
        value = yaml.load(text, Loader)
    except (yaml.YAMLError, ValueError):
        value = None
    if value is None:
        raise CtcError('this is not a YAML value')
    return value


class FileKind(Enum):
    """Kinds of YAML files that a user writes."""

    PARAMETERS = 'a parameter file'
    SPEC = 'a spec of ctc map or ctc tune'
    WAYPOINTS = 'a file of waypoints'
    CONDITIONS = 'a file of conditions'


#: Use of each kind of file.
_USE = {
    FileKind.PARAMETERS: 'give it to ctc simulate or bringup, or name it as params_file of a spec',
    FileKind.SPEC: 'give it to ctc map or ctc tune',
    FileKind.WAYPOINTS: 'name it as trajectory_file of the reference',
    FileKind.CONDITIONS: 'give it to ctc compare --cases'}
#: Keys by which a kind is detected: a file has one of them.
_KEYS = {
    FileKind.WAYPOINTS: ('points',), FileKind.CONDITIONS: ('cases',),
    FileKind.SPEC: ('params_file', 'laws', 'axes', 'uncertain', 'tune')}


def detect_kind(tree: object) -> FileKind | None:
    """Return the kind of a file, if a key tells."""
    if not isinstance(tree, dict):
        return None
    if any(isinstance(value, dict) and 'ros__parameters' in value for value in tree.values()):
        return FileKind.PARAMETERS
    for file_kind, keys in _KEYS.items():
        if not tree.keys().isdisjoint(keys):
            return file_kind
    return None


def read_yaml(path: Path, *expected: FileKind) -> object:
    """
    Return the contents of a YAML file.

    Parameters
    ----------
    path : Path
        The file.
    *expected : FileKind
        Kinds that are taken, the preferred one first. None for any.

    Raises
    ------
    CtcError
        If it cannot be read, is not one YAML document, has a key twice, or is of another kind.

    """
    content = read_bytes(path)
    try:
        stream = io.StringIO(content.decode(), newline=None)
        stream.name = str(path)  # For messages of the parser.
        tree = yaml.load(stream, Loader)
        json.dumps(tree, default=str, skipkeys=True)  # Refuses a value that contains itself.
    except (yaml.YAMLError, ValueError) as error:
        reason = ' '.join(str(error).split())
        raise CtcError(f'{path}: this is not a YAML file: {reason}') from None
    actual = detect_kind(tree)
    if expected and actual and actual not in expected:
        raise CtcError(
            f'{path}: this is {actual.value}, not {expected[0].value}; {_USE[actual]}')
    return tree


def yaml_text(tree: object) -> str:
    """Return the text of a YAML file."""
    return yaml.dump(tree, Dumper=Dumper, default_flow_style=None, sort_keys=False, width=99)


def mapping(name: str, value: object, keys: Sequence[str]) -> dict[Any, Any]:
    """Return a mapping, or raise `ParameterError` for other keys."""
    unknown = [key for key in value if key not in keys] if isinstance(value, dict) else [value]
    if unknown or not isinstance(value, dict):
        raise ParameterError(name, unknown[0], f'a mapping of {", ".join(keys)}'
                             + suggest(unknown[0], keys))
    return value

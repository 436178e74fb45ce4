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

"""YAML files, with numbers as ROS reads them, and every key once."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
import re
from typing import Any

from ctc_chattering.errors import CtcError, near, ParameterError
import yaml


class Loader(yaml.SafeLoader):
    """YAML with numbers as ROS reads them, 1e-3 is one; a key that stands twice is refused."""

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """Return a mapping as it is written; of equal keys YAML would take the last silently."""
        node: yaml.MappingNode = super().compose_mapping_node(anchor)
        lines: dict[tuple[str, str], int] = {}
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            name, line = (key.tag, key.value), key.start_mark.line + 1
            if name in lines:
                raise CtcError(f'key {key.value} appears twice in one mapping, in lines '
                               f'{lines[name]} and {line}')
            lines[name] = line
        return node


Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float',
    re.compile(r'^[-+]?(\d[\d_]*\.?\d*([eE][-+]?\d+)|\d[\d_]*\.\d*([eE][-+]?\d+)?|'
               r'\.\d+([eE][-+]?\d+)?|\.(inf|Inf|INF)|\.(nan|NaN|NAN))$'),
    list('-+0123456789.'))


class Dumper(yaml.SafeDumper):
    """YAML that quotes the strings which ROS would read as numbers, such as 1e3."""


Dumper.yaml_implicit_resolvers = {
    key: [*Loader.yaml_implicit_resolvers.get(key, []), *value]
    for key, value in yaml.SafeDumper.yaml_implicit_resolvers.items()}


def parse_value(text: str) -> Any:
    """
    Return the value that `text` is in YAML.

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


def read_yaml(path: Path) -> object:
    """
    Return what a YAML file holds.

    Raises
    ------
    CtcError
        If it cannot be read, is not one YAML document, or has a key twice.

    """
    try:
        with path.open(encoding='utf-8') as stream:
            return yaml.load(stream, Loader)
    except OSError as error:
        raise CtcError(f'{path}: {error.strerror or error}') from None
    except CtcError as error:
        raise CtcError(f'{path}: {error}') from None
    except (yaml.YAMLError, ValueError) as error:
        text = ' '.join(str(error).split())
        raise CtcError(f'{path}: not a YAML file: {text}') from None


def mapping(name: str, value: object, keys: Sequence[str]) -> dict[Any, Any]:
    """Return `value`; raise `ParameterError` unless it is a mapping with no other keys."""
    allowed = 'a mapping of ' + ', '.join(keys)
    if not isinstance(value, dict):
        raise ParameterError(name, value, allowed)
    for key in value:
        if key not in keys:
            raise ParameterError(name, key, allowed + near(key, keys))
    return value

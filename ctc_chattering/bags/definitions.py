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
Definitions of message types: those in a bag, and those of the packages that are installed.

rosbags is asked, where it is installed, for types that neither has, and for definitions in IDL.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
import json
import os
from pathlib import Path
import re
from typing import NamedTuple

from ctc_chattering.errors import CtcError

_KIND = re.compile(r'[a-z]\w*/msg/\w+')
_SEPARATOR = '=' * 80
_SECTION = re.compile(r'^=+\nMSG: *(\S+) *$', re.MULTILINE)
_FIELD = re.compile(
    r'^[ \t]*([A-Za-z][\w/]*)(?:<=\d+)?(?:\[(?:<=\d+|(\d*))\]|(?=\s))[ \t]+(\w+)\b(?![ \t]*=)',
    re.MULTILINE)
#: NumPy's codes of the types that are numbers.
NUMBERS = {'bool': 'u1', 'byte': 'u1', 'char': 'u1', 'octet': 'u1', 'uint8': 'u1', 'int8': 'i1',
           'uint16': 'u2', 'int16': 'i2', 'uint32': 'u4', 'int32': 'i4', 'uint64': 'u8',
           'int64': 'i8', 'float32': 'f4', 'float64': 'f8'}
_BASES = frozenset((*NUMBERS, 'string', 'wstring'))
#: What a message without fields has, for it has one byte.
_EMPTY = 'structure_needs_at_least_one_member'


class Field(NamedTuple):
    """
    A field of a type.

    Attributes
    ----------
    name, kind : str
        Of the field; a base type or another type.
    length : int or None
        Length of an array, 0 for a sequence, None for a single value.

    """

    name: str
    kind: str
    length: int | None

    @property
    def is_base(self) -> bool:
        """Return whether it has numbers or strings."""
        return self.kind in _BASES


Definitions = Mapping[str, tuple[Field, ...]]


def parsed(text: str, kind: str) -> Definitions:
    """Return the types in the text of a definition, as a bag has it, of the type `kind`."""
    _, *more = parts = _SECTION.split(text)
    sections = {kind: parts[0], **{
        _full(name, ''): section for name, section in zip(more[::2], more[1::2])}}
    return {name: _fields(section, name.partition('/')[0]) for name, section in sections.items()}


def _fields(text: str, package: str) -> tuple[Field, ...]:
    return tuple(_field(match, package) for match in _FIELD.finditer(text)) or (
        Field(_EMPTY, 'uint8', None),)


def _field(match: re.Match[str], package: str) -> Field:
    kind, length, name = match.groups()
    array = '[' in match[0]
    return Field(name, _full(kind, package), int(length or 0) if array else None)


def _full(kind: str, package: str) -> str:
    """Return the full name of a type that a definition of a package names."""
    if kind in _BASES:
        return kind
    return '/'.join([kind.partition('/')[0] if '/' in kind else package, 'msg',
                     kind.rpartition('/')[2]])


def _file(kind: str, ending: str) -> Path | None:
    """Return a file of a type in the share directory of its package; None without one."""
    if not _KIND.fullmatch(kind):
        return None
    package, _, name = kind.split('/')
    prefixes = [Path(x) for x in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if x]
    found = find_spec(package)
    if found is not None and found.origin:
        prefixes += Path(found.origin).parents[4:5]
    for prefix in prefixes:
        path = prefix / 'share' / package / 'msg' / (name + ending)
        if path.is_file():
            return path
    return None


@cache
def installed_definition(kind: str) -> str:
    """
    Return the definition of an installed type with those it is made of, as rosbag2 stores it.

    Raises
    ------
    CtcError
        If one of them is not installed.

    """
    parts: dict[str, str] = {}
    waiting = [kind]
    while waiting:
        name = waiting.pop(0)
        if name in parts:
            continue
        path = _file(name, '.msg')
        if path is None:
            raise CtcError(f'{kind}: the definition of {name} is not installed')
        parts[name] = path.read_text(encoding='utf-8')
        waiting += [x.kind for x in _fields(parts[name], name.partition('/')[0])
                    if not x.is_base]
    text = parts.pop(kind)
    return text + ''.join(f'\n{_SEPARATOR}\nMSG: {name.replace("/msg/", "/")}\n{part}'
                          for name, part in parts.items())


@cache
def type_hash(kind: str) -> str:
    """Return the hash of an installed type; empty if its package has none."""
    path = _file(kind, '.json')
    hashes = json.loads(path.read_text(encoding='utf-8'))['type_hashes'] if path else ()
    return {x['type_name']: str(x['hash_string']) for x in hashes}.get(kind, '')


@cache
def definitions(kind: str, encoding: str, text: str) -> Definitions:
    """
    Return what the messages of a type consist of; without `kind` if nothing defines it.

    Parameters
    ----------
    kind : str
        The type.
    encoding : {'ros2msg', 'ros2idl', ''}
        Of the definition in the bag; empty for none.
    text : str
        The definition.

    """
    if encoding == 'ros2msg':
        return _completed(parsed(text, kind))
    with suppress(Exception):  # Of arbitrary text, a parser raises arbitrary exceptions.
        return parsed(_by_rosbags(kind, text), kind) if text else parsed(
            installed_definition(kind), kind)
    with suppress(Exception):
        return parsed(_by_rosbags(kind, ''), kind)
    return {}


def _completed(types: Definitions) -> Definitions:
    """Return types with those that they are made of, as far as these are installed."""
    found = dict(types)
    for field in (x for fields in types.values() for x in fields):
        if not field.is_base and field.kind not in found:
            with suppress(CtcError):
                found.update(parsed(installed_definition(field.kind), field.kind))
    return found


def _by_rosbags(kind: str, idl: str) -> str:
    """Return a definition in IDL, or of a type that ROS 2 Jazzy brings along, as of a `.msg`."""
    from rosbags.typesys import get_types_from_idl, get_typestore, Stores
    store = get_typestore(Stores.ROS2_JAZZY)
    if idl:
        store.register({name: fields for name, fields in get_types_from_idl(idl).items()
                        if name not in store.types})
    return store.generate_msgdef(kind, ros_version=2)[0]

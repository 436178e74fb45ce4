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
Parser of robot descriptions, as tolerant as urdfdom.

`urdf_parser` and the writers of URDFs call it. Elements of other programs stay. A prefix need
not be declared.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from xml.parsers import expat

from ctc_chattering.errors import CtcError

#: Largest description: urdfdom overflows the stack with a chain of 30,000 links.
_LARGEST_CHARACTERS = 4_000_000
_MOST_BODIES = 500
#: Prefix of the elements of xacro.
XACRO = 'xacro:'
#: Elements that xacro replaces whenever it runs. Others are macros, and stay if xacro has none.
_XACRO_COMMANDS = tuple(
    XACRO + name
    for name in (
        'include',
        'macro',
        'property',
        'arg',
        'if',
        'unless',
        'insert_block',
        'element',
        'attribute',
        'call',
    )
)


def parse_description(text: str, comments: bool = False) -> ET.Element:
    """
    Return the outermost element of a URDF or MJCF.

    Parameters
    ----------
    text : str
        The XML. Prefixes stay in the names of elements and attributes.
    comments : bool
        Keep comments.

    Raises
    ------
    CtcError
        If the text is not XML, if xacro has not run on it, or if it is of a size at which the
        parsers in C++ take minutes or overflow the stack.

    """
    if len(text) > _LARGEST_CHARACTERS:
        raise CtcError(
            f'the description is too large: {len(text)} characters, of '
            f'{_LARGEST_CHARACTERS} at most'
        )
    if '<!ENTITY' in text:
        raise CtcError('the description declares XML entities')
    root = _parse(text, comments)
    bodies = sum(element.tag in ('link', 'body') for element in root.iter())
    if bodies > _MOST_BODIES:
        raise CtcError(
            f'the description is too large: {bodies} bodies, of {_MOST_BODIES} at most'
        )
    return root


def _parse(text: str, comments: bool) -> ET.Element:
    """Return the outermost element. Raise `CtcError` with the faulty line."""
    body = text.lstrip()
    lines_before = text[: len(text) - len(body)].count('\n')
    builder = ET.TreeBuilder(insert_comments=comments)
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        if tag in _XACRO_COMMANDS:
            line = lines_before + parser.CurrentLineNumber
            raise CtcError(f'URDF: line {line}: <{tag}>: run xacro on it first')
        builder.start(tag, attributes)

    parser.StartElementHandler = start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    if comments:
        parser.CommentHandler = builder.comment
    try:
        parser.Parse(body, True)
    except expat.ExpatError as error:
        raise CtcError(
            f'the description is not XML: {expat.ErrorString(error.code)}: line '
            f'{lines_before + error.lineno}, column {error.offset}'
        ) from None
    except ValueError as error:
        raise CtcError(f'the description is not XML: {error}') from None
    return builder.close()

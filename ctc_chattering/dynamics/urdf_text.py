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

"""Places of links and joints in the text of a URDF, for changes that leave all else as it is."""

from __future__ import annotations

import dataclasses
from xml.parsers.expat import ParserCreate


@dataclasses.dataclass
class ElementPlace:
    """
    Where an element is, in bytes.

    Attributes
    ----------
    start, inside : int
        Of its first tag, and behind that.
    end : int
        Behind the element.
    empty : bool
        Whether it is one tag, with a slash.
    children : dict of str to ElementPlace
        Of each kind, the first one.

    """

    start: int
    inside: int
    end: int
    empty: bool
    children: dict[str, ElementPlace] = dataclasses.field(default_factory=dict)


def places(text: bytes) -> tuple[ElementPlace, dict[tuple[str, str], ElementPlace]]:
    """
    Return the place of the robot, and those of its links and joints by tag and name.

    Parameters
    ----------
    text : bytes
        XML in UTF-8, whatever its declaration says.

    """
    parser = ParserCreate('utf-8')
    open_places: list[ElementPlace] = []
    named: dict[tuple[str, str], ElementPlace] = {}
    robots: list[ElementPlace] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        at = parser.CurrentByteIndex
        inside = _behind_tag(text, at)
        place = ElementPlace(at, inside, inside, text[inside - 2:inside] == b'/>')
        if not open_places:
            robots.append(place)
        elif len(open_places) == 1:
            named[tag, attributes.get('name', '')] = place
        else:
            open_places[-1].children.setdefault(tag, place)
        open_places.append(place)

    def end(_: str) -> None:
        place = open_places.pop()
        if not place.empty:
            place.end = text.index(b'>', parser.CurrentByteIndex) + 1

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(text, True)
    return robots[0], named


def _behind_tag(text: bytes, at: int) -> int:
    """Return where a tag ends; its values may contain what looks like an end."""
    quote = b''
    for i in range(at, len(text)):
        byte = text[i:i + 1]
        if quote:
            quote = b'' if byte == quote else quote
        elif byte in (b'"', b"'"):
            quote = byte
        elif byte == b'>':
            return i + 1
    return len(text)

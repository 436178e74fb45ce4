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

"""Numbers, places and axes in the elements of a URDF."""

from __future__ import annotations

from math import hypot
from typing import NamedTuple
import xml.etree.ElementTree as ET

from ctc_chattering.errors import CtcError


class Origin(NamedTuple):
    """Where something is on what carries it: x, y, z [m] and roll, pitch, yaw [rad]."""

    xyz: tuple[float, ...]
    rpy: tuple[float, ...]


def origin(where: str, element: ET.Element) -> Origin:
    """Return what an element's origin says, zeros without one; raise `CtcError` for no numbers."""
    found = element.find('origin')
    if found is None:
        return Origin((0.0,) * 3, (0.0,) * 3)
    return Origin(*(tuple(numbers(where, f'origin {key}', found.get(key, '0 0 0'), 3))
                    for key in ('xyz', 'rpy')))


def axis(where: str, joint: ET.Element) -> tuple[float, float, float]:
    """Return the axis of a joint with length 1, or 0 as the text has it; raise for no numbers."""
    found = joint.find('axis')
    x, y, z = numbers(
        where, 'axis', '1 0 0' if found is None else found.get('xyz', '1 0 0'), 3)
    size = hypot(x, y, z) or 1.0
    return x / size, y / size, z / size


def numbers(where: str, what: str, text: str, count: int, most: float = 1e300) -> list[float]:
    """Return the numbers of an attribute, none of them larger than `most`."""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(abs(x) <= most for x in values):
        raise CtcError(f'URDF: {where}: {what} is {text!r}, not '
                       f'{"a number" if count == 1 else f"{count} numbers"}')
    return values

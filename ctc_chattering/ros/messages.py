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

"""Message classes by name, and times in messages."""

from __future__ import annotations

import importlib
import os
from pathlib import Path
import struct
from typing import Any

from builtin_interfaces.msg import Time
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.ros.serialization import byte_order, TIME
import rclpy

#: Where a package of ROS lists its interfaces, in each prefix.
_INTERFACES = Path('share/ament_index/resource_index/rosidl_interfaces')
#: Latest time that is taken from a stamp, an hour before the last possible one [ns].
LATEST = (2 ** 31 - 3600) * NANOSECONDS


def message_type(kind: str) -> Any:
    """
    Return the message class called `kind`, for example ``std_msgs/msg/String``.

    Bags and graphs name types: only what a package of ROS lists as its messages is imported.

    Raises
    ------
    CtcError
        If there is none.

    """
    package, _, name = kind.partition('/msg/')
    prefixes = [Path(rclpy.__file__).parents[4], *map(
        Path, filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)))]
    try:
        if any(f'msg/{name}.idl' in (prefix / _INTERFACES / package).read_text().split()
               for prefix in prefixes if (prefix / _INTERFACES / package).is_file()):
            return getattr(importlib.import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError, ValueError):
        pass
    raise CtcError(f'{kind}: this message type is not installed')


def stamp(nanoseconds: int) -> Time:
    """Return `nanoseconds` as a message."""
    sec, nanosec = divmod(nanoseconds, NANOSECONDS)
    return Time(sec=sec, nanosec=nanosec)


def read_stamp(data: bytes) -> int:
    """
    Return the time in a `Clock`, or in a header, at the beginning of a serialized message [ns].

    Raises
    ------
    CtcError
        If the message is incomplete, or this is no time from 0 to `LATEST`.

    """
    try:
        sec, nanosec = struct.unpack_from(byte_order(data) + TIME, data, 4)
    except struct.error:
        raise CtcError(f'the message is incomplete: {len(data)} bytes') from None
    t = sec * NANOSECONDS + nanosec
    if not (0 <= t <= LATEST and nanosec < NANOSECONDS):
        raise CtcError(
            f'{sec} s and {nanosec} ns are no time; allowed: 0 s to {seconds(LATEST)} s')
    return int(t)

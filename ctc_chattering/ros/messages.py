"""Message classes by name, and times in messages."""

from __future__ import annotations

import importlib
from typing import Any

from builtin_interfaces.msg import Duration, Time

from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.ros.cdr import read_time

#: Latest time that is taken from a stamp, an hour before the last possible one [ns].
LATEST = (2 ** 31 - 3600) * NANOSECONDS


def message_type(kind: str) -> Any:
    """
    Return the message class called `kind`, for example ``std_msgs/msg/String``.

    Raises
    ------
    CtcError
        If there is none.

    """
    try:
        package, _, name = kind.split('/')
        return getattr(importlib.import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError, ValueError):
        raise CtcError(f'{kind}: this type of message is not installed') from None


def stamp(nanoseconds: int) -> Time:
    """Return `nanoseconds` as a message."""
    sec, nanosec = divmod(nanoseconds, NANOSECONDS)
    return Time(sec=sec, nanosec=nanosec)


def nanoseconds_of(time: Time | Duration) -> int:
    """Return a time message in nanoseconds."""
    return int(time.sec) * NANOSECONDS + int(time.nanosec)


def read_clock(data: bytes) -> int:
    """Return the time in a serialized `Clock` [ns]; raise `CtcError` if it is malformed."""
    sec, nanosec = read_time(data)
    return sec * NANOSECONDS + nanosec


def read_stamp(data: bytes) -> int | None:
    """Return the time [ns] of a `Clock` or a header at the beginning of a message, if any."""
    try:
        sec, nanosec = read_time(data)
    except CtcError:
        return None
    t = sec * NANOSECONDS + nanosec
    return t if 0 <= t <= LATEST and nanosec < NANOSECONDS else None

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
Signals of a run: each at times of its own, with where its samples come from.

A signal of a bag is drawn as it was recorded, at its own rate. One that is computed from what was
recorded is computed exactly, or not at all.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from enum import Enum
import json
from typing import Any, NamedTuple
import zlib

from ctc_chattering.simulation.closed_loop import Array
import numpy as np


class SignalOrigin(Enum):
    """Source of the samples of a signal."""

    RECORDED = 'recorded'
    COMPUTED = 'computed exactly'
    UNKNOWN = 'not known'


class Series(NamedTuple):
    """
    Samples of a signal at times of its own.

    Attributes
    ----------
    t : ndarray, shape (N,)
        Increasing times [s].
    values : ndarray, shape (N, columns)
        A column a joint, or one in all; nan where a sample is not known.
    origin : SignalOrigin
        Of all samples.
    received : bool
        Whether `t` are times of reception: the messages have no stamps. Each value is in force
        until the next one.

    """

    t: Array
    values: Array
    origin: SignalOrigin
    received: bool = False

    @property
    def step(self) -> float:
        """Return the usual time between two samples [s]; 0 with fewer than two."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else 0.0


#: Parts of a torque as the controller publishes them: nominal + compensation + robust.
PARTS = ('nominal', 'compensation', 'robust')
#: Signals that differ less than 32 bits tell: q of q_d, and one time of the next.
_EXACT = ('t', 'q', 'q_d')
#: Step to which files of pages round positions: 9e-10 rad, less than any encoder has.
_POSITION_STEP = 2.0 ** -30
#: Step to which times of a long run are rounded [s].
_TIME_STEP = 2.0 ** -20
#: Bits of a number of 32 that are left out then: it differs by at most 1.5e-5 of itself.
_DROPPED = 8
#: Strength of the compression: one less is a fortieth larger, one more takes twice as long.
_LEVEL = 8


def by_times(signals: Mapping[str, Series]) -> list[tuple[Array, dict[str, Array]]]:
    """Return signals that have the same times together: times, and values by name."""
    groups: list[tuple[Array, dict[str, Array]]] = []
    for name, series in signals.items():
        for t, values in groups:
            if t is series.t or np.array_equal(t, series.t):
                values[name] = series.values
                break
        else:
            groups.append((series.t, {name: series.values}))
    return [group for group in groups if len(group[0])]


def packed(t: Array, signals: Mapping[str, Array], **head: Any) -> bytes:
    """
    Return samples as the script reads them.

    Four bytes with the length of the head, the head in JSON, then the columns, each beginning at
    a multiple of eight bytes: 64 bits a number for `t`, `q` and `q_d`, 32 for the others.

    Parameters
    ----------
    t : ndarray, shape (N,)
        Times [s].
    signals : mapping of str to ndarray, shape (N,) or (N, n)
        By the names that plots.js lists.
    **head : Any
        More for the head: ``run``, number of the run, and ``fresh``; see `append` in plots.js.

    """
    columns = _columns(t, signals)
    return _head(columns, head) + b''.join(_filled(x.tobytes()) for _, _, x in columns)


def coded(t: Array, signals: Mapping[str, Array]) -> str:
    """Return `packed` samples as text, for `packed` of a run in a page."""
    return base64.b64encode(packed(t, signals)).decode()


def compressed(t: Array, signals: Mapping[str, Array], is_rounded: bool = False) -> str:
    """
    Return samples as text that `inflated` of samples.js makes `packed` samples of.

    Bits of a column are taken as whole numbers, of which second differences are small where a
    signal is smooth, and written byte by byte: those of lowest value first.

    Parameters
    ----------
    t, signals
        As of `packed`.
    is_rounded : bool
        Whether times are rounded to a microsecond, and numbers of 32 bits by at most
        1.5e-5 of each.

    """
    if is_rounded:
        t = np.round(t / _TIME_STEP) * _TIME_STEP
    columns = _columns(t, {
        name: np.round(x / _POSITION_STEP) * _POSITION_STEP if name in _EXACT else x
        for name, x in signals.items()})
    stream = zlib.compressobj(_LEVEL, memLevel=9)
    data = []
    for _, _, column in columns:
        bits = column.view(f'<u{column.itemsize}')
        if is_rounded and column.itemsize == 4:
            bits = (bits + np.uint32(1 << _DROPPED - 1)) >> _DROPPED << _DROPPED
        for _ in range(2):
            bits = np.diff(bits, prepend=bits.dtype.type(0))
        data.append(stream.compress(
            bits.view(np.uint8).reshape(-1, column.itemsize).T.tobytes()))
    return base64.b64encode(b''.join((_head(columns, {}), *data, stream.flush()))).decode()


def _columns(t: Array, signals: Mapping[str, Array]) -> list[tuple[str, int, Any]]:
    """Return name, joint and numbers of each column."""
    columns = []
    for name, rows in {'t': t, **signals}.items():
        with np.errstate(over='ignore'):
            values = np.asarray(rows, float).reshape(len(t), -1).T.astype(
                '<f8' if name in _EXACT else '<f4')
        columns += [(name, joint, column) for joint, column in enumerate(values)]
    return columns


def _head(columns: list[tuple[str, int, Any]], more: Mapping[str, Any]) -> bytes:
    """Return the head of `packed` with its length."""
    text = json.dumps({
        'count': len(columns[0][2]),
        'columns': [(name, joint, column.itemsize) for name, joint, column in columns],
        **more}).encode()
    return _filled(len(text).to_bytes(4, 'little') + text)


def _filled(data: bytes) -> bytes:
    """Return bytes with zeros up to a multiple of eight."""
    return data + bytes(-len(data) % 8)

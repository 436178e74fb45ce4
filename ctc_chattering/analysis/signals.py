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
Signals of a run, each with its times and the origin of its samples.

A signal of a bag is drawn as it was recorded, at its own rate. A signal that is computed from the
recording is computed exactly, or not at all. Pages take samples as bytes (`packed`), as text
(`coded`), or as short text (`compressed`).
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
        Origin of all samples.
    received : bool
        Times are those of reception, because the messages have no stamps. Each value is in force
        until the next one.

    """

    t: Array
    values: Array
    origin: SignalOrigin
    received: bool = False

    @property
    def step(self) -> float:
        """Usual time between two samples [s], or 0."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else 0.0


#: Parts of a torque as the controller publishes them: nominal + compensation + robust.
PARTS = ('nominal', 'compensation', 'robust')
#: Signals that need 64 bits, since samples differ by less than 32 bits can tell.
_EXACT = ('t', 'q', 'q_d')


def by_times(signals: Mapping[str, Series]) -> list[tuple[Array, dict[str, Array]]]:
    """
    Return signals of the same times together.

    Each group has times, and values by name. Signals without samples are left out.
    """
    groups: list[tuple[Array, dict[str, Array]]] = []
    for name, series in signals.items():
        values = next(
            (values for t, values in groups if t is series.t or np.array_equal(t, series.t)), None
        )
        if values is None:
            values = {}
            groups.append((series.t, values))
        values[name] = series.values
    return [group for group in groups if len(group[0])]


class _Column(NamedTuple):
    """Numbers of one signal and joint, of 64 bits for `_EXACT`, or else of 32."""

    name: str
    joint: int
    numbers: Any


def packed(t: Array, signals: Mapping[str, Array], **head: Any) -> bytes:
    """
    Return samples as the script reads them.

    Four bytes have the length of the head. The head in JSON follows, then the columns. Each
    begins at a multiple of eight bytes.

    Parameters
    ----------
    t : ndarray, shape (N,)
        Times [s].
    signals : mapping of str to ndarray, shape (N,) or (N, n)
        Values by the names that plots.js lists.
    **head : Any
        Further values of the head: ``run``, number of the run, and ``fresh``; see `append` in
        plots.js.

    """
    columns = _columns(t, signals)
    return _head(columns, head) + b''.join(_pad(x.numbers.tobytes()) for x in columns)


def coded(t: Array, signals: Mapping[str, Array]) -> str:
    """Return `packed` samples as text."""
    return base64.b64encode(packed(t, signals)).decode()


def compressed(t: Array, signals: Mapping[str, Array], is_rounded: bool = False) -> str:
    """
    Return samples as short text, for `inflated` of samples.js.

    Bits of a column are taken as whole numbers. Their second differences are small where a signal
    is smooth. These are written byte by byte: those of lowest value first.

    Parameters
    ----------
    t, signals
        As of `packed`.
    is_rounded : bool
        Round times to a microsecond, and numbers of 32 bits by at most 1.5e-5 of each.

    """
    if is_rounded:
        t = _round_to(2.0**-20, t)
    # No encoder resolves the step of positions, 9e-10 rad.
    columns = _columns(
        t, {name: _round_to(2.0**-30, x) if name in _EXACT else x for name, x in signals.items()}
    )
    # One level less is a fortieth larger, one more takes twice as long.
    stream = zlib.compressobj(8, memLevel=9)
    data = []
    for _, _, numbers in columns:
        bits = numbers.view(f'<u{numbers.itemsize}')
        if is_rounded and numbers.itemsize == 4:
            dropped = 8  # Bits without which a number differs by at most 1.5e-5 of itself.
            bits = (bits + np.uint32(1 << dropped - 1)) >> dropped << dropped
        for _ in range(2):
            bits = np.diff(bits, prepend=bits.dtype.type(0))
        data.append(stream.compress(bits.view(np.uint8).reshape(-1, numbers.itemsize).T.tobytes()))
    return base64.b64encode(b''.join((_head(columns, {}), *data, stream.flush()))).decode()


def _round_to(step: float, x: Array) -> Array:
    """Return numbers rounded to multiples of a step."""
    rounded: Array = np.round(x / step) * step
    return rounded


def _columns(t: Array, signals: Mapping[str, Array]) -> list[_Column]:
    """Return the columns of times and signals."""
    columns = []
    for name, rows in {'t': t, **signals}.items():
        with np.errstate(over='ignore'):
            values = (
                np.asarray(rows, float)
                .reshape(len(t), -1)
                .T.astype('<f8' if name in _EXACT else '<f4')
            )
        columns += [_Column(name, joint, numbers) for joint, numbers in enumerate(values)]
    return columns


def _head(columns: list[_Column], further: Mapping[str, Any]) -> bytes:
    """Return the head of `packed` with its length."""
    text = json.dumps(
        {
            'count': len(columns[0].numbers),
            'columns': [(name, joint, numbers.itemsize) for name, joint, numbers in columns],
            **further,
        }
    ).encode()
    return _pad(len(text).to_bytes(4, 'little') + text)


def _pad(data: bytes) -> bytes:
    """Return bytes with zeros up to a multiple of eight."""
    return data + bytes(-len(data) % 8)

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
The control grid, in whole nanoseconds.

Sample k lies at t = k h. Nodes, plant and controller count time in integers and convert it here.
So the same sample has the same float everywhere, and no error accumulates.
"""

from __future__ import annotations

from typing import Any

from ctc_chattering.errors import ParameterError
import numpy as np
import numpy.typing as npt

NANOSECONDS = 1_000_000_000
#: Relative deviation of a period from whole nanoseconds that is rounding of its decimal text.
_PERIOD_TOLERANCE = 1e-9


def nanoseconds(time: Any) -> int:
    """Return a message's time or duration in nanoseconds."""
    return int(time.sec) * NANOSECONDS + int(time.nanosec)


def period_ns(control_period: float) -> int:
    """
    Return `control_period` [s] in nanoseconds.

    Raises
    ------
    ParameterError
        If it is not a whole, positive number of nanoseconds (to one part in 1e9).

    """
    exact = control_period * NANOSECONDS
    ns = round(exact) if 0.0 < control_period < 1e9 else 0
    if ns < 1 or abs(exact - ns) > _PERIOD_TOLERANCE * ns:
        raise ParameterError(
            'control_period', control_period, 'a positive whole number of nanoseconds')
    return ns


def samples(duration: float, period: int) -> int:
    """
    Return the last index of a run.

    Duration in [s], period in [ns].
    """
    return round(duration * NANOSECONDS) // period


def seconds(nanoseconds: int) -> float:
    """Return integer nanoseconds in seconds, as the nearest float."""
    return nanoseconds / NANOSECONDS


def missing(t: npt.NDArray[np.float64], period: float) -> npt.NDArray[np.int64]:
    """
    Count the samples missing after each, shape (N - 1,).

    Parameters
    ----------
    t : ndarray, shape (N,)
        Times of the samples, increasing [s].
    period : float
        Sample period [s].

    """
    periods = np.rint(np.diff(t) / period)
    return np.maximum(periods.astype(np.int64) - 1, 0)

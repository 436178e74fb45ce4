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
Filter (3) of the paper, which gives v without the acceleration.

The laws (2) and (6) and the switchings use it, with λ and b of `ControllerConfig`. In continuous
time, with a state ξ and ξ(0) = 0::

    v = -b de + ξ,     dξ/dt = -λ ξ + b [(λ I - Kv) de - Kp e]

Sampled, with the bracket held over each period h, this has the exact solution::

    ξ[k+1] = exp(-λ h) ξ[k] + (1 - exp(-λ h)) / λ · b [λ de - u],     u = Kv de + Kp e
"""

from __future__ import annotations

from math import exp, expm1
from typing import NamedTuple

from ctc_chattering.compiled.compilable import record, solve, some
from ctc_chattering.numerics.linear_algebra import Array


@record
class ErrorFilter(NamedTuple):
    """
    Coefficients of the filter (3) for one sample period.

    Attributes
    ----------
    pole, b : float
        λ [1/s] and b.
    decay : float
        a = exp(-λ h).
    gain : float
        c = b (1 - a) / λ [s].
    scale : float
        b h [s].
    feedthrough : float
        b h - c [s].

    """

    pole: float
    b: float
    decay: float
    gain: float
    scale: float
    feedthrough: float

    def output(self, de: Array, xi: Array) -> Array:
        """Return v [rad/s] for the velocity error and ξ."""
        return xi - self.b * de

    def next_state(self, xi: Array, de: Array, u: Array) -> Array:
        """
        Return ξ, shape (n,), one period later.

        Parameters
        ----------
        xi : array, shape (n,)
            ξ [rad/s].
        de : array, shape (n,)
            Velocity error [rad/s].
        u : array, shape (n,)
            Kv de + Kp e [rad/s²].

        """
        return self.decay * xi + self.gain * (self.pole * de - u)

    def nominal_response(self, v: Array, u: Array) -> Array:
        """
        Return y, the next v without an error.

        It is a v + (b h - c) u, shape (n,) [rad/s].

        That is v of the next sample if dde + Kv de + Kp e were 0. The second term is of the order
        of h².
        """
        return self.decay * v + self.feedthrough * u

    def correction(self, mass: Array, excess: Array) -> Array:
        """
        Return the correction of ξ by anti-windup [rad/s].

        Over a period the torque `excess` that was not applied changes v by -b h M⁻¹ `excess`.
        The correction cancels that: v stays what it would be without limits.
        """
        return self.scale * solve(mass, excess) if some(excess) else excess


def design_filter(pole: float, b: float, period: float) -> ErrorFilter:
    """Return the filter with λ [1/s], b and h [s]."""
    gain = -b * expm1(-pole * period) / pole
    scale = b * period
    return ErrorFilter(
        pole,
        b,
        decay=exp(-pole * period),
        gain=gain,
        scale=scale,
        feedthrough=scale - gain)

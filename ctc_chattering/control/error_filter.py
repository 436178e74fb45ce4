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
The filter (3), with b > 0, λ > 0 and a state ξ that needs no acceleration.

In continuous time ``v = -b de + ξ`` with ``dξ/dt = -λ ξ + b [(λ I - Kv) de - Kp e]``, ξ(0) = 0.
Sampled, with the bracket held over each period h, this has the exact solution::

    ξ[k+1] = exp(-λ h) ξ[k] + (1 - exp(-λ h)) / λ · b [λ de - u],     u = Kv de + Kp e
"""

from __future__ import annotations

from math import exp, expm1
from typing import NamedTuple

from ctc_chattering.numerics.compilable import record
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class ErrorFilter(NamedTuple):
    """
    Coefficients of the filter (3), made by `error_filter`.

    They are arrays of shape (n,), because a product with a float takes twice as long.
    """

    #: λ [1/s] and b.
    pole: Array
    b: Array
    #: exp(-λ h), c = b (1 - exp(-λ h)) / λ, b h and b h - c.
    decay: Array
    gain: Array
    scale: Array
    rest: Array

    def output(self, de: Array, xi: Array) -> Array:
        """Return v, shape (n,) [rad/s], at the velocity error `de` and the state ξ."""
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
        Return y: what v would be a period later if dde + Kv de + Kp e were 0, shape (n,) [rad/s].

        It is exp(-λ h) v + (b h - c) u, with c the gain of the filter's input; the second part is
        of the order of h². Arguments as `next_state` has them.
        """
        return self.decay * v + self.rest * u


def error_filter(n: int, pole: float, b: float, period: float) -> ErrorFilter:
    """Return the filter of n joints with λ [1/s], b and the sample period [s]."""
    decay, gain = exp(-pole * period), -b * expm1(-pole * period) / pole
    return ErrorFilter(*(np.full(n, x) for x in (
        pole, b, decay, gain, b * period, b * period - gain)))

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

"""One step of the classical Runge-Kutta method: ddq = f(q, dq, u), u at three instants."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ctc_chattering.numerics.compilable import function
from ctc_chattering.numerics.linear_algebra import Array

Load = tuple[Array, Array, Array]


@function
def simpson(x: Array, sixth: float, k1: Array, k2: Array, k3: Array, k4: Array) -> Array:
    """Return x + sixth (k1 + 2 (k2 + k3) + k4), shape (n,)."""
    return x + sixth * (k1 + 2.0 * (k2 + k3) + k4)


@function
def step(f: Callable[[Any, Array, Array, Array], Array], system: Any, q: Array, dq: Array,
         load: Load, h: float) -> tuple[Array, Array]:
    """
    Return q and dq after `h`, to fourth order.

    Parameters
    ----------
    f : callable
        ddq = f(system, q, dq, u).
    system : Any
        Handed on to `f`.
    q, dq : array, shape (n,)
        Position [rad] and velocity [rad/s].
    load : (u(t), u(t + h/2), u(t + h))
        Torques, each of shape (n,) [N·m].
    h : float
        Step [s].

    """
    half = 0.5 * h
    a = f(system, q, dq, load[0])
    v2 = dq + half * a
    b = f(system, q + half * dq, v2, load[1])
    v3 = dq + half * b
    c = f(system, q + half * v2, v3, load[1])
    v4 = dq + h * c
    d = f(system, q + h * v3, v4, load[2])
    return simpson(q, h / 6.0, dq, v2, v3, v4), simpson(dq, h / 6.0, a, b, c, d)

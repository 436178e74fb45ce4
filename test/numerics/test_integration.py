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

"""Steps of the integrators against closed forms, and the first instant of an event."""

from __future__ import annotations

from collections.abc import Callable
import math

from ctc_chattering.numerics import integration
from ctc_chattering.numerics.integration import extrapolated_euler, runge_kutta
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest


def swing(squares: Array, q: Array, _dq: Array, u: Array) -> Array:
    """Two oscillators."""
    return u - squares * q


def test_oscillators_to_fourth_order() -> None:
    errors = []
    for n in (50, 100):
        q, dq, no = np.array((1.0, 0.0)), np.array((0.0, 3.0)), np.zeros(2)
        for _ in range(n):
            squares = np.array((4.0, 9.0))
            q, dq = runge_kutta(
                swing, squares, q, dq, swing(squares, q, dq, no), (no, no), 1.0 / n)
        errors.append(max(abs(q[0] - math.cos(2.0)), abs(q[1] - math.sin(3.0)),
                          abs(dq[0] + 2.0 * math.sin(2.0)), abs(dq[1] - 3.0 * math.cos(3.0))))
    assert errors[1] < 1e-6
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.1)


def test_a_load_that_changes_is_integrated_by_simpson_s_rule() -> None:
    """With ddq = u(t) alone, dq is exact for cubic u."""
    def free(_: None, _q: Array, _dq: Array, u: Array) -> Array:
        return u

    h = 0.7
    first, middle, last = (np.array((s ** 3, 1.0 - s ** 2)) for s in (0.0, 0.5 * h, h))
    _, dq = runge_kutta(free, None, np.zeros(2), np.zeros(2), first, (middle, last), h)
    assert dq == pytest.approx((h ** 4 / 4.0, h - h ** 3 / 3.0), rel=1e-14)


def damped(dampings: Array, q: Array, dq: Array, u: Array, s: float) -> Array:
    """Two oscillators of stiffness 4, damped: the mean acceleration of an Euler step `s`."""
    return (u - 4.0 * q - dampings * dq) / (1.0 + s * dampings)


def test_damped_oscillators_to_fourth_order() -> None:
    """Check d = 4, critical: exp(-2 t) (1 + 2 t), and the force that is held."""
    errors = []
    for n in (80, 160):
        q, dq, u = np.array((1.0, 0.25)), np.zeros(2), np.array((0.0, 1.0))
        for _ in range(n):
            q, dq = extrapolated_euler(damped, np.array((4.0, 4.0)), q, dq, u, 1.0 / n)
        errors.append(max(abs(q[0] - 3.0 * math.exp(-2.0)), abs(dq[0] + 4.0 * math.exp(-2.0))))
        assert q[1] == pytest.approx(0.25, abs=1e-14)
        assert dq[1] == pytest.approx(0.0, abs=1e-14)
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.1)


@pytest.mark.parametrize('damping', [1.0, 3.0, 10.0, 1e3, 1e9, 1e15])
def test_no_damping_is_too_large_for_a_step(damping: float) -> None:
    _, dq = extrapolated_euler(
        damped, np.full(2, damping), np.zeros(2), np.ones(2), np.zeros(2), 1.0)
    assert (np.abs(dq) < 1.0).all()
    _, dq = extrapolated_euler(
        damped, np.full(2, damping), np.zeros(2), np.ones(2), np.zeros(2), 1e-3)
    np.testing.assert_allclose(dq, math.exp(-1e-3 * damping), atol=4e-3)


CASES: list[tuple[Callable[[float], float], float]] = [
    (lambda s: 0.3 - s, 0.3),
    (lambda s: s * (0.7 - s), 0.7),                       # 0 at 0, rises, falls
    (lambda s: s * (1e-9 - s), 1e-9),                     # the rise is far below the step
    (lambda s: math.cos(2 * s), math.pi / 4),
    (lambda s: 1e-12 * (0.9 - s), 0.9),                   # badly scaled
    (lambda s: 1e12 * (0.9 - s), 0.9),
    (lambda s: 0.5 - s ** 9, 0.5 ** (1 / 9)),             # regula falsi alone is slow here
    (lambda s: 0.1 ** 15 - (s - 1e-5) ** 3, 1e-5 + 1e-5),  # triple
    (lambda s: 1.0 if s < 0.25 else -1.0, 0.25),          # a jump
    (lambda s: min(0.6 - s, 5.0 * (0.55 - s)), 0.55),     # the nearer of two joints
    (lambda s: 1e-3 * (1 / 3 - s) ** 3, 1 / 3),
    (lambda s: 1e3 if s < 1e-5 else -1e-3, 1e-5),
    (lambda s: (0.9 - s) * (1e-3 if s < 0.9 else 1e3), 0.9),
]


def first_negative(f: Callable[[float], float], end: float, f_end: float, tol: float) -> float:
    return integration.first_negative(lambda g, s: float(g(s)), f, end, f_end, tol)


@pytest.mark.parametrize(('f', 'root'), CASES)
def test_finds_the_sign_change(f: Callable[[float], float], root: float) -> None:
    """Check closed-form roots: f is negative at the result, not before it, in bounded work."""
    tol, calls = 1e-12, [0]

    def counted(s: float) -> float:
        calls[0] += 1
        return f(s)

    s = first_negative(counted, 1.0, f(1.0), tol)
    assert calls[0] <= 400
    assert f(s) < 0.0
    assert s == pytest.approx(root, abs=4e-12)
    assert f(s - 2 * tol) >= 0.0 or f(s) > -1e-12


def test_negative_at_once_ends_within_the_tolerance() -> None:
    """Check that a function with no positive part gives an instant after 0 but near it."""
    s = first_negative(lambda s: -s, 1.0, -1.0, 1e-12)
    assert 0.0 < s <= 2e-12

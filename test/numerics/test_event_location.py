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

"""The first instant at which a function turns negative."""

from collections.abc import Callable
import math

from ctc_chattering.numerics import integration
import pytest

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

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
]


def first_negative(f: Callable[[float], float], end: float, f_end: float, tol: float) -> float:
    return integration.first_negative(lambda g, s: float(g(s)), f, end, f_end, tol)


@pytest.mark.parametrize(('f', 'root'), CASES)
def test_finds_the_sign_change(f: Callable[[float], float], root: float) -> None:
    """Check closed-form roots: f is negative at the result, and not before the bracket."""
    tol = 1e-12
    s = first_negative(f, 1.0, f(1.0), tol)
    assert f(s) < 0.0
    assert s == pytest.approx(root, abs=4e-12)
    assert f(s - 2 * tol) >= 0.0 or f(s) > -1e-12


def test_negative_at_once_ends_within_the_tolerance() -> None:
    """Check that a function with no positive part gives an instant after 0 but near it."""
    s = first_negative(lambda s: -s, 1.0, -1.0, 1e-12)
    assert 0.0 < s <= 2e-12


def test_tolerance_is_kept_and_bites() -> None:
    """Check that a wide tolerance is used for fewer evaluations and a narrow one is met."""
    calls = [0]

    def f(s: float) -> float:
        calls[0] += 1
        return 0.5 - s ** 9

    counts, errors = [], []
    for tol in (1e-2, 1e-12):
        calls[0] = 0
        s = first_negative(f, 1.0, -0.5, tol)
        counts.append(calls[0])
        errors.append(s - 0.5 ** (1 / 9))
    assert 1e-12 < errors[0] <= 1e-2
    assert abs(errors[1]) <= 1e-12
    assert counts[0] < counts[1] <= 64


def _cubic(root: float, steep: float) -> Callable[[float], float]:
    return lambda s: steep * (root - s) ** 3


def _jump(root: float, steep: float) -> Callable[[float], float]:
    return lambda s: steep if s < root else -1.0 / steep


def _kink(root: float, steep: float) -> Callable[[float], float]:
    return lambda s: (root - s) * (steep if s < root else 1.0 / steep)


@pytest.mark.parametrize('kind', [_cubic, _jump, _kink])
@pytest.mark.parametrize('root', [0.9, 1 / 3, 1e-5])
@pytest.mark.parametrize('steep', [1e-3, 1.0, 1e3])
def test_tolerance_is_kept_where_the_secant_is_slow(
        kind: Callable[[float, float], Callable[[float], float]], root: float,
        steep: float) -> None:
    """Check that the bracket reaches its tolerance in bounded work for the hard functions too."""
    calls, g = [0], kind(root, steep)

    def f(s: float) -> float:
        calls[0] += 1
        return g(s)

    assert first_negative(f, 1.0, g(1.0), 1e-12) == pytest.approx(root, rel=0.0, abs=1.1e-12)
    assert calls[0] <= 400

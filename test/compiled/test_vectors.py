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

"""Compiled vectors: each operation and function gives what numpy gives, nan and signs included."""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import (
    diagonal,
    dot,
    every,
    first,
    function,
    outweighs,
    record,
    replaced,
    rotated,
    solve,
    solve_damped,
    solve_where,
    some,
)
from ctc_chattering.compiled.record_types import register
from ctc_chattering.compiled.records import load, packed, store
from ctc_chattering.numerics.box_qp import nearest
import numba
import numpy as np
from oracles import Array, inclusion_by_enumeration, random_spd
import pytest


@record
class Inner(NamedTuple):
    x: Array
    factor: float

    def scaled(self, other: Array) -> Array:
        return self.factor * self.x - other


@record
class Case(NamedTuple):
    inner: Inner
    y: Array
    M: Array


@function
def arithmetic(x: Array, y: Array) -> tuple[Array, ...]:
    both = (x < y) & (y > 0.0) | (x == y)
    return (
        x + y, x - 2.0, 3.0 * x, x / y, -x, np.abs(x), np.sign(x), np.exp(0.1 * x), np.cbrt(x),
        np.tanh(x), np.sqrt(np.abs(x)), np.minimum(x, y), np.maximum(x, 0.5),
        np.where(x <= y, x, y), np.where(both, 1.0, -1.0), np.where(x != y, x, 0.0),
        np.where(~(x >= y), x, y), replaced(x, 1, 7.0), rotated(x),
        np.where(both, np.abs(x).max(), y[0]) + (1.0 if some(x > y) else 0.0)
        + (2.0 if every(x > y) else 0.0) + first(x > y))


@function
def algebra(case: Case) -> tuple[Array, ...]:
    x, y = case.inner.x, case.y
    return (dot(case.M, x), diagonal(case.M), solve(case.M, x), solve_where(x > y, case.M, x),
            solve_damped(x > y, case.M, np.abs(y), x),
            x + (1.0 if outweighs(x > y, case.M, 0.3 * np.abs(y)) else 0.0),
            case.inner.scaled(y), nearest(case.M, x, np.abs(y)))


register()


@numba.njit
def compiled_arithmetic(fields: Case, out: list[Case]) -> None:
    case = load(fields)
    for i, z in enumerate(arithmetic(case.inner.x, case.y)):
        store(out[i], Case(Inner(z, case.inner.factor), case.y, case.M))


@numba.njit
def compiled_algebra(fields: Case, out: list[Case]) -> None:
    case = load(fields)
    for i, z in enumerate(algebra(case)):
        store(out[i], Case(Inner(z, case.inner.factor), case.y, case.M))


def results(call: object, case: Case, count: int) -> Array:
    """Return what compiled code has stored in so many records."""
    out = np.array([packed(case)] * count).view(np.recarray)
    call(packed(case), out)  # type: ignore[operator]
    return np.array([one['inner']['x'] for one in out])


SPECIAL = np.array([0.0, -0.0, np.nan, np.inf, -np.inf, 1.5, -1.5])


@pytest.mark.parametrize(('x', 'y'), [
    (SPECIAL, np.arange(7) - 3.0),
    (np.arange(7) - 3.0, SPECIAL),
])
def test_elements_are_those_of_numpy(x: Array, y: Array) -> None:
    with np.errstate(all='ignore'):
        right = np.array(arithmetic(x, y))
    case = Case(Inner(x, 2.0), y, np.eye(len(x)))
    np.testing.assert_allclose(results(compiled_arithmetic, case, len(right)), right, rtol=1e-15)


def test_algebra_against_numpy_and_enumeration() -> None:
    rng, n = np.random.default_rng(3), 3
    for _ in range(50):
        case = Case(Inner(3.0 * rng.normal(size=n), 0.5), rng.normal(size=n), random_spd(rng, n))
        right = np.array(algebra(case))
        np.testing.assert_allclose(results(compiled_algebra, case, len(right)), right,
                                   rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(
            right[-1], inclusion_by_enumeration(case.M, case.inner.x, np.abs(case.y)),
            rtol=1e-8, atol=1e-9)

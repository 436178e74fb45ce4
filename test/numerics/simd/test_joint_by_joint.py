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

"""What the plant's code does with vectors is the same for lists and compiled, nan included."""

from __future__ import annotations

from math import inf, nan
import operator
from typing import Any, NamedTuple

from ctc_chattering.numerics.compilable import (
    along,
    bits,
    each,
    exchanged,
    function,
    least,
    record,
    truths,
    uniform,
)
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.records import load, packed, store
from ctc_chattering.numerics.simd.records import register
import numba
import numpy as np
import pytest


@record
class Two(NamedTuple):
    x: Vector
    y: Vector
    number: int

    def greater(self, other: Vector) -> Vector:
        return each(chosen, self.x, other, uniform(2.0))


@record
class One(NamedTuple):
    z: float

    def greater(self, smaller: Vector) -> Vector:
        return along(smaller, self.z, smaller)


@function
def chosen(x: float, y: float, factor: float) -> float:
    return x if x > y else factor * y


@function
def of_system(system: Two, factor: float) -> float:
    return factor * least(system.x)


@function
def called(f: Any, system: Two, factor: float) -> float:
    value: float = f(system, factor)
    return value


@function
def results(a: Two, rows: Any) -> tuple[Two, Two]:
    number = bits(a.x)
    held = 1.0 if truths(number, a.x)[1] else 0.0
    some = called(of_system, a, 3.0) + held + (1.0 if 0.0 in a.x else 0.0)
    return (Two(along(a.x, 0.5, a.y), One(2.0).greater(a.greater(a.y)), number),
            Two(each(operator.mul, a.x, uniform(some)), exchanged(rows, 1, a.y), a.number + 1))


@numba.njit
def compiled(fields: Any, rows: Any, one: Any, other: Any) -> None:
    a, b = results(load(fields), rows)
    store(one, a)
    store(other, b)


CASES = [([1.0, -2.0], [0.5, 4.0]), ([0.0, 2.0], [-0.0, 3.0]), ([nan, 3.0, inf], [1.0, nan, 2.0]),
         ([nan, nan, nan], [1.0, 2.0, 3.0]), ([0.1 * i - 0.3 for i in range(7)], [1.0] * 7)]


@pytest.mark.parametrize(('x', 'y'), CASES)
def test_lists_and_vectors(x: list[float], y: list[float]) -> None:
    register()
    case, zero = Two(x, y, 5), [0.0] * len(x)
    rows: Any = [[2.0] * len(x), [3.0] * len(x)]
    memory = np.array(rows)
    found = [packed(Two(zero, zero, 0)) for _ in range(2)]
    compiled(packed(case), memory, *found)
    for one, other in zip(found, results(case, rows)):
        for name, value in other._asdict().items():
            np.testing.assert_allclose(one[name], value, rtol=1e-15)
    np.testing.assert_array_equal(memory, rows)
    assert type(int(found[0].number)) is int
    assert found[0].dtype['number'] == np.int64

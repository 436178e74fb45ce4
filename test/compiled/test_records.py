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

"""Records in memory: types of fields, copies, views, and records in records."""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.compiled.compilable import record
from ctc_chattering.compiled.records import described, fill, load, packed, store, views
import numpy as np
from oracles import Array


@record
class InnerRecord(NamedTuple):
    x: Array
    flag: bool


@record
class OuterRecord(NamedTuple):
    inner: InnerRecord
    number: int
    size: float


def example(flag: bool = True) -> OuterRecord:
    return OuterRecord(InnerRecord(np.array([1.0, -2.0]), flag), 3, 0.5)


def test_each_field_keeps_its_type() -> None:
    loaded = load(packed(example()))
    assert loaded.inner.x.tolist() == [1.0, -2.0]
    assert [type(x) for x in (loaded.inner.flag, *loaded[1:])] == [bool, int, float]
    assert (loaded.inner.flag, *loaded[1:]) == (True, 3, 0.5)


def test_what_is_stored_or_filled_is_loaded_and_copies_stay() -> None:
    memory = packed(example())
    before = load(memory)
    store(memory, example(flag=False)._replace(size=7.0))
    assert (load(memory).inner.flag, load(memory).size) == (False, 7.0)
    fill(memory, described(example()._replace(number=9))[1])
    assert (load(memory).inner.flag, load(memory).number, load(memory).size) == (True, 9, 0.5)
    memory.inner.x[0] = 5.0
    assert before.inner.x[0] == 1.0


def test_views_show_what_is_in_memory() -> None:
    memory = packed(example())
    seen = views(memory)
    store(memory, example(flag=False)._replace(number=4))
    assert (bool(seen.inner.flag), int(seen.number)) == (False, 4)


def test_layouts_differ_by_type_and_shape_not_by_value() -> None:
    layout = described(example())[0]
    assert layout == described(example(flag=False))[0]
    longer = InnerRecord(np.zeros(3), True)
    assert layout != described(example()._replace(inner=longer))[0]

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

"""Joints of messages by name."""

from __future__ import annotations

from ctc_chattering.configuration.topics import select
from ctc_chattering.errors import RejectedMessage
from hypothesis import given
from hypothesis import strategies as st
import pytest

names_of = st.lists(st.text('abc', min_size=1, max_size=2), unique=True, max_size=6)


@given(names_of.filter(bool), names_of, st.data())
def test_any_names(ours: list[str], extra: list[str], data: st.DataObject) -> None:
    """Check against a dictionary, with subsets, supersets, and other orders."""
    theirs = data.draw(st.permutations([*ours, *(x for x in extra if x not in ours)]))
    values = {name: float(i) for i, name in enumerate(theirs)}
    rows = [list(values.values()), [-x for x in values.values()]]
    assert select(ours, tuple(theirs), *rows) == [
        tuple(values[name] for name in ours), tuple(-values[name] for name in ours)]
    if not set(ours) <= set(extra):
        with pytest.raises(RejectedMessage) as refusal:
            select(ours, tuple(extra), [0.0] * len(extra))
        assert refusal.value.kind == 'joints'


@pytest.mark.parametrize('names', [
    (), ('x',), ('x', 'z'), ('x', 'y', 'y'), ('x', 'y', 'z', 'z'), ('x', 'x'), ('X', 'Y')])
def test_joints_refused(names: tuple[str, ...]) -> None:
    """Check missing joints and any name that stands there twice."""
    with pytest.raises(RejectedMessage, match=r"needed: each of \['x', 'y'\] once") as refusal:
        select(('x', 'y'), names, [0.0] * len(names))
    assert refusal.value.kind == 'joints'


@pytest.mark.parametrize(('rows', 'kind'), [
    (([1.0, 2.0], [1.0]), 'length'), (([1.0, 2.0, 3.0],), 'length'), (([],), 'length'),
    (([1.0, float('nan')],), 'not_finite'), (([1.0, 2.0], [float('inf'), 0.0]), 'not_finite')])
def test_values_refused(rows: tuple[list[float], ...], kind: str) -> None:
    with pytest.raises(RejectedMessage) as refusal:
        select(('x', 'y'), ('y', 'x'), *rows)
    assert refusal.value.kind == kind


def test_a_value_that_is_not_ours_may_be_any() -> None:
    assert select(('y',), ('x', 'y'), [float('nan'), 5.0]) == [(5.0,)]

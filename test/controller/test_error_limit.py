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

"""The limit of the position error, against numpy's comparison."""

import math

from ctc_chattering.controller.trips import joint_beyond
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

ERROR = st.floats(-10.0, 10.0)
PAIRS = st.lists(st.tuples(ERROR, st.floats(1e-3, 10.0)), min_size=1, max_size=7)


@given(PAIRS)
def test_the_first_joint_beyond_its_own_limit(pairs: list[tuple[float, float]]) -> None:
    e, limit = (list(row) for row in zip(*pairs))
    beyond = np.flatnonzero(np.abs(e) > limit)
    assert joint_beyond(e, limit) == (beyond[0] if beyond.size else None)


@pytest.mark.parametrize('limit', [0.1, 3.0])
def test_the_bound_itself_is_allowed(limit: float) -> None:
    """Check ±limit on both sides of it, to the last bit; .inf allows everything."""
    for sign in (1.0, -1.0):
        assert joint_beyond([0.0, sign * limit], [limit, limit]) is None
        assert joint_beyond([0.0, sign * 1e300], [limit, math.inf]) is None
        assert joint_beyond([0.0, sign * math.nextafter(limit, 9.0)], [limit, limit]) == 1


@pytest.mark.parametrize('limit', [1.0, math.inf])
def test_no_number_is_within_no_limit(limit: float) -> None:
    assert joint_beyond([math.nan], [limit]) == 0

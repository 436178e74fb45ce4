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

"""The polynomials that meet given ends."""

from __future__ import annotations

from collections.abc import Callable

from ctc_chattering.numerics.interpolation import cubic, linear, quintic
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest
from scipy.interpolate import BPoly  # type: ignore[import-untyped]

KINDS: dict[int, Callable[..., tuple[float, float, float]]] = {1: linear, 2: cubic, 3: quintic}


@settings(max_examples=100)
@given(st.sampled_from([1, 2, 3]), st.lists(st.floats(-10.0, 10.0), min_size=6, max_size=6),
       st.floats(1e-3, 100.0), st.floats(0.0, 1.0))
def test_against_scipy(given_: int, ends: list[float], h: float, s: float) -> None:
    """Check value and both derivatives against the Bernstein polynomial of the same ends."""
    first, last = ends[:given_], ends[3:3 + given_]
    exact = BPoly.from_derivatives([0.0, h], [first, last])
    found = KINDS[given_](s, h, *first, *last)
    scale = 20.0 * (1.0 + h + h * h)
    for order, value in enumerate(found):
        wanted = float(exact(s * h, nu=order)) if order <= 2 * given_ - 1 else 0.0
        assert value == pytest.approx(wanted, rel=1e-9, abs=1e-12 * scale / h ** order)

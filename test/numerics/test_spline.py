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

"""A spline in pieces is the spline through all."""

from ctc_chattering.numerics.interpolation import interpolated
import numpy as np
import pytest
from scipy.interpolate import CubicSpline  # type: ignore[import-untyped]


@pytest.mark.parametrize('count', [4, 100, 30_000])
def test_pieces_are_the_whole(count: int) -> None:
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.5, 1.5, count))
    x = rng.normal(size=(count, 2))
    at = np.sort(rng.uniform(t[0], t[-1], count))
    assert interpolated(t, x, at) == pytest.approx(CubicSpline(t, x)(at), abs=1e-12)

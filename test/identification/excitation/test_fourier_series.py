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

"""Series that begin and end at rest."""

from __future__ import annotations

from ctc_chattering.identification.excitation.fourier_series import at_rest
import numpy as np


def test_series_are_at_rest_at_both_ends_and_derivatives_of_themselves() -> None:
    series = at_rest(8, 20.0)
    assert np.linalg.matrix_rank(np.hstack((series.cosines, series.sines))) == 13
    for rows in series.at(np.array([0.0, 20.0])):
        assert np.abs(rows).max() < 1e-9
    t = np.linspace(0.0, 20.0, 20001)
    q, dq, ddq = series.at(t)
    assert np.abs(np.gradient(q, t, axis=0)[1:-1] - dq[1:-1]).max() < 1e-4
    assert np.abs(np.gradient(dq, t, axis=0)[1:-1] - ddq[1:-1]).max() < 1e-4
    assert np.abs(q[:-1].mean(axis=0)).max() < 1e-9

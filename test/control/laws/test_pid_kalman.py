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

"""The gains of the Kalman filter against its covariance."""

from __future__ import annotations

from ctc_chattering.control.laws.pid_kalman import kalman_gains
from laws import check_windup
import numpy as np
import pytest


@pytest.mark.parametrize('bandwidth', [0.1, 2.0])
def test_the_kalman_gains_are_those_of_the_filter_after_many_samples(bandwidth: float) -> None:
    """Check against the covariance, sample by sample, from a large one on."""
    A = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    G, C = np.array([1.0 / 6.0, 0.5, 1.0]), np.array([1.0, 0.0, 0.0])
    variance = 1e3 * np.eye(3)
    for _ in range(400):
        gain = variance @ C / (C @ variance @ C + 1.0)
        variance = A @ (variance - np.outer(gain, C @ variance)) @ A.T + (
            bandwidth ** 6 * np.outer(G, G))
    np.testing.assert_allclose(kalman_gains(bandwidth), gain, rtol=1e-8)


def test_it_does_not_wind_up() -> None:
    check_windup('pid_kalman', estimator_bandwidth=300.0)

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

"""The limits of the torque, against numpy's clip, and the anti-windup correction."""

from ctc_chattering.control.evaluation import limiter
import numpy as np
from oracles import random_spd
import pytest


@pytest.mark.parametrize('effort', [[5.0, 9.0, np.inf], [np.inf] * 3])
@pytest.mark.parametrize('change', [[1.0, np.inf, 3.0], [np.inf] * 3])
def test_first_the_change_then_the_size(effort: list[float], change: list[float]) -> None:
    """Check a random walk: each torque near the one before, within the limits, and the rest."""
    rng, made = np.random.default_rng(1), limiter(np.array(effort), np.array(change), 0.0)
    before, saturated = np.zeros(3), 0
    for _ in range(200):
        wanted = before + 4.0 * rng.normal(size=3)
        tau = made.limit(wanted, before)
        size = np.minimum(effort, 1e300)
        near = np.clip(wanted, before - change, before + change)
        np.testing.assert_array_equal(tau, np.clip(near, -size, size))
        saturated += bool((tau != wanted).any())
        before = tau
    assert (saturated > 20) == bool(np.isfinite([*effort, *change]).any())


def test_correction_is_what_the_saturation_error_does_to_v() -> None:
    """Check b h M⁻¹ times the error, and that there is none without it or without anti-windup."""
    rng, none = np.random.default_rng(2), np.full(3, np.inf)
    mass, error = random_spd(rng, 3), rng.normal(size=3)
    made = limiter(np.ones(3), none, 1.3e-3)
    np.testing.assert_array_equal(made.correction(mass, np.zeros(3)), 0.0)
    np.testing.assert_allclose(mass @ made.correction(mass, error), 1.3e-3 * error, rtol=1e-9)
    np.testing.assert_array_equal(limiter(np.ones(3), none, 0.0).correction(mass, error), 0.0)

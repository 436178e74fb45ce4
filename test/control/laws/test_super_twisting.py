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

"""Super-twisting against its equations and a root finder."""

from __future__ import annotations

import math

from laws import (
    B,
    check_by_hand,
    error,
    FilterByHand,
    H,
    KP,
    KV,
    LAMBDA,
    rattles,
    run,
    Terms,
)
import numpy as np
from oracles import Array
import pytest
from scipy.optimize import brentq  # type: ignore[import-untyped]


@pytest.mark.parametrize('size', [1e-3, 0.3])
def test_super_twisting_by_hand(size: float) -> None:
    """
    Check τ = N - M a, a = k1 √|v⁺| sgn(v⁺) + w⁺, w⁺ - w ∈ h k2 Sgn(v⁺), with a root finder.

    v⁺ is the next v of (S) without a perturbation: y - b h a.
    """
    k1, k2 = np.array([20.0, 35.0]), np.array([400.0, 900.0])
    filter_, w, rests = FilterByHand(), np.zeros(2), 0

    def step(at: Terms) -> Array:
        nonlocal rests
        v = filter_.output(at)
        decay = math.exp(-LAMBDA * H)
        y = decay * v + B * (H - (1.0 - decay) / LAMBDA) * (KV @ at.de + KP @ at.e)
        a = np.zeros(2)
        for i in range(2):
            def gap(x: float, xi: float, i: int = i) -> float:
                return float(x + B * H * (k1[i] * math.sqrt(abs(x)) * np.sign(x) + w[i]
                                          + H * k2[i] * xi) - y[i])
            if gap(0.0, -1.0) <= 0.0 <= gap(0.0, 1.0):
                xi, ahead, rests = (y[i] / (B * H) - w[i]) / (H * k2[i]), 0.0, rests + 1
            else:
                xi = 1.0 if gap(0.0, 1.0) < 0.0 else -1.0
                root = brentq(lambda s: gap(s * abs(s), xi), -1e3, 1e3, xtol=1e-15, rtol=1e-15)
                ahead = root * abs(root)
            w[i] = w[i] + H * k2[i] * xi
            a[i] = k1[i] * math.sqrt(abs(ahead)) * np.sign(ahead) + w[i]
        filter_.advance(at)
        tau: Array = at.computed_torque - at.M @ a
        return tau

    check_by_hand('super_twisting', step, size, super_twisting_k1=k1.tolist(),
                  super_twisting_k2=k2.tolist())
    assert (rests > 20) == (size < 0.1)


def test_the_bound_of_the_inertia_from_both_sides() -> None:
    """Check that it is 2."""
    assert rattles('super_twisting', {'inertia_scale': 1.8}, {'inertia_scale': 2.2}, duration=1.5)


def test_the_error_under_friction_shrinks() -> None:
    found = error(run('super_twisting', 2.0))
    assert (found < 0.1 * error(run('compensation', 2.0))).all()

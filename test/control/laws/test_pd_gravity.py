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

"""PD with gravity against its equation written out in numpy."""

from __future__ import annotations

from laws import check_by_hand, KP, KV, rattles, Terms
import numpy as np
from oracles import Array, paper_m


def test_pd_gravity_by_hand() -> None:
    """Check diag(D) (Kp e + Kv de) + G, 1 / D the diagonal of M⁻¹."""
    def step(at: Terms) -> Array:
        inertia = np.diag(1.0 / np.diag(np.linalg.inv(at.M)))
        tau: Array = inertia @ (KP @ at.e + KV @ at.de) + at.G
        return tau

    check_by_hand('pd_gravity', step)


def test_the_bound_of_kv_from_both_sides() -> None:
    """Check h Kv λ < 2, with λ = 1.33 the largest eigenvalue of M⁻¹ diag(D)."""
    inverse = np.linalg.inv(paper_m([np.pi, np.pi / 2]))
    eigenvalue = float(np.linalg.eigvals(inverse / np.diag(inverse)).max())
    assert rattles(
        'pd_gravity', {'kv': 1900.0 / eigenvalue}, {'kv': 2100.0 / eigenvalue},
        duration=1.5, amplitude=0.0, offset=0.05, friction=0.0)

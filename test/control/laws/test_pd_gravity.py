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

"""PD with gravity."""

from laws import check_by_hand, error, KP, KV, rattles, run, Terms
import numpy as np
from oracles import Array, paper_m


def test_by_hand() -> None:
    """Check diag(D) (Kp e + Kv de) + G, 1 / D the diagonal of M⁻¹."""
    def step(at: Terms) -> Array:
        inertia = np.diag(1.0 / np.diag(np.linalg.inv(at.M)))
        tau: Array = inertia @ (KP @ at.e + KV @ at.de) + at.G
        return tau

    check_by_hand('pd_gravity', step)


def test_a_position_is_held_as_friction_lets_it() -> None:
    """Check that an offset is gone without friction, and with it within Kf / (D Kp)."""
    free = error(run('pd_gravity', 6.0, 0.0, 0.1, 0.0))
    assert (free < 1e-5).all()
    held = run('pd_gravity', 8.0, 9.9, 0.4, 0.0)
    inertia = 1.0 / np.diag(np.linalg.inv(paper_m(held.q[-1].tolist())))
    assert (error(held) < 9.91 / (inertia * 100.0)).all()
    assert (error(held) > 1e-4).any()


def test_too_large_a_gain_rattles() -> None:
    """Check that h Kv times the largest eigenvalue of M⁻¹ diag(D), 1.33, must be below 2."""
    inverse = np.linalg.inv(paper_m([np.pi, np.pi / 2]))
    most = 2e3 / np.linalg.eigvals(inverse / np.diag(inverse)).max()
    assert rattles('pd_gravity', {'kv': [0.95 * most] * 2}, {'kv': [1.05 * most] * 2},
                   amplitude=0.0, offset=0.05, friction=0.0)

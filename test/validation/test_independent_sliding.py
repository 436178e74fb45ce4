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

"""The law that docs/paper.md tries: what its equations say, and its two limits."""

from __future__ import annotations

from independent_laws import Gains, Known, ObserverFeedback, Point
from independent_sliding import Sliding
import numpy as np
import pytest


def played(law: ObserverFeedback, rng: np.random.Generator) -> list[list[float]]:
    """Return the commands of a few samples near a reference at rest."""
    at = np.array([0.3, 0.0])
    point = Point(at, np.zeros(2), np.zeros(2))
    return [law.step(at + 1e-3 * rng.normal(size=2), np.zeros(2), [point] * 2).tolist()
            for _ in range(6)]


def test_without_a_horizon_it_is_observer_feedback() -> None:
    """Within the box; a wide one."""
    known, gains = Known(), Gains(ka=(1e6, 1e6))
    expected, found, other = (played(law, np.random.default_rng(3)) for law in (
        ObserverFeedback(known, gains), Sliding(known, gains, np.inf), Sliding(known, gains, 0.1)))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    assert np.abs(np.array(other) - expected).max() > 0.1


@pytest.mark.parametrize('horizon', [1e-3, 1e-2, 1.0])
def test_z_is_ka_sgn_of_v_after_the_horizon(horizon: float) -> None:
    """Also, v̂ is not longer than y in the metric of M: q2 = 0, where C = 0."""
    rng, sides = np.random.default_rng(24), set()
    for _ in range(60):
        law = Sliding(Known(), Gains(ka=(6.0, 3.0)), horizon)
        q, dq, P = rng.normal(size=(3, 2)) * [[1.0], [0.1], [1.5]]
        q[1] = 0.0
        M, bias = law.known.model(q, dq)
        seen = law.corrected(q, dq)._replace(P=P)
        law.wanted(seen, M, bias, Point(q, 0.0 * q, 0.0 * q), (0.0 * q, 0.0 * q))
        (v, z), y = law.ahead_of, law.nominal
        for v_i, z_i, ka in zip(v, z, law.Ka):
            sides.add(abs(v_i) > 1e-9)
            assert abs(z_i) <= ka and (abs(v_i) <= 1e-9 or z_i == ka * np.sign(v_i))
        if (np.abs(P) <= law.Ka).all():
            assert v @ M @ v <= (1.0 + 1e-9) * (y @ M @ y)
    assert True in sides and (False in sides or horizon < 1e-2)

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

"""Law (6) on the state that `observer_feedback` observes, by hand: see docs/paper.md."""

from __future__ import annotations

from independent_laws import Array, Gains, Known, nearest, ObserverFeedback, Point, Seen
import numpy as np


class Sliding(ObserverFeedback):
    """
    Law (6) for drives and encoders as they are.

    z ∈ Ka Sgn(v̂), v̂ = y - H M⁻¹ (C v + z + P̂ + F): v after a step of H, as it is estimated, and
    b = 1.
    """

    def __init__(self, known: Known, gains: Gains, horizon: float, pole: float = 10.0) -> None:
        super().__init__(known, gains)
        h = known.period
        self.horizon, self.pole, self.decay = horizon, pole, np.exp(-pole * h)
        self.gain = (1.0 - self.decay) / pole
        #: ξ of the filter (3) at the arrival, and after every further period.
        self.xi = [np.zeros(2)]
        #: v̂ and z of the last evaluation, and y.
        self.ahead_of: tuple[Array, Array] = np.zeros(2), np.zeros(2)
        self.nominal: Array = np.zeros(2)

    def step(self, q: Array, dq: Array, points: list[Point]) -> Array:
        """Return the command, and advance the filter."""
        sent = super().step(q, dq, points)
        self.xi = [self.xi[1]]
        return sent

    def relief(self) -> Array:
        """Return the divisor of (FR5), with what z adds to Kv."""
        return super().relief() + 1.0 / self.horizon

    def wanted(self, at: Seen, M: Array, bias: Array, point: Point, x: tuple[Array, Array]
               ) -> Array:
        """Return τ* of law (6)."""
        h, C = self.known.period, self.known.matrices(at.q, at.dq)[1]
        de = point.dq + x[1] - at.dq
        u = self.gains.kv * de + self.gains.kp * (point.q + x[0] - at.q)
        v = self.xi[-1] - de
        y = self.nominal = self.decay * v + (h - self.gain) * u
        self.xi.append(self.decay * self.xi[-1] + self.gain * (self.pole * de - u))
        load = C @ v + at.P + self.friction(point, 0.0)
        z = nearest(M, M @ y / self.horizon - load, self.Ka)
        if np.isfinite(self.horizon):
            self.ahead_of = y - self.horizon * np.linalg.solve(M, z + load), z
        torque: Array = M @ (point.ddq + self.back(M, x) + u) + bias - C @ v - z
        return torque

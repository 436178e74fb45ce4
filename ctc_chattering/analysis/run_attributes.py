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


"""The samples of a run as attributes of its result."""

from __future__ import annotations

from ctc_chattering.simulation.closed_loop import Array, Run


class RunAttributes:
    """Base of what has a `Run`: its arrays, without `run` in front."""

    run: Run

    @property
    def t(self) -> Array:
        """Return the time, shape (N,) [s]."""
        return self.run.t

    @property
    def q(self) -> Array:
        """Return the position, shape (N, n) [rad]."""
        return self.run.q

    @property
    def dq(self) -> Array:
        """Return the velocity, shape (N, n) [rad/s]."""
        return self.run.dq

    @property
    def q_d(self) -> Array:
        """Return the desired position, shape (N, n) [rad]."""
        return self.run.q_d

    @property
    def dq_d(self) -> Array:
        """Return the desired velocity, shape (N, n) [rad/s]."""
        return self.run.dq_d

    @property
    def ddq_d(self) -> Array:
        """Return the desired acceleration, shape (N, n) [rad/s²]."""
        return self.run.ddq_d

    @property
    def e(self) -> Array:
        """Return the position error q_d - q [rad], shape: (N, n)."""
        return self.run.e

    @property
    def de(self) -> Array:
        """Return the velocity error dq_d - dq [rad/s], shape: (N, n)."""
        return self.run.de

    @property
    def tau(self) -> Array:
        """Return the torque sent at the sample, shape (N, n) [N·m]; nan where it is unknown."""
        return self.run.tau

    @property
    def v(self) -> Array:
        """Return the filtered error of equation (3), shape (N, n) [rad/s]."""
        return self.run.v

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

"""
Torque under which a person moves an arm by hand.

`ControlLoop` sends it while the arm is guided. It carries the arm's weight and a part of its
friction, damps the motion, and keeps it off the joint limits:

    τ = G(q) + s F tanh(dq / v_F) - D (d dq + w (|dq| - v)₊ sgn(dq) + w² p + 2 w σ dq)

This is (HG1). D is the diagonal of M(q), so that the rates d and w act alike on a large joint and
a small one. F is `friction_level`, v_F is `friction_velocity`. With a share s below 1 the friction
that is left holds the arm where the model of its weight is wrong. p is the depth within a margin
of a position limit, and σ = min(|p| / p₀, 1) lets its damping begin without a step. v is the
speed from which on the damping is strong.
"""

from __future__ import annotations

import dataclasses

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.numerics.time_grid import seconds
import numpy as np


@dataclasses.dataclass(frozen=True)
class GuidingRates:
    """Constants of (HG1)."""

    #: s, below 1: the drive must not push the arm by itself.
    friction_share: float = 0.7
    #: d [1/s].
    damping: float = 1.0
    #: w, at walls and above the speed limit [1/s]. A wall stops 0.5 rad/s within 0.05 rad.
    wall: float = 10.0
    #: Depth of a wall before a position limit [rad or m].
    margin: float = 0.1
    #: p₀ [rad or m].
    damped: float = 0.02
    #: v [rad/s or m/s].
    speed: float = 1.0


_RATES = GuidingRates()


class HandGuiding:
    """
    The torque (HG1) of an arm, within the limits of its drives.

    Parameters
    ----------
    config : ControllerConfig
    model : Model
    period : int
        Control period [ns].

    Attributes
    ----------
    config : ControllerConfig
        As given.

    """

    def __init__(self, config: ControllerConfig, model: Model, period: int) -> None:
        self.config = config
        self._friction = _RATES.friction_share * np.array(config.friction_level)
        self._friction_velocity = config.friction_velocity
        self._lower, self._upper = np.array(config.position_limits(model)).T
        self._effort = np.array(config.largest_torque(model.effort_limits))
        self._step = seconds(period) * np.array(config.effort_rate_limit)

    def torque(self, model: Model, q: Vector, dq: Vector, held: Vector) -> list[float]:
        """
        Return the torque to send, shape (n,) [N·m].

        Parameters
        ----------
        model : Model
            The present one, whose payload may have changed.
        q, dq : sequence of float, shape (n,)
            Position [rad] and velocity [rad/s].
        held : sequence of float, shape (n,)
            Torque sent last [N·m].

        """
        rates = _RATES
        position, velocity = np.array(q), np.array(dq)
        inertia = np.diag(np.array(model.mass_matrix(q)))
        depth = self._wall_depth(position)
        excess = np.maximum(np.abs(velocity) - rates.speed, 0.0)
        braking = rates.damping * velocity + rates.wall * excess * np.sign(velocity)
        damped = np.minimum(np.abs(depth) / rates.damped, 1.0)
        braking += rates.wall ** 2 * depth + 2.0 * rates.wall * damped * velocity
        friction = self._friction * np.tanh(velocity / self._friction_velocity)
        tau = np.array(model.gravity_torque(q)) + friction - inertia * braking
        tau = np.clip(tau, -self._effort, self._effort)
        last = np.array(held)
        values: list[float] = np.clip(tau, last - self._step, last + self._step).tolist()
        return values

    def _wall_depth(self, q: Array) -> Array:
        """Return the signed depth within the walls [rad]."""
        above: Array = np.maximum(q - (self._upper - _RATES.margin), 0.0)
        below: Array = np.maximum(self._lower + _RATES.margin - q, 0.0)
        return above - below

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

"""What a motion is good for, foretold with the model: torques, and joints that stick."""

from __future__ import annotations

import dataclasses

from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.excitation.best_motion import Quintics
from ctc_chattering.identification.excitation.margins import AssumedFriction
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
import numpy as np

#: Step in which a motion is evaluated for what is reported [s].
_FINE = 0.01
#: Part of the amplitude of the slow reversals within which friction may hold a joint.
_STICKING = 0.2
#: Largest product of the velocity gain with control period and delay.
_GAIN = 0.1


@dataclasses.dataclass(frozen=True)
class Played:
    """
    A motion as it is played, with its torques.

    Attributes
    ----------
    t : ndarray, shape (N,)
        Time [s].
    q, dq, ddq : ndarray, shape (N, n)
        Position [rad], velocity [rad/s] and acceleration [rad/s²].
    inertial, gravity, tau : ndarray, shape (N, n)
        M ddq + C dq; G; both with friction [N·m].

    """

    t: Array
    q: Array
    dq: Array
    ddq: Array
    inertial: Array
    gravity: Array
    tau: Array

    @property
    def peak_torque(self) -> Array:
        """Largest torque of each joint, shape (n,) [N·m]."""
        peak: Array = np.abs(self.tau).max(axis=0)
        return peak


def played(path: Quintics, model: Model, friction: AssumedFriction, step: float = _FINE
           ) -> Played:
    """
    Return a motion through waypoints with its torques.

    Parameters
    ----------
    path : Quintics
        The waypoints, in the order of the model's joints.
    model : Model
        Gives the torques.
    friction : AssumedFriction
        At rest, Coulomb friction acts with the rest of the torque.
    step : float
        Time between two samples [s].

    """
    t = np.arange(round(path.times[-1] / NANOSECONDS / step) + 1) * step
    q, dq, ddq = path.at(t)
    gravity = np.array([model.gravity_torque(row) for row in q.tolist()])
    inertial = np.array([model.inverse_dynamics(*point) for point in zip(
        q.tolist(), dq.tolist(), ddq.tolist())]) - gravity
    return Played(t, q, dq, ddq, inertial, gravity,
                  friction.added(inertial + gravity, dq))


def sticking(model: Model, positions: Array, kp: Array, friction: AssumedFriction) -> Array:
    """
    Return how far friction can hold each joint from the motion under computed torque, (n,) [rad].

    All joints stick while the law's torque M Kp e is within ±Kf: |e| ≤ |Kp⁻¹ M⁻¹| Kf.

    Parameters
    ----------
    model : Model
        Gives M.
    positions : ndarray, shape (m, n)
        Where to evaluate it; the largest distance is returned.
    kp : ndarray, shape (n,)
        Position gains [1/s²].
    friction : AssumedFriction
        Its Coulomb friction counts.

    """
    inverse = np.array([np.linalg.inv(np.array(model.mass_matrix(q.tolist())))
                        for q in positions])
    distance: Array = (np.abs(inverse) @ friction.coulomb).max(axis=0) / kp
    return distance


def gains(kp: Array, kv: Array, hold: Array, slow: Array, delay: float) -> tuple[Array, Array]:
    """
    Return gains with which friction takes little of the slow reversals, as far as they may rise.

    Parameters
    ----------
    kp, kv : ndarray, shape (n,)
        Gains [1/s², 1/s]; they are never lowered.
    hold : ndarray, shape (n,)
        What `sticking` returns for them [rad].
    slow : ndarray, shape (n,)
        Amplitude of the reversals [rad].
    delay : float
        Control period and input delay [s].

    """
    most = (0.5 * _GAIN / delay) ** 2
    wanted = np.ceil(np.minimum(kp * hold / (_STICKING * slow), most))
    higher = np.where(hold > _STICKING * slow, np.maximum(kp, wanted), kp)
    return higher, np.where(higher > kp, np.maximum(kv, np.ceil(2.0 * np.sqrt(higher))), kv)

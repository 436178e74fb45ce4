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
What a motion tells of friction and inertial parameters, foretold with the model.

The regression is the one that identification solves, for all joints at once::

    tau = Y(q, dq, ddq) theta + friction of each joint: forwards, backwards, viscous

with the base parameters theta of the bodies (Gautier & Khalil, "Direct calculation of minimum set
of inertial parameters of serial robots", 1990), the columns that are independent of each other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf, isfinite
from typing import NamedTuple

from ctc_chattering.dynamics.linear_model import LinearModel
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.excitation.motion import Bounds
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.linalg import qr  # type: ignore[import-untyped]

#: Part of the velocity bound below which a joint counts as at rest: it may stick.
_MOVES = 0.01
#: Random states of which the independent columns are found, and the least part of one that is.
_STATES, _INDEPENDENT = 200, 1e-7

#: Columns of the model's parameters at N states, shape (N, n, p).
Columns = Callable[[Array, Array, Array], Array]


class Information(NamedTuple):
    """
    Information of a motion about p numbers.

    Attributes
    ----------
    matrix : ndarray, shape (p, p)
        The sum of Xᵀ X over the samples; friction forwards of each joint, backwards, viscous, then
        base parameters.
    joints : int
        Number n of joints.

    """

    matrix: Array
    joints: int

    @property
    def condition(self) -> float:
        """Return the condition number of X with columns scaled to length 1."""
        length = np.sqrt(self.matrix.diagonal())
        if not (length > 0.0).all():
            return inf
        values = np.linalg.eigvalsh(self.matrix / np.outer(length, length))
        return float(np.sqrt(values[-1] / values[0])) if values[0] > 0.0 else inf

    def inflation(self) -> Array:
        """Return by how much each interval is wider than with all else known, shape (p,)."""
        found: Array = np.sqrt(self.matrix.diagonal() * self._variance())
        return found

    def _variance(self) -> Array:
        """Return the variances of the numbers, shape (p,)."""
        return np.asarray(np.linalg.pinv(self.matrix, rcond=1e-13, hermitian=True).diagonal())

    def merit(self, only: Sequence[int] = ()) -> float:
        """
        Return what a motion is chosen by, -inf where it does not show all.

        That is the logarithm of the determinant by parameter, less twice that of the condition
        number; with `only` some joints, less that of the variances of their friction.
        """
        condition = self.condition
        if not isfinite(condition):
            return -inf
        if only:
            mine = [k for k in range(3 * self.joints) if k % self.joints in only]
            return -float(np.log(self._variance()[mine]).mean())
        return float(np.linalg.slogdet(self.matrix)[1] / len(self.matrix)
                     - 2.0 * np.log(condition))


class Regression:
    """
    Columns of friction and model, weighted.

    Parameters
    ----------
    model : Model
        Of the robot.
    bounds : Bounds
        What motions keep.
    noise : ndarray, shape (n,)
        Standard deviation of each joint's torque, of any common scale.

    Attributes
    ----------
    n, parameters : int
        Number of joints, and of base parameters.

    """

    def __init__(self, model: Model, bounds: Bounds, noise: Array) -> None:
        self.n = len(bounds.center)
        self._columns = _columns_of(model)
        self._bounds, self._weight = bounds, 1.0 / noise
        rng = np.random.default_rng(0)
        states = rng.uniform(-1.0, 1.0, (_STATES, 3, self.n)) * np.array([
            bounds.room, bounds.velocity, bounds.acceleration])
        states[:, 0] += bounds.center
        rows = np.concatenate(
            self._columns(*states.transpose(1, 0, 2)) * self._weight[:, np.newaxis])
        length = np.linalg.norm(rows, axis=0)
        seen = np.flatnonzero(length > 1e-9 * length.max())
        r, order = qr(rows[:, seen] / length[seen], mode='r', pivoting=True)
        size = np.abs(r.diagonal())
        self._base = np.sort(seen[order[:len(size)][size > _INDEPENDENT * size[0]]])
        self.parameters = len(self._base)

    def of(self, motion: Array, time: Array) -> Information:
        """
        Return the information of a motion.

        Parameters
        ----------
        motion : ndarray, shape (3, N, n)
            Samples of position, velocity and acceleration.
        time : ndarray, shape (N,)
            For which each stands [s].

        """
        n, dq = self.n, motion[1]
        x = np.zeros((len(dq), n, 3 * n + self.parameters))
        joint = np.arange(n)
        x[:, joint, joint] = dq > 0.0
        x[:, joint, n + joint] = dq < 0.0
        x[:, joint, 2 * n + joint] = dq
        x[:, :, 3 * n:] = self.columns(motion)
        x *= self._scale(dq, time)[:, :, np.newaxis]
        rows = x.reshape(-1, x.shape[2])
        return Information(rows.T @ rows, n)

    def _scale(self, dq: Array, time: Array) -> Array:
        """Return the weight of each row, 0 where a joint may stick, shape (N, n)."""
        moves = np.abs(dq) > _MOVES * self._bounds.velocity
        return np.asarray(moves * self._weight * np.sqrt(time)[:, np.newaxis])

    def columns(self, motion: Array) -> Array:
        """Return the columns of the base parameters for states of shape (3, N, n), (N, n, p)."""
        return np.asarray(self._columns(*motion)[:, :, self._base])


def _columns_of(model: Model) -> Columns:
    """Return the function that has the columns of a model."""
    def one(q: Array, dq: Array, ddq: Array) -> Array:
        if isinstance(model, LinearModel):
            return model.torque_regressor(q, dq, ddq, np.array([0.0, 0.0, -model.gravity]))
        return _parts(model, q, dq, ddq)
    return lambda q, dq, ddq: np.array([one(*state) for state in zip(q, dq, ddq)])


def _parts(model: Model, q: Array, dq: Array, ddq: Array) -> Array:
    """Return the inertial torque and the weight of each joint, of a model of the user's."""
    gravity = np.array(model.gravity_torque(q.tolist()))
    inertial = np.array(model.inverse_dynamics(q.tolist(), dq.tolist(), ddq.tolist())) - gravity
    return np.hstack((np.diag(inertial), np.diag(gravity)))

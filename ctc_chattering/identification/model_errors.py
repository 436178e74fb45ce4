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
Columns for all that a model may have wrong: what is linear in its parameters.

The parameters x are the model's own inertial ones, the inertia of a rotor at each joint, which no
URDF has, and the vector of gravity. In (WF1) a parameter has the weak torque of its regressor:
that of the momentum is the regressor of a torque at rest with dq for an acceleration, and with
T = ½ dqᵀ M dq

    Cᵀ dq = ∂T/∂q = (dM/dt) dq - C dq,                                                    (EC1)

where dM/dt is the derivative along the motion, by a central difference. Many parameters have no
torque of their own: the columns are those of an orthogonal basis of what any motion can show.
"""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from functools import cached_property
from typing import NamedTuple

from ctc_chattering.bags.recording import Indices
from ctc_chattering.dynamics.corrected_urdf import with_payload
from ctc_chattering.dynamics.model import LinearModel, Model, rotors
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Longest step of the grid on which regressors are evaluated [s].
_GRID = 0.004
#: Step in time of the central difference [s].
_STEP = 1e-4
#: Random states in which the basis is looked for, and the singular value that is rounding.
_STATES, _RANK = 60, 1e-7
#: A rotor that is a tenth of the joint's inertia, and a tilt of about six degrees.
_ROTOR, _TILT = 0.1, 0.1


@dataclasses.dataclass(frozen=True)
class ErrorColumns:
    """
    A basis of a model's errors; p inertial parameters, n joints, m columns.

    Attributes
    ----------
    model : LinearModel
        To be corrected.
    gravity : ndarray, shape (3,)
        About which torques are linear [m/s²].
    sizes : ndarray, shape (p + n + 3,)
        How large errors are roughly.
    basis : ndarray, shape (p + n + 3, m)
        Orthonormal columns, in errors over `sizes`.

    """

    model: LinearModel
    gravity: Array
    sizes: Array
    basis: Array

    @classmethod
    def of(cls, model: Model, gravity: Array | None = None) -> ErrorColumns | None:
        """Return the columns of a model; None if it offers no regressor that holds for it."""
        if not isinstance(model, LinearModel):
            return None
        n, own = model.n, model.inertial_parameters()
        gravity = np.array([0.0, 0.0, -model.gravity]) if gravity is None else gravity
        rng = np.random.default_rng(0)
        states = rng.normal(size=(_STATES, 3, n))
        down = np.array([0.0, 0.0, -model.gravity])
        for q, dq, ddq in states[:3]:
            wanted = model.inverse_dynamics(q.tolist(), dq.tolist(), ddq.tolist())
            made = model.torque_regressor(q, dq, ddq, down) @ own + rotors(model) * ddq
            if not np.allclose(made, wanted, rtol=1e-6, atol=1e-9):
                return None
        inertia = np.mean([model.evaluate(q, dq)[0].diagonal() for q, dq, _ in states], axis=0)
        sizes = np.concatenate((model.parameter_sizes(), _ROTOR * inertia,
                                np.full(3, _TILT * np.linalg.norm(gravity) or 1.0)))
        found = cls(model, gravity, sizes, np.eye(len(sizes)))
        rows = np.concatenate([found._torque(*state) for state in states]) * sizes
        lengths = np.sqrt(np.square(rows.reshape(_STATES, n, -1)).mean(axis=(0, 2)))
        rows /= np.tile(np.where(lengths > 0.0, lengths, 1.0), _STATES)[:, None]
        _, s, v = np.linalg.svd(rows, full_matrices=False)
        return dataclasses.replace(found, basis=v[s > _RANK * s[0]].T)

    @property
    def prior(self) -> Array:
        """Return the parameters of the model, shape (p + n + 3,)."""
        down = np.array([0.0, 0.0, -self.model.gravity])
        return np.concatenate((self.model.inertial_parameters(), rotors(self.model), down))

    @property
    def count(self) -> int:
        """Return the number p of inertial parameters."""
        return len(self.sizes) - self.model.n - 3

    @cached_property
    def directions(self) -> Array:
        """Return orthonormal directions of gravity that have a torque in some pose, (3, k)."""
        rng = np.random.default_rng(2)
        rows = np.concatenate([self.model.gravity_map(q)
                               for q in rng.normal(size=(_STATES, self.model.n))])
        _, s, v = np.linalg.svd(rows)
        return np.asarray(v[:int((s > _RANK * s[0]).sum())].T)

    def coordinates(self, x: Array) -> Array:
        """Return errors x, shape (p + n + 3, ...), as coefficients of the columns."""
        return np.asarray(self.basis.T @ (x.T / self.sizes).T)

    def weak(self, place: Array, dq: Array, moved: Array, phi: TestFunction,
             centres: Indices) -> Array:
        """
        Return the weak torque of each column, shape (J, n, m).

        Parameters
        ----------
        place, dq, moved : ndarray, shape (N, n)
            Smoothed positions and velocities, and velocities as differences of positions.
        phi : TestFunction
            φ.
        centres : ndarray, shape (J,)
            Of the windows.

        """
        n, p = self.model.n, self.count
        step = max(1, int(_GRID / phi.period))
        grid = np.arange(0, len(place), step)
        # Some may be between windows.
        grid = grid[(np.abs(grid - centres[:, None]) < phi.half).any(axis=0)]
        momentum, rest = np.empty((2, len(grid), n, p))
        pull = np.empty((len(grid), n, 3))
        for k, sample in enumerate(grid):
            momentum[k], rest[k], pull[k] = self._terms(place[sample], dq[sample])
        at, slope = phi.weights(grid - centres[:, None], step)
        found = np.zeros((len(centres), n, len(self.sizes)))
        found[:, :, :p] = (np.tensordot(at, rest, 1) - np.tensordot(slope, momentum, 1))
        own = np.arange(n)
        found[:, own, p + own] = -phi.sums(moved, phi.slope, centres)
        found[:, :, p + n:] = np.tensordot(at, pull, 1)
        return (found * self.sizes) @ self.basis

    def _terms(self, q: Array, dq: Array) -> tuple[Array, Array, Array]:
        """Return the regressors of the momentum, of G - Cᵀ dq (EC1), and that of gravity."""
        regressor, still, none = self.model.torque_regressor, np.zeros_like(q), np.zeros(3)
        later, before = (regressor(q + sign * _STEP * dq, still, dq, none) for sign in (1.0, -1.0))
        rest = regressor(q, dq, still, self.gravity) - (later - before) / (2.0 * _STEP)
        return regressor(q, still, dq, none), rest, self.model.gravity_map(q)

    def at(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the torque of each column in a state, shape (n, m)."""
        return (self._torque(q, dq, ddq) * self.sizes) @ self.basis

    def _torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the derivative of the inverse dynamics by x, shape (n, p + n + 3)."""
        return np.concatenate((self.model.torque_regressor(q, dq, ddq, self.gravity),
                               np.diag(ddq), self.model.gravity_map(q)), axis=1)


class ModelError(NamedTuple):
    """
    A possible error of a model.

    Attributes
    ----------
    name : str
        Link, or `payload`.
    unit : str
        Of the coefficient: '' for a part of the link's mass, kg for a payload.
    change : ndarray, shape (p,)
        Of the model's inertial parameters for a coefficient of 1.

    """

    name: str
    unit: str
    change: Array


def candidates(model: Model, description: str = '',
               locked: Mapping[str, float] | None = None) -> list[ModelError]:
    """
    Return the errors of a model that are looked for: each link's mass, and a payload at the tip.

    Parameters
    ----------
    model : Model
        One of a URDF; of others no link is known.
    description : str
        Text of the URDF.
    locked : mapping of str to float, optional
        As the model has it.

    """
    if not (isinstance(model, UrdfModel) and description):
        return []
    tree, joints, own = Tree(description), model.joint_names, model.inertial_parameters()
    found = []
    for i, joint in enumerate(joints):
        if own[10 * i] > 0.0:
            mine = np.arange(len(own)) // 10 == i
            found.append(ModelError(tree.ends[joint][1], '', np.where(mine, own, 0.0)))
    outwards = [name for name in tree.ends if name in joints]
    loaded = UrdfModel(with_payload(description, outwards, 1.0), joints, model.gravity, locked)
    return [*found, ModelError('payload', 'kg', loaded.inertial_parameters() - own)]

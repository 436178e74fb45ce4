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

from collections.abc import Mapping, Sequence
import dataclasses
from enum import Enum
from typing import NamedTuple

from ctc_chattering.bags.recording import Indices
from ctc_chattering.dynamics.corrected_urdf import with_payload
from ctc_chattering.dynamics.model import LinearModel, Model, rotors
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

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

    def across(self) -> Array:
        """
        Return the direction across which gravity has no torque, shape (3,).

        It is that across the plane of an arm whose joints all turn about it; empty for others,
        and where gravity goes along it.
        """
        rng, down = np.random.default_rng(2), self.prior[-3:]
        rows = np.concatenate([self.model.gravity_map(q)
                               for q in rng.normal(size=(_STATES, self.model.n))])
        _, s, v = np.linalg.svd(rows)
        shown = int((s > _RANK * s[0]).sum())
        inside = down - v[2] * (v[2] @ down)
        planar = shown == 2 and np.linalg.norm(inside) > _TILT * np.linalg.norm(down)
        return v[2] if planar else np.zeros(0)

    def coordinates(self, x: Array) -> Array:
        """Return errors x, shape (p + n + 3, ...), as coefficients of the columns."""
        found: Array = self.basis.T @ (x.T / self.sizes).T
        return found

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
        The two-link arm, or one of a URDF; of others no link is known.
    description : str
        Text of the URDF.
    locked : mapping of str to float, optional
        As the model has it.

    """
    if isinstance(model, TwoLink):
        return _two_link()
    if not (isinstance(model, UrdfModel) and description):
        return []
    tree, joints, own = Tree(description), model.joint_names, model.inertial_parameters()
    found = []
    for i, joint in enumerate(joints):
        if own[10 * i] > 0.0:
            mine = np.arange(len(own)) // 10 == i
            found.append(ModelError(_heaviest(tree, joint, joints), '', np.where(mine, own, 0.0)))
    outwards = [name for name in tree.ends if name in joints]
    loaded = UrdfModel(with_payload(description, outwards, 1.0), joints, model.gravity, locked)
    return [*found, ModelError('payload', 'kg', loaded.inertial_parameters() - own)]


def _two_link() -> list[ModelError]:
    """
    Return the errors of the paper's arm.

    Its numbers do not say how the mass is shared. Link 2 is taken as a uniform rod: from its first
    moment 0.63 kg m and its moment of inertia 0.62 kg m² follow its length b and its mass; it
    hangs at the end of link 1, of length a.
    """
    a, b = 0.51 / 0.63, 1.5 * 0.62 / 0.63
    mass = 0.63 / (0.5 * b)
    second = np.array((mass * a * a + 0.62, 0.76, 0.62, 0.51, mass * a, 0.63))
    first = np.array((8.77 - second[0], 0.0, 0.0, 0.0, 7.6 - second[4], 0.0))
    return [ModelError('link 1', '', first), ModelError('link 2', '', second),
            ModelError('payload', 'kg', np.array((a * a + b * b, b * b, b * b, a * b, a, b)))]


def _heaviest(tree: Tree, joint: str, joints: Sequence[str]) -> str:
    """Return the heaviest of the links that move with the one that a joint carries."""
    body = [tree.ends[joint][1]]
    for name, (parent, child) in tree.ends.items():
        if parent in body and name not in joints:
            body.append(child)

    def mass(link: str) -> float:
        element = tree.links[link].find('inertial/mass')
        return 0.0 if element is None else float(element.get('value', '0'))
    return max(body, key=mass)


#: In place of an index: of all joints, or all masses.
ALL = -1
#: Part of the size of a number by which it is changed for a derivative.
_PART_OF_SIZE = 1e-3
#: Part of the largest of its columns below which one is rounding.
_ROUNDING = 1e-9


class CauseKind(Enum):
    """What a cause is."""

    SCALE = 'torque scale'
    DEAD_BAND = 'dead band'
    FADING = 'fading torque'
    MASSES = 'all masses'
    GRAVITY = 'direction of gravity'
    ROTOR = 'rotor inertia'
    LINK = 'mass'
    CENTRE = 'centre of mass'
    BODY = 'mass, centre and inertia'


#: What a drive makes of its command: columns beside those of the model's errors.
DRIVE = (CauseKind.SCALE, CauseKind.DEAD_BAND, CauseKind.FADING)
#: Those that change inertias of links, as rotors do.
BODIES = (CauseKind.LINK, CauseKind.MASSES, CauseKind.CENTRE, CauseKind.BODY)


class Cause(NamedTuple):
    """
    A cause.

    Attributes
    ----------
    kind : CauseKind
        What it is.
    which : int
        Joint, body or candidate; `ALL` for all.
    size : ndarray, shape (k,)
        How large its numbers are roughly.
    direction : ndarray, shape (p + n + 3,) or (3,)
        x of a candidate for 1; across a planar arm, for the gravity there; empty for others.

    """

    kind: CauseKind
    which: int
    size: Array
    direction: Array = np.zeros(0)

    def contains(self, other: Cause) -> bool:
        """Return whether it has all of another cause, and so explains at least as much."""
        if self.kind == CauseKind.BODY:
            return other.kind in (CauseKind.CENTRE, CauseKind.LINK) and self.which == other.which
        return self.kind == other.kind and self.which == ALL != other.which and (
            len(self.size) > len(other.size))

    def errors(self, columns: ErrorColumns, value: Array) -> Array:
        """Return x for these numbers, shape (p + n + 3,)."""
        x = np.zeros(len(columns.sizes))
        p, i = columns.count, self.which
        body = slice(10 * i, 10 * i + 10)
        if self.kind == CauseKind.LINK:
            x = value[0] * self.direction
        elif self.kind == CauseKind.MASSES:
            x[:p] = value[0] * columns.prior[:p]
        elif self.kind == CauseKind.ROTOR:
            x[p + np.arange(len(value)) if i == ALL else [p + i]] = value
        elif self.kind == CauseKind.BODY:
            x[body] = value
        elif self.kind == CauseKind.CENTRE:
            x[body] = _moved(columns.prior[body], value) - columns.prior[body]
        elif self.kind == CauseKind.GRAVITY:
            down = columns.prior[-3:]
            if len(self.direction):
                # A base that leans across the plane of the arm lessens gravity in the plane.
                inside = down - self.direction * (self.direction @ down)
                turn = Rotation.from_rotvec(value[0] * self.direction)
                x[-3:] = (1.0 - value[1]) * turn.apply(inside) - inside
            else:
                x[-3:] = Rotation.from_rotvec([*value, 0.0]).apply(down) - down
        return x

    def design(self, columns: ErrorColumns, value: Array) -> Array:
        """
        Return the coefficients of the columns for each number, shape (m, k).

        For these numbers they are exact, and for others the derivative.
        """
        here = self.errors(columns, value)
        slopes = [(self.errors(columns, value + step) - self.errors(columns, value - step))
                  / (2.0 * step.sum()) for step in np.diag(_PART_OF_SIZE * self.size)]
        jacobian = np.stack(slopes, axis=1)
        power = float(value @ value)
        if power > 0.0:
            jacobian += np.outer(here - jacobian @ value, value) / power
        found = columns.coordinates(jacobian)
        # What no motion shows, as a turn about an axis in the plane of an arm, is rounding.
        length = np.linalg.norm(found * self.size, axis=0)
        return np.where(length > _ROUNDING * length.max(initial=0.0), found, 0.0)


def _moved(body: Array, shift: Array) -> Array:
    """Return the ten parameters of a body whose centre of mass is moved [m]."""
    mass, first = body[0], body[1:4]
    after = first + mass * shift
    if mass <= 0.0:
        return body

    def about(c: Array) -> Array:
        inertia: Array = (c @ c * np.eye(3) - np.outer(c, c)) / mass
        return inertia[(0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)]
    return np.concatenate(([mass], after, body[4:] - about(first) + about(after)))


def causes(columns: ErrorColumns | None, joints: int, candidates: Sequence[ModelError],
           torque: Array) -> list[Cause]:
    """
    Return all causes that are looked for, those with fewer numbers first.

    Parameters
    ----------
    columns : ErrorColumns or None
        Of the model.
    joints : int
        n.
    candidates : sequence of ModelError
        Masses that may be off.
    torque : ndarray, shape (n,)
        Root mean square of each joint's [N·m].

    """
    scales = [Cause(CauseKind.SCALE, i, np.full(1, 0.1)) for i in (ALL, *range(joints))]
    if columns is None:
        return []
    p, sizes = columns.count, columns.sizes
    found = [*scales, *(Cause(CauseKind.ROTOR, i, sizes[p + i:p + i + 1]) for i in range(joints))]
    found.append(Cause(CauseKind.ROTOR, ALL, sizes[p:p + joints]))
    found += [Cause(CauseKind.LINK, k, np.full(1, 0.1),
                    np.append(x.change, np.zeros(len(sizes) - p)))
              for k, x in enumerate(candidates)]
    found.append(Cause(CauseKind.MASSES, ALL, np.full(1, 0.1)))
    across = columns.across()
    found.append(Cause(CauseKind.GRAVITY, ALL, np.array([0.1, 0.01 if len(across) else 0.1]),
                       across))
    if isinstance(columns.model, UrdfModel):
        found += [Cause(CauseKind.CENTRE, i, np.full(3, 0.01)) for i in range(joints)]
        found += [Cause(CauseKind.BODY, i, sizes[10 * i:10 * i + 10]) for i in range(joints)]
    for kind, size in ((CauseKind.DEAD_BAND, 0.02 * torque),
                       (CauseKind.FADING, 0.05 / np.maximum(torque, 1e-12))):
        found += [Cause(kind, i, size[i:i + 1]) for i in range(joints)]
        found.append(Cause(kind, ALL, size))
    return found

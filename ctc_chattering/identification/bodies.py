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

"""Inertial parameters of the moved bodies, as a model has them and as a motion shows them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
import importlib
from typing import Any

from ctc_chattering.dynamics.pseudo_inertia import (
    parameters_of,
    pseudo_inertia,
    stacked,
    symmetric,
    unit,
)
from ctc_chattering.errors import CtcError, MachineError
from ctc_chattering.identification.attribution import Explanation, Projected
from ctc_chattering.identification.findings import ALL_JOINTS, Finding, Kind
from ctc_chattering.identification.friction import drive_terms
from ctc_chattering.identification.least_squares import Data, Term, without
from ctc_chattering.identification.model_errors import DRIVE, ErrorColumns
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.linalg import block_diag, solve_triangular  # type: ignore[import-untyped]
from scipy.stats import chi2  # type: ignore[import-untyped]

#: The ten parameters of a body, in Pinocchio's order: mass [kg], first moments [kg·m], and moments
#: of inertia about the joint's frame [kg·m²].
PARAMETERS = ('m', 'mx', 'my', 'mz', 'Ixx', 'Ixy', 'Iyy', 'Ixz', 'Iyz', 'Izz')


@dataclasses.dataclass(frozen=True)
class BodyEstimate:
    """
    Parameters of B bodies: links that are fixed to each other are one, in its joint's frame.

    Body i is the one that joint i of n carries, B = n. With the inertias of R rotors, n or 0, and
    the G components of gravity, 3 or 0, there are P = 10 B + R + G parameters. A motion shows
    fewer combinations of them. `information` is 0 along what it does not show, and what is found
    is that of the model there.

    Attributes
    ----------
    names : tuple of str, length B
        Of the heaviest link of each body.
    prior, value : ndarray, shape (B, 10)
        `PARAMETERS` of the model, and those that fit the motion best; nothing makes these belong
        to a body.
    information : ndarray, shape (P, P)
        Normal matrix of the parameters, row by row, then rotors, then gravity, without what
        friction explains: with all parameters x, twice the logarithm of the likelihood ratio is
        (x - found)ᵀ information (x - found). [1/(kg, kg·m, kg·m²)²]
    rotor_prior, rotor : ndarray, shape (R,)
        Inertias of rotors, reflected to the joints: of the model, and those that fit [kg·m²].
    torque : ndarray, shape (n, P, P)
        Mean over the motion of the products of the columns of each joint's torque, without what
        friction explains: the root mean square of what d parameters make is √(dᵀ torque d).
        Empty where unknown.
    gravity_prior, gravity, gravity_about : ndarray, shape (G,)
        In the frame of the base: of the model, what fits, and about which torques are linear
        [m/s²].

    """

    names: tuple[str, ...]
    prior: Array
    value: Array
    information: Array
    rotor_prior: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    rotor: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    torque: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 0, 0)))
    gravity_prior: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    gravity: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    gravity_about: Array = dataclasses.field(default_factory=lambda: np.zeros(0))

    @property
    def known(self) -> Array:
        """Return the parameters of the model, shape (P,)."""
        return np.concatenate((self.prior.ravel(), self.rotor_prior, self.gravity_prior))

    @property
    def found(self) -> Array:
        """Return the parameters that fit the motion best, shape (P,)."""
        return np.concatenate((self.value.ravel(), self.rotor, self.gravity))


#: Size of the changes of bodies that stay as they are, as a part of that of others.
_FIXED = 1e-3
#: w: how far from the model parameters are expected, in bodies.
_EXPECTED = 3.0
#: ε, and the part of what is expected below which a rotor has no inertia.
_LEAST, _NOTHING = 1e-4, 1e-3
#: How sure, how far beyond that, and by which part of a joint's torque a model is wrong.
_SURE, _CLEAR, _PART = 0.999, 2.0, 0.01
#: Standard errors above which gravity is turned, and its least turn [rad].
_TURNED, _LEVEL = 4.0, 3e-4
#: Turn of gravity that is expected [rad], and part of its strength, which is known.
_TURN, _STRENGTH = 0.05, 1e-7


@dataclasses.dataclass(frozen=True)
class ConsistentBodies:
    """
    Parameters that bodies can have.

    Attributes
    ----------
    estimate : BodyEstimate
        What the data ask for.
    parameters : ndarray, shape (B, 10)
        `PARAMETERS` of each body.
    rotor : ndarray, shape (R,)
        Inertias of the rotors [kg·m²].
    gravity : ndarray, shape (G,)
        In the frame of the base [m/s²].
    wanted : ndarray, shape (P,)
        What fits best without bounds, and is nearest to the model otherwise.
    covariance : ndarray, shape (P, P)
        Of all parameters, without bounds; what is not shown has the large one from before any
        data.
    cost : ndarray, shape (B + R,)
        By how much the bounds of each body, and rotor, raise twice the negative logarithm of the
        likelihood.

    """

    estimate: BodyEstimate
    parameters: Array
    rotor: Array
    gravity: Array
    wanted: Array
    covariance: Array
    cost: Array

    @property
    def found(self) -> Array:
        """Return all parameters, shape (P,)."""
        return np.concatenate((self.parameters.ravel(), self.rotor, self.gravity))

    @property
    def differ(self) -> bool:
        """Whether they are clearly not those of the model: by the data, and by the torque."""
        change = self.found - self.estimate.known
        size = float(change @ self.estimate.information @ change)
        shown = np.linalg.matrix_rank(self.estimate.information, hermitian=True)
        part = self.torque(change) > _PART * self.torque(self.found)
        return size > _CLEAR * chi2.ppf(_SURE, shown) and bool(part.any())

    @property
    def tilt(self) -> Array:
        """Return gravity, shape (3,); that of the model where a turn of it is not clear."""
        change = self.gravity - self.estimate.gravity_prior
        size = float(np.linalg.norm(change))
        # Each direction over its own error: across the plane of an arm gravity is not shown.
        power = float(change @ np.linalg.pinv(self.covariance[-3:, -3:], 1e-15, True) @ change)
        clear = power > _TURNED ** 2 and size > _LEVEL * float(np.linalg.norm(self.gravity))
        return self.gravity if clear else self.estimate.gravity_prior

    def torque(self, change: Array) -> Array:
        """Return the root mean square of each joint's torque by a change, shape (n,) [N·m]."""
        found: Array = np.sqrt(np.maximum(
            np.einsum('p,ipq,q->i', change, self.estimate.torque, change), 0.0))
        return found


def consistent(estimate: BodyEstimate, fixed: Sequence[int] = ()) -> ConsistentBodies:
    """
    Return the parameters that bodies can have and that fit best.

    Parameters
    ----------
    estimate : BodyEstimate
        What the data ask for.
    fixed : sequence of int
        Bodies that stay as in the model, each with its rotor.

    Raises
    ------
    MachineError
        If bounds bite and Clarabel is not installed.
    CtcError
        If there are numbers that are not finite, the information is negative or too large for
        what is expected beside it, or the solver finds no solution.

    """
    known = np.concatenate((estimate.prior.ravel(), estimate.rotor_prior, estimate.gravity_about))
    if not all(np.isfinite(x).all() for x in (known, estimate.found, estimate.information)):
        raise CtcError('the estimate of inertial parameters is not finite')
    count = len(estimate.prior)
    free = np.where(np.isin(np.arange(count), list(fixed)), _FIXED, 1.0)
    roots = [S * part for S, part in zip(_units(estimate.prior), free)]
    sizes = _rotors(estimate) * free[:len(estimate.rotor)]
    T = block_diag(*(_change(S) for S in roots), np.diag(sizes),
                   _turns(estimate.gravity_about))
    information = T.T @ estimate.information @ T
    information = 0.5 * (information + information.T)
    H = information + np.eye(len(known)) / _EXPECTED ** 2
    lower = _root(H)
    wanted = np.linalg.solve(H, T.T @ estimate.information @ (estimate.found - known))
    bounds = np.concatenate([
        *(stacked(_inside(S, x) - _LEAST * np.eye(4)) for S, x in zip(roots, estimate.prior)),
        estimate.rotor_prior / sizes])
    y, cost = wanted, np.zeros(count + len(estimate.rotor))
    if not _keeps(bounds + wanted[:len(bounds)], count):
        y, cost = _solve(lower, wanted, bounds, count)
    parameters, rotor, gravity = np.split(known + T @ y, [10 * count, len(bounds)])
    rotor[rotor < _NOTHING * _rotors(estimate)] = 0.0
    inverse = solve_triangular(lower, T.T, lower=True)
    return ConsistentBodies(
        estimate, parameters.reshape(-1, 10), rotor, gravity,
        known + T @ wanted, inverse.T @ inverse, cost)


def _root(H: Array) -> Array:
    """Return L of H = L Lᵀ; raise `CtcError` if there is none."""
    try:
        return np.asarray(np.linalg.cholesky(H), float)
    except np.linalg.LinAlgError:
        low, high = np.linalg.eigvalsh(H)[[0, -1]]
        raise CtcError('the information of inertial parameters, in changes as large as the bodies,'
                       f' is from {low:.3g} to {high:.3g}; allowed: from 0 to about 1e12'
                       ) from None


def _units(prior: Array) -> list[Array]:
    """Return S of every body."""
    heaviest = float(prior[:, 0].max())
    if heaviest <= 0.0:
        raise CtcError(f'no moved body of the model has a mass: {prior[:, 0].tolist()} kg')
    return [unit(x, heaviest) for x in prior]


def _change(S: Array) -> Array:
    """Return the change of the parameters by each element of X, shape (10, 10)."""
    return np.column_stack([parameters_of(S @ symmetric(e) @ S.T) for e in np.eye(10)])


def _rotors(estimate: BodyEstimate) -> Array:
    """Return the inertia that rotors may have, that of the largest body, shape (R,) [kg·m²]."""
    largest = float(np.abs(estimate.prior[:, [4, 6, 9]]).max())
    return np.full(len(estimate.rotor), largest or 1.0)


def _turns(gravity: Array) -> Array:
    """Return the change of gravity by its turns about two axes, and by its strength."""
    if not gravity.any():
        return np.eye(len(gravity))
    along = gravity[:, None] / np.linalg.norm(gravity)
    across = np.linalg.svd(along)[0][:, 1:]
    found: Array = np.linalg.norm(gravity) * np.hstack((_TURN * across, _STRENGTH * along))
    return found


def _inside(S: Array, parameters: Array) -> Array:
    """Return S⁻¹ J S⁻ᵀ."""
    half = np.linalg.solve(S, pseudo_inertia(parameters))
    return np.linalg.solve(S, half.T)


def _keeps(slack: Array, count: int) -> bool:
    """Return whether bodies and rotors keep their bounds."""
    bodies = (symmetric(x) for x in slack[:10 * count].reshape(-1, 10))
    return bool(min(slack[10 * count:], default=0.0) >= 0.0
                and all(np.linalg.eigvalsh(x)[0] >= 0.0 for x in bodies))


def _solve(lower: Array, wanted: Array, bounds: Array, count: int) -> tuple[Array, Array]:
    """Return y of (PC1), and by how much the bounds of each body and rotor raise the cost."""
    clarabel = _clarabel()
    from scipy import sparse  # type: ignore[import-untyped]

    size, bounded = len(wanted), len(bounds)
    # With z = Lᵀ (y - wanted), the cost is zᵀ z.
    back = solve_triangular(lower, np.eye(size), lower=True).T
    cones = [clarabel.PSDTriangleConeT(4)] * count
    if bounded > 10 * count:
        cones.append(clarabel.NonnegativeConeT(bounded - 10 * count))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solution = clarabel.DefaultSolver(
        sparse.eye(size, format='csc'), np.zeros(size),
        sparse.csc_matrix(-back[:bounded]), bounds + wanted[:bounded], cones, settings).solve()
    if str(solution.status) not in ('Solved', 'AlmostSolved'):
        raise CtcError('no inertial parameters that bodies can have were found: Clarabel says '
                       f'{solution.status}')
    shares = -np.array(solution.z) * (bounds + wanted[:bounded])
    cost = np.concatenate((shares[:10 * count].reshape(-1, 10).sum(axis=1), shares[10 * count:]))
    y: Array = wanted + back @ np.array(solution.x)
    return y, np.maximum(cost, 0.0)


def _clarabel() -> Any:
    """Return the solver."""
    try:
        return importlib.import_module('clarabel')
    except ImportError as error:
        raise MachineError('inertial parameters that bodies can have need Clarabel '
                           f'({error}): pip install clarabel') from None


#: Twice the logarithm of the likelihood ratio above which bounds contradict the data.
_CONTRADICTION = 30.0
#: Part of the contradiction from which on a body is named.
_NAMED = 0.1
_CURE = ('check the order of --joints, the sign and the side of the torque (--effort) and the '
         'URDF; then record a motion with more poses and accelerations')


def physical_findings(bodies: ConsistentBodies, joints: Sequence[str],
                      friction: Sequence[float] = ()) -> Iterator[Finding]:
    """
    Yield findings for the joints whose torque the bounds of bodies change.

    Parameters
    ----------
    bodies : ConsistentBodies
        As identified.
    joints : sequence of str, length n
        Names.
    friction : sequence of float, shape (n,), optional
        That is in the torque as well [N·m].

    """
    change = bodies.found - bodies.wanted
    shown = float(change @ bodies.estimate.information @ change)
    if not len(bodies.estimate.torque) or shown < _CONTRADICTION:
        return
    what = '; '.join(_asked(bodies, joints))
    size, whole = bodies.torque(change), bodies.torque(bodies.found)
    whole = whole + np.asarray(friction) if len(friction) else whole
    for i, name in enumerate(joints):
        part = size[i] / whole[i] if whole[i] > 0.0 else 0.0
        if part > Kind.IMPOSSIBLE_BODY.care:
            yield Finding(
                Kind.IMPOSSIBLE_BODY, i,
                f'the torque of {name} asks for what no body can have: {what}; bodies that can be '
                f'differ by {size[i]:.2g} N*m, {part:.0%} of its torque', _CURE, part)


def _asked(bodies: ConsistentBodies, joints: Sequence[str]) -> Iterator[str]:
    """Yield what the data ask for, of the bodies that contradict most."""
    names = bodies.estimate.names
    for k, cost in enumerate(bodies.cost):
        if cost < _NAMED * bodies.cost.sum():
            continue
        if k >= len(names):
            rotor = bodies.wanted[10 * len(names):][k - len(names)]
            yield f'a rotor inertia of {rotor:.3g} kg*m^2 at {joints[k - len(names)]}'
        else:
            yield f'{names[k]} with {impossible(bodies.wanted[10 * k:10 * k + 10])}'


def impossible(parameters: Array) -> str:
    """Return what is wrong with the parameters of a body, in words; empty if nothing is."""
    matrix = pseudo_inertia(parameters)
    mass = float(parameters[0])
    if not mass > 0.0:
        return f'a mass of {mass:.3g} kg'
    first, second, third = np.linalg.eigvalsh(
        matrix[:3, :3] - np.outer(matrix[:3, 3], matrix[:3, 3]) / mass).tolist()
    if first >= 0.0:
        return ''
    moments = sorted((first + second, first + third, second + third))
    shown = ', '.join(f'{x:.3g}' for x in moments)
    return (f'principal moments of inertia {shown} kg*m^2, of which '
            + ('one is negative' if moments[0] < 0.0 else 'the largest exceeds the sum of others'))


#: Singular value below which an error as large as its size is less than noise.
_SEEN = 1.0


def body_estimate(projected: Projected, found: Explanation | None, names: Sequence[str]
                  ) -> BodyEstimate | None:
    """
    Return all inertial parameters as the windows show them, with rotors and gravity.

    Parameters
    ----------
    projected : Projected
        The windows.
    found : Explanation or None
        Of its causes, torque scales count: what they explain is no error of a body.
    names : sequence of str, length n
        Of the bodies.

    """
    columns, n = projected.columns, len(names)
    p = columns.count
    if p != 10 * n or not projected.joints:
        return None
    sizes, prior = columns.sizes, columns.prior
    blocks, right = projected.whole(found)
    root = np.concatenate(blocks)
    u, s, v = np.linalg.svd(root * sizes, full_matrices=False)
    seen = s > _SEEN
    x = prior + sizes * (v[seen].T @ (u[:, seen].T @ right / s[seen]))
    torque = np.zeros((n, len(x), len(x)))
    for i, block, power in zip(projected.joints, blocks, projected.powers):
        torque[i] = block.T @ block / power
    return BodyEstimate(
        tuple(names), prior[:p].reshape(n, 10), x[:p].reshape(n, 10),
        (v[seen].T * np.square(s[seen]) @ v[seen]) / np.outer(sizes, sizes), prior[p:p + n],
        x[p:p + n], torque, prior[p + n:], x[p + n:], columns.gravity)


def judged(estimate: BodyEstimate | None, joints: Sequence[str], friction: Sequence[float],
           fixed: Sequence[int] = ()) -> tuple[ConsistentBodies | None, tuple[Finding, ...]]:
    """
    Return bodies that can be, and findings; None without an estimate, or without a solver.

    Bodies `fixed` stay as in the model.
    """
    if estimate is None:
        return None, ()
    try:
        bodies = consistent(estimate, fixed)
    except CtcError as error:
        return None, (Finding(Kind.NOTE, ALL_JOINTS, f'no corrected URDF: {error}'),)
    return bodies, tuple(physical_findings(bodies, joints, friction))


#: Part of a joint's torque that counts as left in any case: below it nothing is worse.
_TRIFLE = 1e-3


def left_over(data: Data, terms: Sequence[Term], columns: ErrorColumns,
              scales: Explanation | None, fixed: Sequence[int] = ()) -> Array:
    """
    Return what corrected bodies leave of each joint's torque, over what the model leaves.

    Bodies are fitted to one half of the time and judged on the other, both ways; of root mean
    squares without what friction explains. inf where a half does not suffice.

    Parameters
    ----------
    data : Data
        All windows, with all columns.
    terms : sequence of Term
        Friction.
    columns : ErrorColumns
        To which `data.more` belongs.
    scales : Explanation or None
        Whose torque scales are in both.
    fixed : sequence of int
        Bodies that stay as in the model.

    Returns
    -------
    ndarray, shape (n,)
        Of the worse way; 1 for joints without windows.

    """
    n = data.way.shape[1]
    first = np.arange(len(data.way)) < len(data.way) // 2
    for cause, value in zip(scales.causes, scales.values) if scales else ():
        if cause.kind in DRIVE:
            taken = data.columns(drive_terms([cause])) @ value
            data = dataclasses.replace(data, residual=data.residual - taken)
    worst = np.zeros(n)
    for half in (first, ~first):
        fitted, judged = (dataclasses.replace(data, way=np.where(part[:, None], data.way, 0.0))
                          for part in (half, ~half))
        projected = Projected(fitted, terms, columns)
        if not projected.joints:
            return np.full(n, np.inf)
        names = [str(i) for i in range(n)]
        estimate = body_estimate(projected, None, names)
        try:
            change = consistent(estimate, fixed).found - estimate.known if estimate else None
        except CtcError:
            change = None
        if change is None:
            return np.full(n, np.inf)
        torque = judged.more @ columns.coordinates(change)
        worst = np.maximum(worst, _ratios(judged, terms, torque))
    return worst


def _ratios(data: Data, terms: Sequence[Term], torque: Array) -> Array:
    """Return the ratio of what is left of each joint with a torque and without, shape (n,)."""
    found = np.ones(data.way.shape[1])
    for i in range(len(found)):
        used = data.way[:, i] != 0.0
        mine = [term for term in terms if term.joint == i]
        if not used.any() or not mine:
            continue
        x = data.columns(mine)[used, i]
        y = np.column_stack((data.residual[used, i], data.residual[used, i] - torque[used, i]))
        rest = without(x, y)
        trifle = _TRIFLE ** 2 * float(np.square(data.torque[used, i]).mean())
        before, after = np.sqrt(np.square(rest).mean(axis=0) + trifle)
        found[i] = after / before if before > 0.0 else 1.0
    return found

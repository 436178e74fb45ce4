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

from ctc_chattering.dynamics.pseudo_inertia import (
    parameters_of,
    pseudo_inertia,
    stacked,
    symmetric,
    unit,
)
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.attribution import DRIVE, Explanation, Projected, SEEN
from ctc_chattering.identification.findings import ALL_JOINTS, Finding, Kind
from ctc_chattering.identification.least_squares import Data, Term, without
from ctc_chattering.identification.model_errors import ErrorColumns
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.linalg import block_diag, solve_triangular  # type: ignore[import-untyped]
from scipy.optimize import least_squares  # type: ignore[import-untyped]
from scipy.special import gammaincinv  # type: ignore[import-untyped]

#: The ten parameters of a body, in Pinocchio's order: mass [kg], first moments [kg·m], and moments
#: of inertia about the joint's frame [kg·m²].
PARAMETERS = ('m', 'mx', 'my', 'mz', 'Ixx', 'Ixy', 'Iyy', 'Ixz', 'Iyz', 'Izz')


@dataclasses.dataclass(frozen=True)
class BodyEstimate:
    """
    Parameters of n bodies: links that are fixed to each other are one, in its joint's frame.

    Body i is the one that joint i carries. With the inertias of n rotors, reflected to the joints,
    and gravity in the frame of the base there are P = 11 n + 3 parameters: `PARAMETERS` of each
    body, then rotors, then gravity. A motion shows fewer combinations of them. `information` is 0
    along what it does not show, and what is found is that of the model there.

    Attributes
    ----------
    names : tuple of str, length n
        Of the heaviest link of each body.
    known, found : ndarray, shape (P,)
        Of the model, and those that fit the motion best; nothing makes these belong to a body.
    information : ndarray, shape (P, P)
        Normal matrix of the parameters without what friction explains: with all parameters x,
        twice the logarithm of the likelihood ratio is (x - found)ᵀ information (x - found).
        [1/(kg, kg·m, kg·m²)²]
    torque : ndarray, shape (n, P, P)
        Mean over the motion of the products of the columns of each joint's torque, without what
        friction explains: the root mean square of what d parameters make is √(dᵀ torque d).
    about : ndarray, shape (3,)
        Gravity about which torques are linear [m/s²].

    """

    names: tuple[str, ...]
    known: Array
    found: Array
    information: Array
    torque: Array
    about: Array


#: Size of the changes of bodies that stay as they are, as a part of that of others.
_FIXED = 1e-3
#: w: how far from the model parameters are expected, in bodies.
_EXPECTED = 3.0
#: ε, the least that a search begins with, and the part of what is expected below which a rotor has
#: no inertia.
_LEAST, _BEGIN, _NOTHING = 1e-4, 1e-2, 1e-3
#: How sure, how far beyond that, and by which part of a joint's torque a model is wrong.
_SURE, _CLEAR, _PART = 0.999, 2.0, 0.01
#: Standard errors above which gravity is turned, and its least turn [rad].
_TURNED, _LEVEL = 4.0, 3e-4
#: Turn of gravity that is expected [rad], and part of its strength, which is known.
_TURN, _STRENGTH = 0.05, 1e-7
#: Elements of a lower triangle of four, and each of them alone.
_LOWER = np.tril_indices(4)
_ALONE = np.array([np.where((np.arange(16) == 4 * i + j).reshape(4, 4), 1.0, 0.0)
                   for i, j in zip(*_LOWER)])


@dataclasses.dataclass(frozen=True)
class ConsistentBodies:
    """
    Parameters that bodies can have.

    Attributes
    ----------
    estimate : BodyEstimate
        What the data ask for.
    found, wanted : ndarray, shape (P,)
        What bodies can have, and what fits best without bounds; both nearest to the model in what
        the data do not show.
    covariance : ndarray, shape (P, P)
        Without bounds; what is not shown has the large one from before any data.

    """

    estimate: BodyEstimate
    found: Array
    wanted: Array
    covariance: Array

    @property
    def parameters(self) -> Array:
        """Return `PARAMETERS` of each body, shape (n, 10)."""
        return self.found[:10 * len(self.estimate.names)].reshape(-1, 10)

    @property
    def rotor(self) -> Array:
        """Return the inertias of the rotors, shape (n,) [kg·m²]."""
        return self.found[10 * len(self.estimate.names):-3]

    @property
    def differ(self) -> bool:
        """Whether they are clearly not those of the model: by the data, and by the torque."""
        change = self.found - self.estimate.known
        size = float(change @ self.estimate.information @ change)
        shown = np.linalg.matrix_rank(self.estimate.information, hermitian=True)
        part = self.torque(change) > _PART * self.torque(self.found)
        return size > _CLEAR * 2.0 * gammaincinv(0.5 * shown, _SURE) and bool(part.any())

    @property
    def tilt(self) -> Array:
        """Return gravity, shape (3,); that of the model where a turn of it is not clear."""
        gravity, before = self.found[-3:], self.estimate.known[-3:]
        change = gravity - before
        # Each direction over its own error: across the plane of an arm gravity is not shown.
        power = float(change @ np.linalg.pinv(self.covariance[-3:, -3:], 1e-15, True) @ change)
        clear = power > _TURNED ** 2 and (
            np.linalg.norm(change) > _LEVEL * np.linalg.norm(gravity))
        return gravity if clear else before

    def torque(self, change: Array) -> Array:
        """Return the root mean square of each joint's torque by a change, shape (n,) [N·m]."""
        return np.asarray(np.sqrt(np.maximum(
            np.einsum('p,ipq,q->i', change, self.estimate.torque, change), 0.0)))


def consistent(estimate: BodyEstimate, fixed: Sequence[int] = ()) -> ConsistentBodies:
    """
    Return the parameters that bodies can have and that fit best.

    The pseudo-inertia of each body is L Lᵀ in units of the model's, of a rotor a square: so both
    keep their bounds, and the rest is least squares.

    Parameters
    ----------
    estimate : BodyEstimate
        What the data ask for.
    fixed : sequence of int
        Bodies that stay as in the model, each with its rotor.

    Raises
    ------
    CtcError
        If there are numbers that are not finite, no body has a mass, or the information is
        negative or too large for what is expected beside it.

    """
    n, about = len(estimate.names), estimate.about
    # Gravity is nearest to the direction about which it is linear, turned or not.
    known = np.append(estimate.known[:-3], about)
    if not all(np.isfinite(x).all() for x in (known, estimate.found, estimate.information)):
        raise CtcError('the estimate of inertial parameters is not finite')
    prior = known[:10 * n].reshape(n, 10)
    heaviest = float(prior[:, 0].max())
    if heaviest <= 0.0:
        raise CtcError(f'no moved body of the model has a mass: {prior[:, 0].tolist()} kg')
    free = np.where(np.isin(np.arange(n), list(fixed)), _FIXED, 1.0)
    roots = [unit(x, heaviest) * part for x, part in zip(prior, free)]
    sizes = (float(np.abs(prior[:, [4, 6, 9]]).max()) or 1.0) * free
    T = block_diag(*map(_change, roots), np.diag(sizes), _turns(about))
    information = T.T @ estimate.information @ T
    H = 0.5 * (information + information.T) + np.eye(len(known)) / _EXPECTED ** 2
    lower = _root(H)
    wanted = np.linalg.solve(H, T.T @ estimate.information @ (estimate.found - known))
    # Of the model in these units, less what is left in any case.
    least = np.concatenate([
        *(stacked(np.linalg.solve(S, np.linalg.solve(S, pseudo_inertia(x)).T)
                  - _LEAST * np.eye(4)) for S, x in zip(roots, prior)),
        known[10 * n:-3] / sizes, np.zeros(3)])
    y = wanted if _keeps(least + wanted, n) else _search(lower, wanted, least, n)
    found = known + T @ y
    found[10 * n:-3][found[10 * n:-3] < _NOTHING * sizes] = 0.0
    inverse = solve_triangular(lower, T.T, lower=True)
    return ConsistentBodies(estimate, found, known + T @ wanted, inverse.T @ inverse)


def _root(H: Array) -> Array:
    """Return L of H = L Lᵀ; raise `CtcError` if there is none."""
    try:
        return np.asarray(np.linalg.cholesky(H), float)
    except np.linalg.LinAlgError:
        low, high = np.linalg.eigvalsh(H)[[0, -1]]
        raise CtcError('the information of inertial parameters, in changes as large as the bodies,'
                       f' is from {low:.3g} to {high:.3g}; allowed: from 0 to about 1e12'
                       ) from None


def _change(S: Array) -> Array:
    """Return the change of the parameters by each element of X, shape (10, 10)."""
    return np.column_stack([parameters_of(S @ symmetric(e) @ S.T) for e in np.eye(10)])


def _turns(gravity: Array) -> Array:
    """Return the change of gravity by its turns about two axes, and by its strength, (3, 3)."""
    if not gravity.any():
        return np.eye(3)
    along = gravity[:, None] / np.linalg.norm(gravity)
    across = np.linalg.svd(along)[0][:, 1:]
    return np.asarray(np.linalg.norm(gravity) * np.hstack((_TURN * across, _STRENGTH * along)))


def _keeps(x: Array, n: int) -> bool:
    """Return whether bodies and rotors keep their bounds."""
    return bool(x[10 * n:-3].min() >= 0.0 and all(
        np.linalg.eigvalsh(symmetric(part))[0] >= 0.0 for part in x[:10 * n].reshape(-1, 10)))


def _search(lower: Array, wanted: Array, least: Array, n: int) -> Array:
    """Return the y within the bounds for which |lowerᵀ (y - wanted)| is least, shape (P,)."""
    def factors(v: Array) -> Array:
        found = np.zeros((n, 4, 4))
        found[:, _LOWER[0], _LOWER[1]] = v[:10 * n].reshape(n, 10)
        return found

    def rest(v: Array) -> Array:
        L = factors(v)
        return np.asarray(lower.T @ (np.concatenate(
            [stacked(L @ L.mT).ravel(), np.square(v[10 * n:-3]), v[-3:]]) - least - wanted))

    def slope(v: Array) -> Array:
        one = _ALONE @ factors(v)[:, None].mT
        parts = stacked(one + one.mT).mT
        return np.asarray(lower.T @ block_diag(*parts, np.diag(2.0 * v[10 * n:-3]), np.eye(3)))

    begin = []
    for part in (least + wanted)[:10 * n].reshape(n, 10):
        values, vectors = np.linalg.eigh(symmetric(part))
        near = vectors * np.maximum(values, _BEGIN) @ vectors.T
        begin.append(np.linalg.cholesky(near)[_LOWER])
    rotors = np.sqrt(np.maximum((least + wanted)[10 * n:-3], _BEGIN))
    v = least_squares(rest, np.concatenate([*begin, rotors, wanted[-3:]]), slope, method='lm').x
    return np.asarray(wanted + solve_triangular(lower, rest(v), lower=True, trans='T'))


#: Twice the logarithm of the likelihood ratio above which bounds contradict the data.
_CONTRADICTION = 30.0
_CURE = ('check the order of --joints, the sign and the side of the torque (--effort) and the '
         'URDF; then record a motion with more poses and accelerations')


def physical_findings(bodies: ConsistentBodies, joints: Sequence[str], friction: Sequence[float]
                      ) -> Iterator[Finding]:
    """
    Yield findings for the joints whose torque the bounds of bodies change.

    Parameters
    ----------
    bodies : ConsistentBodies
        As identified.
    joints : sequence of str, length n
        Names.
    friction : sequence of float, shape (n,)
        That is in the torque as well [N·m].

    """
    change = bodies.found - bodies.wanted
    if float(change @ bodies.estimate.information @ change) < _CONTRADICTION:
        return
    size, whole = bodies.torque(change), bodies.torque(bodies.found) + np.asarray(friction)
    for i, name in enumerate(joints):
        part = size[i] / whole[i] if whole[i] > 0.0 else 0.0
        if part > Kind.IMPOSSIBLE_BODY.care:
            yield Finding(
                Kind.IMPOSSIBLE_BODY, i, f'the torque of {name} asks for inertial parameters that '
                f'no body can have; those of bodies differ by {size[i]:.2g} N*m, {part:.0%} of it',
                _CURE, part)


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
    if columns.count != 10 * n or not projected.joints:
        return None
    sizes, prior = columns.sizes, columns.prior
    blocks, right = projected.whole(found)
    u, s, v = np.linalg.svd(np.concatenate(blocks) * sizes, full_matrices=False)
    seen = s > SEEN
    torque = np.zeros((n, len(prior), len(prior)))
    for i, block, power in zip(projected.joints, blocks, projected.powers):
        torque[i] = block.T @ block / power
    return BodyEstimate(
        tuple(names), prior, prior + sizes * (v[seen].T @ (u[:, seen].T @ right / s[seen])),
        (v[seen].T * np.square(s[seen]) @ v[seen]) / np.outer(sizes, sizes), torque,
        columns.gravity)


def judged(estimate: BodyEstimate | None, joints: Sequence[str], friction: Sequence[float],
           fixed: Sequence[int] = ()) -> tuple[ConsistentBodies | None, tuple[Finding, ...]]:
    """
    Return bodies that can be, and findings; None without an estimate.

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
            taken = data.mixed(cause.design).more @ value
            data = dataclasses.replace(data, residual=data.residual - taken)
    worst = np.zeros(n)
    for half in (first, ~first):
        fitted, judged = (dataclasses.replace(data, way=np.where(part[:, None], data.way, 0.0))
                          for part in (half, ~half))
        estimate = body_estimate(Projected(fitted, terms, columns), None, [''] * n)
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
        used, own = data.of_joint(terms, i)
        if own.size:
            y = data.residual[used, i]
            rest = without(own, np.column_stack((y, y - torque[used, i])))
            trifle = _TRIFLE * float(np.linalg.norm(data.torque[used, i]))
            before, after = np.hypot(np.linalg.norm(rest, axis=0), trifle)
            found[i] = after / before if before > 0.0 else 1.0
    return found

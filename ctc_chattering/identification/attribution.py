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
Which causes the errors of a model have: as few numbers as explain the torque.

A cause is a block of columns: combinations of those of the model's errors, and of three that a
drive has. Beside the causes stands the saturated fit, which has a column for all that the motion
shows of any error of the inertial parameters, rotors and gravity. It needs no name for an error,
so friction is right beside it whatever the error is; what its columns leave is the yardstick for
the causes.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from enum import Enum
from itertools import pairwise
from math import log

from ctc_chattering.dynamics.pseudo_inertia import parameters_of, pseudo_inertia
from ctc_chattering.identification.findings import ALL_JOINTS
from ctc_chattering.identification.least_squares import correlation_length, Data, Term, without
from ctc_chattering.identification.model_errors import ErrorColumns, ModelError
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: In place of an index: of all joints, or all masses.
ALL = -1
#: Part of the largest of its columns below which one is rounding.
_ROUNDING = 1e-9
#: Gravity that a change of it is compared with [m/s²].
_GRAVITY = 0.1


class CauseKind(Enum):
    """What a cause is."""

    SCALE = 'torque scale'
    DEAD_BAND = 'dead band'
    FADING = 'fading torque'
    MASSES = 'all masses'
    GRAVITY = 'direction of gravity'
    ROTOR = 'rotor inertia'
    LINK = 'mass'
    PAYLOAD = 'payload'
    CENTRE = 'centre of mass'
    BODY = 'mass, centre and inertia'


#: What a drive makes of its command, in the order of its columns.
DRIVE = (CauseKind.SCALE, CauseKind.DEAD_BAND, CauseKind.FADING)
#: Those that change inertias of links, as rotors do.
BODIES = (CauseKind.LINK, CauseKind.PAYLOAD, CauseKind.MASSES, CauseKind.CENTRE, CauseKind.BODY)


@dataclasses.dataclass(frozen=True, eq=False)
class Cause:
    """
    A cause with k numbers; n joints, m columns of the model's errors.

    Attributes
    ----------
    kind : CauseKind
        What it is.
    which : int
        Joint, body or candidate; `ALL` for all.
    name : str
        In words.
    size : ndarray, shape (k,)
        How large its numbers are roughly.
    design : ndarray, shape (n, m + 3, k)
        Coefficients of `Data.errors` of each joint for each number.

    """

    kind: CauseKind
    which: int
    name: str
    size: Array
    design: Array

    @property
    def joint(self) -> int:
        """Return the joint that it belongs to; `ALL_JOINTS` for none."""
        return self.which if self.kind in (*DRIVE, CauseKind.ROTOR) else ALL_JOINTS

    def contains(self, other: Cause) -> bool:
        """Return whether it has all columns of another cause, and so explains at least as much."""
        mine, theirs = (x.design.reshape(-1, len(x.size)) for x in (self, other))
        return len(self.size) > len(other.size) and float(np.abs(
            without(mine, theirs)).max()) < 1e-6 * float(np.abs(theirs).max())


def causes(columns: ErrorColumns | None, joints: Sequence[str], candidates: Sequence[ModelError],
           torque: Array) -> list[Cause]:
    """
    Return all causes that are looked for.

    Parameters
    ----------
    columns : ErrorColumns or None
        Of the model.
    joints : sequence of str, length n
        Names.
    candidates : sequence of ModelError
        Masses that may be off.
    torque : ndarray, shape (n,)
        Root mean square of each joint's [N·m].

    """
    if columns is None:
        return []
    n, p, m = len(joints), columns.count, columns.basis.shape[1]
    sizes, unit = columns.sizes, np.eye(len(columns.sizes))
    bodies, tenth = body_names(candidates, joints), np.full(1, 0.1)

    def drive(kind: CauseKind, which: int, size: Array) -> Cause:
        design = np.zeros((n, m + 3, len(size)))
        for k, i in enumerate(range(n) if which == ALL else [which]):
            design[i, m + DRIVE.index(kind), k % len(size)] = 1.0
        return Cause(kind, which, f'{kind.value} of {(*joints, "all joints")[which]}', size,
                     design)

    def model(kind: CauseKind, which: int, of: str, size: Array, x: Array) -> Cause:
        found = columns.coordinates(x)
        # What no motion shows, as gravity across the plane of an arm, is rounding.
        length = np.linalg.norm(found * size, axis=0)
        found = np.where(length > _ROUNDING * length.max(initial=0.0), found, 0.0)
        return Cause(kind, which, f'{kind.value}{of}', size,
                     np.tile(np.concatenate((found, np.zeros((3, len(size))))), (n, 1, 1)))

    own, gravity = unit[:, p:p + n], unit[:, -3:] @ columns.directions
    bent = ((CauseKind.DEAD_BAND, _BAND * torque),
            (CauseKind.FADING, 0.05 / np.maximum(torque, 1e-12)))
    prior = np.append(columns.prior[:p], np.zeros(n + 3))[:, None]
    return [
        *(drive(CauseKind.SCALE, i, tenth) for i in (ALL, *range(n))),
        *(model(CauseKind.ROTOR, i, f' of {joints[i]}', sizes[p + i:p + i + 1], own[:, i:i + 1])
          for i in range(n)),
        model(CauseKind.ROTOR, ALL, ' of all joints', sizes[p:p + n], own),
        *(model(CauseKind.PAYLOAD if x.unit else CauseKind.LINK, k,
                '' if x.unit else f' of {x.name}', tenth,
                np.append(x.change, np.zeros(n + 3))[:, None]) for k, x in enumerate(candidates)),
        model(CauseKind.MASSES, ALL, '', tenth, prior),
        model(CauseKind.GRAVITY, ALL, '', np.full(gravity.shape[1], _GRAVITY), gravity),
        *(model(CauseKind.CENTRE, i, f' of {bodies[i]}', np.full(3, 0.01),
                unit[:, 10 * i:10 * i + 10] @ _moved(columns.prior[10 * i:10 * i + 10]))
          for i in range(n) if p == 10 * n),
        *(model(CauseKind.BODY, i, f' of {bodies[i]}', sizes[10 * i:10 * i + 10],
                unit[:, 10 * i:10 * i + 10]) for i in range(n) if p == 10 * n),
        *(drive(kind, i, size[i:i + 1]) for kind, size in bent for i in range(n)),
        *(drive(kind, ALL, size) for kind, size in bent)]


def _moved(body: Array) -> Array:
    """Return the change of a body by a shift of its mass along x, y and z, shape (10, 3)."""
    J, ends = pseudo_inertia(body), np.eye(4)
    return np.stack([parameters_of(shift @ J + J @ shift.T) for shift in (
        np.outer(ends[k], ends[3]) for k in range(3))], axis=1)


def body_names(candidates: Sequence[ModelError], joints: Sequence[str]) -> list[str]:
    """Return a name for the body of each joint."""
    links = [x.name for x in candidates if not x.unit]
    return links if len(links) == len(joints) else [f'body of {name}' for name in joints]


#: Most causes.
_MOST = 8
#: Times that noise is taken out of squares of torques.
_PASSES = 8
#: Singular value below which an error as large as its size is less than noise.
SEEN = 1.0
#: Least size of a cause, as a part of the size of its numbers.
_LEAST = 0.05
#: Size of a dead band as a part of the torque.
_BAND = 0.02
#: Part by which no torque is off, and of a mass that no link lacks.
_ABSURD, _LEFT = 0.6, 0.9
#: Turn of a base above which it is not one that is not level [rad], and the part of gravity that
#: an arm's plane lacks which leans as much.
_STEEP = 0.26
_LOST = 1.0 - float(np.cos(_STEEP))
#: Fewest windows of a joint for each column.
_ROWS = 2
#: What a number costs, in logarithms of the number of independent windows.
_COST = 2.0


@dataclasses.dataclass(frozen=True)
class Explanation:
    """
    Causes with their numbers.

    Attributes
    ----------
    causes : tuple of Cause
        Without an order.
    values : tuple of ndarray
        Numbers of each.
    square : float
        What is left, over the variance of noise.
    left : ndarray, shape (joints,)
        Mean square of what is left of each of the joints with windows enough [(N·m)²].

    """

    causes: tuple[Cause, ...]
    values: tuple[Array, ...]
    square: float
    left: Array

    @property
    def count(self) -> int:
        """Return how many numbers there are."""
        return sum(len(value) for value in self.values)


class Projected:
    """
    The windows without what friction explains: few rows for each joint.

    Parameters
    ----------
    data : Data
        All windows.
    terms : sequence of Term
        Friction.
    columns : ErrorColumns
        To which `data.more` belongs.

    Attributes
    ----------
    joints : list of int
        Those with windows enough.
    powers : list of float
        Number of windows of each of these, over the variance of their noise.
    saturated : ndarray, shape (n, m + 3, k)
        Orthogonal combinations of the model's errors that the motion shows.
    cost : float
        That of a number.

    """

    def __init__(self, data: Data, terms: Sequence[Term], columns: ErrorColumns) -> None:
        self.columns, self._m = columns, data.more.shape[2]
        n, count = data.way.shape[1], 0.0
        self._blocks = [np.zeros((0, self._m + 4))]
        self.joints: list[int] = []
        self.powers: list[float] = []
        for i in range(n):
            used, own = data.of_joint(terms, i)
            friction = own.shape[1]
            if friction < 2 or len(own) < _ROWS * (self._m + friction):
                continue
            x = np.column_stack((own, data.errors(i)[used], data.residual[used, i]))
            q, r = np.linalg.qr(x, mode='reduced')
            block = r[friction:, friction:]
            left = q @ np.append(np.zeros(friction), without(block[:, :-1], block[:, -1]))
            length = correlation_length(left)
            variance = float(left @ left) / max(len(left) - x.shape[1], 1) + data.floor[i] ** 2
            weight = 1.0 / (variance * length) if variance > 0.0 else 0.0
            self.joints.append(i)
            self._blocks.append(np.sqrt(weight) * block)
            self.powers.append(float(weight * len(own)))
            count += len(left) / length
        _, s, v = np.linalg.svd(np.concatenate(self._blocks)[:, :self._m], full_matrices=False)
        shown = v[s > SEEN].T
        self.saturated = np.tile(np.concatenate((shown, np.zeros((3, shown.shape[1])))), (n, 1, 1))
        self.cost = _COST * log(max(count, 2.0))
        self._right = np.concatenate([block[:, -1] for block in self._blocks])

    def _design(self, chosen: Sequence[Cause], saturated: bool = False) -> Array:
        """Return the columns of causes, after those of the saturated fit."""
        whole = mixed(self, chosen, saturated)
        return np.concatenate([np.zeros((0, whole.shape[2])), *(
            block[:, :-1] @ whole[i] for i, block in zip(self.joints, self._blocks[1:]))])

    def fit(self, chosen: Sequence[Cause], saturated: bool = False) -> Explanation:
        """Return the numbers of causes; besides the saturated columns, if wanted."""
        design = self._design(chosen, saturated)
        scale = np.concatenate([np.ones(0), *(cause.size for cause in chosen)])
        own = design.shape[1] - len(scale)
        found = np.linalg.lstsq(design * np.append(np.ones(own), scale), self._right,
                                rcond=1e-10)[0]
        rest = self._right - design @ (found * np.append(np.ones(own), scale))
        ends = own + np.cumsum([0, *(len(cause.size) for cause in chosen)])
        rows = np.cumsum([len(block) for block in self._blocks])[:-1]
        return Explanation(
            tuple(chosen), tuple(cause.size * found[a:b] for cause, (a, b) in zip(
                chosen, pairwise(ends))), float(rest @ rest), np.array(
                [float(x @ x) for x in np.split(rest, rows)[1:]]) / np.maximum(
                    self.powers, 1e-300))

    def deviation(self, found: Explanation, i: int, saturated: bool = False,
                  kind: CauseKind = CauseKind.SCALE) -> float:
        """Return how exactly one of `DRIVE` would be known of joint i beside causes."""
        column = np.concatenate([block[:, self._m + DRIVE.index(kind)] * (i == k)
                                 for k, block in zip(self.joints, self._blocks[1:])])
        length = float(np.linalg.norm(without(self._design(found.causes, saturated), column)))
        return 1.0 / length if length > 0.0 else np.inf

    def whole(self, found: Explanation | None) -> tuple[list[Array], Array]:
        """
        Return the columns of all parameters x for each joint, and what they are to explain.

        They are over the deviation of noise, shapes (rows, p + n + 3) and (all rows,), without
        what the drives' causes explain.
        """
        unit = self.columns.coordinates(np.eye(len(self.columns.sizes)))
        right = self._right
        for cause, value in zip(found.causes, found.values) if found else ():
            if cause.kind in DRIVE:
                right = right - self._design([cause]) @ value
        return [x[:, :self._m] @ unit for x in self._blocks[1:]], right


def mixed(projected: Projected, chosen: Sequence[Cause], saturated: bool) -> Array:
    """Return the design of causes, after that of the saturated fit if wanted, (n, m + 3, k)."""
    whole = projected.saturated
    return np.concatenate((whole if saturated else whole[:, :, :0],
                           *(cause.design for cause in chosen)), axis=2)


def without_noise(data: Data, terms: Sequence[Term]) -> Data:
    """
    Return the windows with torques as friction and errors of each joint alone predict them.

    A column of measured torques would explain noise by itself: the smaller the scale, the less of
    it there is. So would their square where a torque is constant.
    """
    torque, bent = data.torque.copy(), data.bent.copy()
    for i in range(torque.shape[1]):
        used, own = data.of_joint(terms, i)
        x, square = np.concatenate((own, data.more[used, i], data.base[used, i, None],
                                    data.bent[used, i, :1]), axis=1), data.bent[used, i, 1]
        y = noise = without(x, data.residual[used, i])
        for _ in range(_PASSES):
            other = without(x, square - 2.0 * np.abs(data.torque[used, i] - noise) * noise)
            noise = y - other * (other @ y / max(float(other @ other), 1e-300))
        torque[used, i] -= noise
        bent[used, i, 1] = square - 2.0 * np.abs(torque[used, i]) * noise
    return dataclasses.replace(data, torque=torque, bent=bent)


def explain(projected: Projected, options: Sequence[Cause], saturated: bool = False
            ) -> Explanation:
    """Return the causes that explain the torque with the fewest numbers, the best first."""
    def price(found: Explanation) -> float:
        return found.square + projected.cost * found.count

    best = projected.fit((), saturated)
    for _ in range(len(projected.joints) - 1 if saturated else _MOST):
        found = [projected.fit((*best.causes, cause), saturated)
                 for cause in options if possible(cause, best.causes)]
        better = [x for x in found if price(x) < price(best) and _large(x, projected)]
        if not better:
            break
        # Of those that explain as much, the first: a torque constant before all masses.
        least = min(map(price, better)) + 0.5 * projected.cost
        best = next(x for x in better if price(x) <= least)
        # Without those that others have made superfluous.
        for cause in best.causes[:-1]:
            fewer = projected.fit([x for x in best.causes if x is not cause], saturated)
            best = min(best, fewer, key=price)
    return best


def possible(cause: Cause, others: Sequence[Cause]) -> bool:
    """Return whether a cause may stand beside others."""
    # All torques and all masses times nothing would explain everything.
    whole = [x for x in (cause, *others) if x.which == ALL
             and x.kind in (CauseKind.SCALE, CauseKind.MASSES)]
    return len(whole) < 2 and not any(cause is x for x in others)


def _large(found: Explanation, projected: Projected) -> bool:
    """Return whether the last cause is more than a trifle, and none is absurd."""
    cause, value = found.causes[-1], found.values[-1]
    return bool((np.abs(value) > _LEAST * cause.size).any()) and not any(
        absurd(x, y, projected.columns) for x, y in zip(found.causes, found.values))


def absurd(cause: Cause, value: Array, columns: ErrorColumns) -> bool:
    """Return whether a torque scale, a dead band or a tilt is one that no robot has."""
    if cause.kind == CauseKind.GRAVITY:
        shown = columns.directions
        before = shown.T @ columns.prior[-3:]
        after, size = before + value, float(np.linalg.norm(before))
        far = float(np.linalg.norm(after))
        turned = after @ before < np.cos(_STEEP) * size * far
        return bool(turned or abs(far - size) > _LOST * size)
    if cause.kind == CauseKind.SCALE:
        return bool(abs(value[0]) > _ABSURD)
    # Nor has a robot a drive that takes most of the torque.
    if cause.kind == CauseKind.DEAD_BAND and (value > _ABSURD / _BAND * cause.size).any():
        return True
    # No mass vanishes, and no dead band gives torque.
    return bool(value.min() < {CauseKind.LINK: -_LEFT, CauseKind.MASSES: -_LEFT,
                               CauseKind.DEAD_BAND: 0.0, CauseKind.FADING: 0.0
                               }.get(cause.kind, -np.inf))

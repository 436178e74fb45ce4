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

Beside the causes stands the saturated fit, which has a column for all that the motion shows of any
error of the inertial parameters, rotors and gravity. It needs no name for an error, so friction
is right beside it whatever the error is; what its columns leave is the yardstick for the causes.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from itertools import pairwise
from math import log

from ctc_chattering.identification.least_squares import correlation_length, Data, Term, without
from ctc_chattering.identification.model_errors import ALL, Cause, CauseKind, DRIVE, ErrorColumns
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Most causes, and steps in which their numbers are found.
_MOST, _STEPS = 8, 3
#: Singular value below which an error as large as its size is less than noise.
_SEEN = 1.0
#: Least size of a cause, as a part of the size of its numbers.
_LEAST = 0.05
#: Part by which no torque is off.
_ABSURD = 0.6
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
    left: Array = dataclasses.field(default_factory=lambda: np.zeros(0))

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
    saturated : ndarray, shape (m, k)
        Orthogonal combinations of the columns that the motion shows.
    square : float
        What these leave, over the variance of noise.
    cost : float
        That of a number.

    """

    def __init__(self, data: Data, terms: Sequence[Term], columns: ErrorColumns) -> None:
        self.columns = columns
        n = data.way.shape[1]
        self._blocks: list[Array] = []
        self.joints: list[int] = []
        self.powers: list[float] = []
        weight, count = np.zeros(n), 0.0
        for i in range(n):
            used = data.way[:, i] != 0.0
            mine = [term for term in terms if term.joint == i]
            if len(mine) < 2 or used.sum() < _ROWS * (data.more.shape[2] + len(mine)):
                continue
            self.joints.append(i)
            rest = data.columns(mine)[used, i]
            x = np.column_stack((rest, data.more[used, i], data.torque[used, i],
                                 data.bent[used, i], data.residual[used, i]))
            q, r = np.linalg.qr(x, mode='reduced')
            block = r[len(mine):, len(mine):]
            left = q @ np.append(np.zeros(len(mine)), without(block[:, :-1], block[:, -1]))
            length = correlation_length(left)
            variance = float(left @ left) / max(len(left) - x.shape[1], 1) + data.floor[i] ** 2
            if variance > 0.0:
                weight[i] = 1.0 / (variance * length)
            self._blocks.append(np.sqrt(weight[i]) * block)
            self.powers.append(float(weight[i] * used.sum()))
            count += len(left) / length
        m = data.more.shape[2]
        stacked = np.concatenate([np.zeros((0, m + 2 + data.bent.shape[2])), *self._blocks])
        u, s, v = np.linalg.svd(stacked[:, :m], full_matrices=False)
        seen = s > _SEEN
        self.saturated = v[seen].T
        self.square = float(np.square(stacked[:, -1]).sum()
                            - np.square(u[:, seen].T @ stacked[:, -1]).sum())
        self.cost = _COST * log(max(count, 2.0))

    def fit(self, chosen: Sequence[Cause], start: Sequence[Array] = (),
            saturated: bool = False) -> Explanation:
        """Return the numbers of causes; besides the saturated columns, if wanted."""
        values = [*start, *(np.zeros(len(cause.size)) for cause in chosen[len(start):])]
        design, right = self._design(chosen, values, saturated)
        for _ in range(_STEPS if any(len(x) > 1 for x in values) else 1):
            scale = np.concatenate([np.ones(0), *(cause.size for cause in chosen)])
            scale = np.append(np.ones(design.shape[1] - len(scale)), scale)
            found = np.linalg.lstsq(design * scale, right, rcond=1e-10)[0] * scale
            ends = np.cumsum([design.shape[1] - sum(map(len, values)), *map(len, values)])
            values = [found[a:b] for a, b in pairwise(ends)]
            design, right = self._design(chosen, values, saturated)
        rest = right - design @ np.linalg.lstsq(design, right, rcond=1e-10)[0]
        ends = np.cumsum([len(block) for block in self._blocks])[:-1]
        return Explanation(tuple(chosen), tuple(values), float(rest @ rest), np.array([
            float(x @ x) for x in np.split(rest, ends)]) / np.maximum(self.powers, 1e-300))

    def deviation(self, found: Explanation, cause: Cause, saturated: bool = False) -> float:
        """Return how exactly the first number of another cause would be known beside these."""
        design, _ = self._design((*found.causes, cause),
                                 (*found.values, np.zeros(len(cause.size))), saturated)
        place = design.shape[1] - len(cause.size)
        length = float(np.linalg.norm(without(design[:, :place], design[:, place])))
        return 1.0 / length if length > 0.0 else np.inf

    def whole(self, found: Explanation | None) -> tuple[list[Array], Array]:
        """
        Return the columns of all parameters x for each joint, and what they are to explain.

        They are over the deviation of noise, shapes (rows, p + n + 3) and (all rows,), without
        what torque scales explain.
        """
        m = self.columns.basis.shape[1]
        unit = self.columns.coordinates(np.eye(len(self.columns.sizes)))
        right = np.concatenate([x[:, -1] for x in self._blocks])
        pairs = [] if found is None else [
            x for x in zip(found.causes, found.values) if x[0].kind in DRIVE]
        if pairs:
            chosen, values = zip(*pairs)
            design, _ = self._design(chosen, values, False)
            right = right - design @ np.concatenate(values)
        return [x[:, :m] @ unit for x in self._blocks], right

    def _design(self, chosen: Sequence[Cause], values: Sequence[Array], saturated: bool
                ) -> tuple[Array, Array]:
        """Return the columns of causes at these numbers, and what they are to explain."""
        rows = []
        m = self.columns.basis.shape[1]
        mixed = [np.zeros((m, 1)) if cause.kind in DRIVE
                 else cause.design(self.columns, value) for cause, value in zip(chosen, values)]
        for i, block in zip(self.joints, self._blocks):
            parts = [block[:, :m] @ self.saturated] if saturated else []
            for cause, mix in zip(chosen, mixed):
                if cause.kind == CauseKind.SCALE:
                    parts.append(-block[:, m:m + 1] * (cause.which in (i, ALL)))
                elif cause.kind in DRIVE:
                    column = block[:, m + DRIVE.index(cause.kind), None]
                    mine = np.arange(len(cause.size)) if cause.which == ALL else [cause.which]
                    parts.append(column * (np.asarray(mine) == i))
                else:
                    parts.append(block[:, :m] @ mix)
            rows.append(np.concatenate([np.empty((len(block), 0)), *parts], axis=1))
        return np.concatenate(rows), np.concatenate([block[:, -1] for block in self._blocks])


def without_noise(data: Data, terms: Sequence[Term]) -> Data:
    """
    Return the windows with torques as friction and errors of each joint alone predict them.

    A column of measured torques would explain noise by itself: the smaller the scale, the less of
    it there is.
    """
    torque = data.torque.copy()
    for i in range(torque.shape[1]):
        used = data.way[:, i] != 0.0
        mine = [term for term in terms if term.joint == i]
        x = np.concatenate((data.columns(mine)[used, i], data.more[used, i],
                            (data.torque - data.residual)[used, i, None], data.bent[used, i]),
                           axis=1)
        torque[used, i] -= without(x, data.residual[used, i])
    return dataclasses.replace(data, torque=torque)


def explain(projected: Projected, options: Sequence[Cause], saturated: bool = False
            ) -> Explanation:
    """Return the causes that explain the torque with the fewest numbers, the best first."""
    best = projected.fit((), saturated=saturated)
    for _ in range(len(projected.joints) - 1 if saturated else _MOST):
        found = [projected.fit((*best.causes, cause), best.values, saturated)
                 for cause in options if possible(cause, best.causes)]
        better = [x for x in found if _price(x, projected) < _price(best, projected)
                  and _large(x)]
        if not better:
            break
        # Of those that explain as much, the first: a torque constant before all masses.
        least = min(_price(x, projected) for x in better) + 0.5 * projected.cost
        best = _without(projected, next(x for x in better if _price(x, projected) <= least),
                        saturated)
    return best


def possible(cause: Cause, others: Sequence[Cause]) -> bool:
    """Return whether a cause may stand beside others."""
    if any(cause is x for x in others):
        return False
    # All torques and all masses times nothing would explain everything.
    whole = [x for x in (cause, *others) if x.which == ALL
             and x.kind in (CauseKind.SCALE, CauseKind.MASSES)]
    return len(whole) < 2


def _price(found: Explanation, projected: Projected) -> float:
    """Return what is left plus what the numbers cost."""
    return found.square + projected.cost * found.count


def _large(found: Explanation) -> bool:
    """Return whether the last cause is more than a trifle, and none is absurd."""
    cause, value = found.causes[-1], found.values[-1]
    return bool((np.abs(value) > _LEAST * cause.size).any()) and not absurd(found)


def absurd(found: Explanation) -> bool:
    """Return whether a torque scale, a dead band or a tilt is one that no robot has."""
    for cause, value in zip(found.causes, found.values):
        if cause.kind == CauseKind.SCALE and abs(value[0]) > _ABSURD:
            return True
        if cause.kind in DRIVE[1:] and (value < 0.0).any():
            return True
        if cause.kind == CauseKind.GRAVITY:
            planar = len(cause.direction) > 0
            if (np.abs(value) > [_STEEP, _LOST if planar else _STEEP]).any():
                return True
    return False


def _without(projected: Projected, found: Explanation, saturated: bool) -> Explanation:
    """Return an explanation without causes that others have made superfluous."""
    for k in range(len(found.causes)):
        fewer = [x for j, x in enumerate(found.causes) if j != k]
        other = projected.fit(fewer, [x for j, x in enumerate(found.values) if j != k], saturated)
        if fewer and _price(other, projected) < _price(found, projected):
            return _without(projected, other, saturated)
    return found

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
The motion that tells most of friction and inertial parameters, found by linear programs.

Poses stay where they were drawn. Limits of position, velocity and acceleration are linear in the
coefficients of the Fourier series. The merit of the information is linearised, and each joint's
coefficients go to where that is largest within its limits and a trust region. What else is to be
kept (torque, distance) is a barrier.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from itertools import pairwise
from math import inf, log
from typing import NamedTuple

from ctc_chattering.errors import CtcError
from ctc_chattering.identification.excitation.best_motion import Shapes
from ctc_chattering.identification.excitation.information import Information, Regression
from ctc_chattering.identification.excitation.limits import Bounds
from ctc_chattering.identification.excitation.margins import Limit, Margin
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
import numpy as np
from scipy.optimize import Bounds as Box  # type: ignore[import-untyped]
from scipy.optimize import LinearConstraint, milp

#: Part of the evaluations that are random motions, and the greatest number of these.
_RANDOM_PART, _RANDOM_MOST = 0.1, 50
#: By what random motions are scaled one after the other until they keep all limits.
_SMALLER = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15)
#: Size of the trust region at first, at most and at least, and by what it grows and shrinks.
_TRUST, _WIDEST, _NARROWEST, _GROW, _SHRINK = 0.3, 2.0, 2e-3, 1.5, 0.4
#: Weight of a barrier in the merit.
_BARRIER = 0.02
#: Samples between two waypoints that are further apart than this, the ways between poses [s].
_WAY, _LONG = 9, 0.6
#: Step of finite differences of a margin.
_STEP = 1e-5


class EvaluatedMotion(NamedTuple):
    """
    A motion with its merit.

    Attributes
    ----------
    z : ndarray, shape (shapes, n)
        Coefficients.
    information : Information
        What it tells.
    margins : tuple of Margin
        What it leaves of the limits; empty where its merit without them is too small already.
    merit : float
        -inf where a limit is not kept.

    """

    z: Array
    information: Information
    margins: tuple[Margin, ...]
    merit: float


@dataclasses.dataclass(frozen=True)
class BestMotion:
    """
    The best motion.

    Attributes
    ----------
    z : ndarray, shape (shapes, n)
        Its coefficients.
    information : Information
        What it tells.
    random : ndarray, shape (m,)
        Condition numbers of the random motions.
    evaluations : int
        How many motions were evaluated, those for gradients among them.

    """

    z: Array
    information: Information
    random: Array
    evaluations: int


class Search:
    """
    Motions of the same times.

    Parameters
    ----------
    shapes : Shapes
        All of them.
    bounds : Bounds
        What each joint keeps.
    regression : Regression
        Says what they tell.
    limits : sequence of Limit
        What else they keep.

    """

    def __init__(self, shapes: Shapes, bounds: Bounds, regression: Regression,
                 limits: Sequence[Limit]) -> None:
        self._shapes, self._regression, self._limits = shapes, regression, limits
        times = shapes.path.times / NANOSECONDS
        begin, end = shapes.fourier
        self._t = np.unique(np.concatenate([np.linspace(a, b, _WAY if b - a > _LONG else 2)
                                            for a, b in pairwise(times)]))
        self._time = np.gradient(self._t)
        self._rows = shapes.path.at(self._t)
        rows = shapes.path.points[:, (times >= begin) & (times <= end)][:, ::2, shapes.series]
        #: For each joint, what a unit of each series takes of its limits, (samples, series).
        self._use = [np.concatenate([x / bound[i] for x, bound in zip(rows, (
            bounds.room, bounds.velocity, bounds.acceleration))])
            for i in range(len(bounds.center))]
        self._most = [np.abs(use).sum(axis=1) for use in self._use]
        self.evaluations = 0

    def best(self, evaluations: int, seed: int) -> BestMotion:
        """
        Return the best motion.

        Parameters
        ----------
        evaluations : int
            Number of motions to evaluate; a gradient is three for each joint.
        seed : int
            Of the random motions, from the best of which the search begins.

        Raises
        ------
        CtcError
            If no random motion keeps the limits.

        """
        rng = np.random.default_rng(seed)
        count = min(max(1, int(_RANDOM_PART * evaluations)), _RANDOM_MOST)
        drawn = [self.evaluated(self._shapes.random(rng), inf) for _ in range(count)]
        starts = sorted(drawn, key=lambda x: x.information.merit()[0], reverse=True)
        found: EvaluatedMotion | None = None
        for start in starts:
            if found is not None and self.evaluations >= evaluations:
                break
            first = self._within(start.z)
            if first is not None:
                climbed = self._climb(first, evaluations)
                if found is None or climbed.merit > found.merit:
                    found = climbed
        if found is None:
            raise CtcError(self._refusal(starts[0].z))
        random = np.array([x.information.condition for x in drawn])
        return BestMotion(found.z, found.information, random, self.evaluations)

    def evaluated(self, z: Array, least: float = -inf) -> EvaluatedMotion:
        """Return a motion with its merit; its margins only if that is above `least`."""
        self.evaluations += 1
        path = self._shapes.motion(z).path
        found = EvaluatedMotion(z, self._regression.of(path.at(self._t), self._time), (), -inf)
        merit = found.information.merit()[0]
        if merit <= least:
            return found
        margins = tuple(limit.margin(path) for limit in self._limits)
        return found._replace(margins=margins, merit=merit + _BARRIER * sum(
            min(0.0, log(x.value)) if x.value > 0.0 else -inf for x in margins))

    def _within(self, z: Array) -> EvaluatedMotion | None:
        """Return a motion, as much smaller as it takes to keep the limits."""
        for factor in _SMALLER:
            smaller = z.copy()
            smaller[self._shapes.free] *= factor
            found = self.evaluated(smaller)
            if found.merit > -inf:
                return found
        return None

    def _refusal(self, z: Array) -> str:
        """Return why even the smallest motion is none."""
        smaller = z.copy()
        smaller[self._shapes.free] *= _SMALLER[-1]
        margins = self.evaluated(smaller).margins
        return min(margins, key=lambda x: x.value).reason if margins else (
            'no motion moves all joints')

    def _climb(self, found: EvaluatedMotion, evaluations: int) -> EvaluatedMotion:
        """Return the best motion that linear programs lead to."""
        trust, gradient = _TRUST, None
        scale = np.abs(found.z[self._shapes.series]).mean(axis=0)
        while trust > _NARROWEST and self.evaluations < evaluations:
            if gradient is None:
                gradient = self.gradient(found)
            other = self.evaluated(self._shapes.fitted(
                self._step(found.z, gradient, trust, scale)), found.merit)
            if other.merit > found.merit:
                found, gradient, trust = other, None, min(_GROW * trust, _WIDEST)
            else:
                trust *= _SHRINK
        return found

    def gradient(self, found: EvaluatedMotion) -> Array:
        """Return the derivatives of the merit by the coefficients, shape (shapes, n)."""
        self.evaluations += 3 * self._regression.n
        path = self._shapes.motion(found.z).path
        change = self._regression.gradient(
            path.at(self._t), self._time, found.information, found.information.merit()[1])
        result: Array = np.asarray(np.einsum('kws,kwn->sn', self._rows, change))
        for margin in found.margins:
            if margin.value < 1.0:
                t = np.array([margin.time])
                state, shape = path.at(t)[:, 0], self._shapes.path.at(t)[:, 0]
                result += _BARRIER / margin.value * shape.T @ _differences(margin, state)
        return result

    def _step(self, z: Array, gradient: Array, trust: float, scale: Array) -> Array:
        """Return the coefficients that the linear programs lead to, one for each joint."""
        made: Array = z.copy()
        series = self._shapes.series
        for i, (use, most) in enumerate(zip(self._use, self._most)):
            used = use @ z[series, i]
            # Rows that the trust region keeps anyway are left out.
            row = np.abs(used) + trust * scale[i] * most > 1.0
            program = milp(
                -gradient[series, i], bounds=Box(-trust, trust), constraints=LinearConstraint(
                    scale[i] * use[row], np.minimum(-1.0 - used[row], 0.0),
                    np.maximum(1.0 - used[row], 0.0)))
            if program.x is not None:
                made[series, i] += scale[i] * program.x
        return made


def _differences(margin: Margin, state: Array) -> Array:
    """Return the derivatives of a margin by position, velocity and acceleration, (3, n)."""
    result: Array = np.zeros_like(state)
    for index in np.ndindex(*state.shape):
        shift = np.zeros_like(state)
        shift[index] = _STEP
        result[index] = (margin.at(*(state + shift)) - margin.at(*(state - shift))) / (2.0 * _STEP)
    return result

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
Stability margins of a sampled loop.

The loop is a linear law, drives and a robot of constant M.

`runs/stability.py` forms `Loops` of a parameter file and prints their `Margins`. The laws come
from `linear_law.py`. A loop is stable for the eigenvalues ρ of M̂ M⁻¹ in an interval.
docs/theory.md has the loop (XL2), and the small-gain theorem (MG1) for errors that vary.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import dataclasses
from functools import cached_property
from typing import NamedTuple

from ctc_chattering.dynamics.drive_response import discretize_drives
from ctc_chattering.margins.linear_law import LinearLaw
from ctc_chattering.numerics.linear_algebra import Array, peak_gain
import numpy as np

#: Eigenvalues of M̂ M⁻¹, and factors of rotors or masses, that are examined.
RATIO_GRID = np.geomspace(0.01, 100.0, 200)
#: Ratios M̂ M⁻¹ for which tolerated lags and delays are computed.
RATIOS = (1.0, 0.8, 1.25)
#: Centres c of (MG1) with which the search begins.
_CENTRES = np.geomspace(0.4, 2.5, 20)
#: s of (XL2). Its value has little influence.
_SCALE = 3.0
#: Delays beyond that of the loop that are examined [samples].
_MORE_DELAYS = 20


class StableRange(NamedTuple):
    """An interval in which a loop is stable."""

    low: float
    high: float


def stable_range(
        radius: Callable[[float], float],
        start: float,
        grid: Array) -> StableRange | None:
    """
    Return the range with a radius below 1.

    It is around `start` and within a rising grid. None if it is empty.
    """
    if not radius(start) < 1.0:
        return None
    below = np.flip(grid[grid < start])
    above = grid[grid > start]
    return StableRange(
        _last_stable(radius, start, below),
        _last_stable(radius, start, above))


def _last_stable(radius: Callable[[float], float], start: float, side: Array) -> float:
    """Return the end of the range on one side of `start`."""
    from scipy.optimize import bisect  # type: ignore[import-untyped]  # Takes time.

    def excess(x: float) -> float:
        return radius(x) - 1.0

    inside = start
    for x in side.tolist():
        if not radius(x) < 1.0:
            return float(bisect(excess, inside, x))
        inside = x
    return inside


class SampledLoop(NamedTuple):
    """
    The loop of (XL2).

    state⁺ = A state + E r + B w, z = C state + F r, with the reference r.
    """

    #: Shape (m, m).
    A: Array
    #: Shape (m, 2 n).
    B: Array
    #: Shape (2 n, m).
    C: Array
    #: Shape (m, inputs).
    E: Array
    #: Shape (2 n, inputs).
    F: Array

    def closed(self, ratio: float) -> Array:
        """Return the matrix for M̂ = `ratio` M, shape (m, m)."""
        return self.A + ratio * self.B @ self.C

    def driven(self, ratio: float) -> Array:
        """Return the effect of r for M̂ = `ratio` M, shape (m, inputs)."""
        return self.E + ratio * self.B @ self.F

    def gain(self, ratio: float) -> float:
        """Return the H∞ norm from w to z for M̂ = `ratio` M."""
        closed = self.closed(ratio)
        return peak_gain(closed, self.B, self.C)


class Margins(NamedTuple):
    """
    Margins of a loop.

    Attributes
    ----------
    radius : float
        Largest absolute value of a pole, for M̂ = M.
    ratios, guaranteed : StableRange or None
        Of the eigenvalues of M̂ M⁻¹, constant; varying.
    lags, delays : sequence
        For each of `RATIOS`: true lags [s], true delays in samples.

    """

    radius: float
    ratios: StableRange | None
    guaranteed: StableRange | None
    lags: tuple[StableRange | None, ...]
    delays: tuple[tuple[int, ...], ...]


@dataclasses.dataclass(frozen=True)
class Loops:
    """
    The loops of a law with a robot.

    There is one for each M̂ of its motion.

    Attributes
    ----------
    laws : sequence of LinearLaw
        With each M̂.
    masses : sequence of array, shape (n, n)
        As many M̂ [kg·m²].
    period : float
        h [s].
    lag : array, shape (n,)
        True T of the drives [s].
    delay : int
        Their true delay in samples.
    differenced : bool
        Whether the velocity is the difference of positions; exact otherwise.

    """

    laws: Sequence[LinearLaw]
    masses: Sequence[Array]
    period: float
    lag: Array
    delay: int
    differenced: bool

    @property
    def joints_are_equal(self) -> bool:
        """
        Equality of the joints.

        If so, eigenvalues of M̂ M⁻¹ decide, and one joint stands for all.
        """
        return self.masses[0].shape == (1, 1)

    @cached_property
    def sampled(self) -> list[SampledLoop]:
        """Loops of all M̂."""
        return list(map(self._close, self.laws, self.masses))

    def _close(self, law: LinearLaw, mass: Array) -> SampledLoop:
        """
        Return the loop of a law and a robot.

        `mass` is M̂, shape (n, n).
        """
        n = len(mass)
        h = self.period
        # Rows of an identity: the state, which is q, dq, torque of the drives, torques in
        # transit, last q and the memory of the law. The reference follows.
        last_q_size = n if self.differenced else 0
        sizes = [n, n, n, self.delay * n, last_q_size, len(law.A), law.E.shape[1]]
        identity = np.eye(sum(sizes))
        ends = np.cumsum(sizes)[:-1]
        q, dq, torque, transit, last_q, memory, reference = np.split(identity, ends)
        velocity = (q - last_q) / h if self.differenced else dq
        y = np.vstack([q, velocity])
        sent = law.C @ memory + law.D @ y + law.F @ reference
        commands = np.vstack([transit, sent])
        command = commands[:n]

        drives = discretize_drives(self.lag, np.full(n, np.inf), h)
        gap = torque - command
        shares = drives.decay, drives.mean, drives.weighted
        end, mean, weighted = (command + share[:, np.newaxis] * gap for share in shares)
        next_memory = law.A @ memory + law.B @ y + law.E @ reference
        A = np.vstack([
            q + h * dq,
            dq,
            end,
            commands[n:],
            q[:len(last_q)],
            next_memory])

        values, vectors = np.linalg.eigh(mass)
        scaled = vectors / np.sqrt(values)
        root = scaled @ vectors.T
        B = np.zeros((len(A), 2 * n))
        B[:n] = 0.5 * h * h * np.hstack([root, root])
        B[n:2 * n, :n] = h * root
        difference = weighted - mean
        C = np.vstack([
            root @ mean,
            root @ difference])
        scale = np.repeat([1.0, _SCALE], n)
        size = len(A)
        A, E = np.split(A, [size], axis=1)
        C, F = np.split(scale[:, np.newaxis] * C, [size], axis=1)
        return SampledLoop(A, B / scale, C, E, F)

    def radius(self, ratio: float = 1.0) -> float:
        """
        Return the largest absolute value of a pole.

        M̂ is `ratio` M.
        """
        closed = [loop.closed(ratio) for loop in self.sampled]
        poles = np.linalg.eigvals(closed)
        return float(np.abs(poles).max())

    def ratios(self) -> StableRange | None:
        """Return the stable eigenvalues of M̂ M⁻¹ around 1."""
        return stable_range(self.radius, 1.0, RATIO_GRID)

    def guaranteed(self) -> StableRange | None:
        """
        Return the widest interval of (MG1), or None.

        Its nearer end is farthest from 1, by ratio.
        """
        from scipy.optimize import minimize_scalar

        def interval(c: float) -> StableRange:
            if not self.radius(c) < 1.0:
                return StableRange(c, c)
            gains = [loop.gain(c) for loop in self.sampled]
            d = 1.0 / max(gains)
            return StableRange(c - d, c + d)

        def nearer_end(c: float) -> float:
            """Return the factor from 1 to the nearer end."""
            low, high = interval(c)
            below = 1.0 / max(low, 1e-9)
            return min(high, below)

        ends = list(map(nearer_end, _CENTRES))
        best = int(np.argmax(ends))
        near = _CENTRES[max(best - 1, 0):best + 2]
        result = minimize_scalar(
            lambda c: -nearer_end(c),
            bounds=(near[0], near[-1]),
            method='bounded',
            options={'xatol': 1e-4})
        if not result.fun < -1.0:
            return None
        return interval(float(result.x))

    def lags(self, ratio: float = 1.0) -> StableRange | None:
        """
        Return the stable true lags [s], or None.

        They are around the robot's lag, or around the shortest stable one.
        """
        def radius(lag: float) -> float:
            lags = np.full_like(self.lag, lag)
            return dataclasses.replace(self, lag=lags).radius(ratio)

        lag = float(self.lag.max())
        lateness = lag + self.period * (1 + self.delay)
        grid = np.linspace(0.0, 20.0 * lateness, 200)
        candidates = (lag, *grid.tolist())
        stable = (
            x for x in candidates
            if radius(x) < 1.0)
        start = next(stable, lag)
        return stable_range(radius, start, grid)

    def delays(self, ratio: float = 1.0) -> tuple[int, ...]:
        """Return the true delays with stable poles [samples]."""
        def radius(delay: int) -> float:
            return dataclasses.replace(self, delay=delay).radius(ratio)

        candidates = range(self.delay + _MORE_DELAYS)
        return tuple(
            delay for delay in candidates
            if radius(delay) < 1.0)

    def margins(self) -> Margins:
        """Compute all margins."""
        return Margins(
            radius=self.radius(),
            ratios=self.ratios(),
            guaranteed=self.guaranteed(),
            lags=tuple(map(self.lags, RATIOS)),
            delays=tuple(map(self.delays, RATIOS)))

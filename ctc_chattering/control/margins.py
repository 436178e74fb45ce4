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
Stability margins of a sampled loop of a linear law, drives and a robot of constant M.

`runs/stability.py` forms the loops of a parameter file and prints the margins. A loop is stable
for the eigenvalues ρ of M̂ M⁻¹ in an interval. With M̂ = B + R of bodies and rotors::

    rotors x R:  ρ of (B + R) (B + x R)⁻¹       masses x B:  ρ of (B + R) (x B + R)⁻¹     (AM1)
    rotors that the model lacks, per effort limit E:  ρ of M̂ (M̂ + x E)⁻¹                 (AM2)

docs/theory.md has the loop (XL2), and the small-gain theorem (MG1) for errors that vary.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import dataclasses
from functools import cached_property
from typing import NamedTuple

from ctc_chattering.control.linear_law import LinearLaw
from ctc_chattering.dynamics.drive_response import discretize_drives
from ctc_chattering.numerics.linear_algebra import Array, peak_gain
import numpy as np
from scipy.linalg import eigh  # type: ignore[import-untyped]
from scipy.optimize import bisect, minimize_scalar  # type: ignore[import-untyped]

#: Eigenvalues of M̂ M⁻¹, and factors of rotors or masses, that are examined.
_RATIO_GRID = np.geomspace(0.01, 100.0, 200)
#: Rotors per effort limit that are examined [kg·m² per N·m].
_ROTOR_GRID = np.geomspace(1e-6, 0.1, 200)
#: Centres c of (MG1) with which the search begins.
_CENTRES = np.geomspace(0.4, 2.5, 20)
#: s of (XL2). Its value has little influence.
_SCALE = 3.0
#: Ratios M̂ M⁻¹ for which tolerated lags and delays are computed.
RATIOS = (1.0, 0.8, 1.25)


class StableRange(NamedTuple):
    """An interval in which a loop is stable."""

    low: float
    high: float


class SampledLoop(NamedTuple):
    """The loop of (XL2): state⁺ = A state + B w, z = C state."""

    #: Shape (m, m).
    A: Array
    #: Shape (m, 2 n).
    B: Array
    #: Shape (2 n, m).
    C: Array

    def closed(self, ratio: float) -> Array:
        """Return the matrix of the loop for M̂ = `ratio` M, shape (m, m)."""
        return self.A + ratio * self.B @ self.C


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
    The loops of a law with a robot, one for each M̂ of its motion.

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
        """Return whether one joint stands for all, so that eigenvalues of M̂ M⁻¹ decide."""
        return self.masses[0].shape == (1, 1)

    @cached_property
    def sampled(self) -> list[SampledLoop]:
        """Loops of all M̂."""
        return [self._loop(law, mass) for law, mass in zip(self.laws, self.masses)]

    def _loop(self, law: LinearLaw, mass: Array) -> SampledLoop:
        """Return the loop of a law and a robot with M̂ = `mass`, shape (n, n)."""
        n, h, delay, m = len(mass), self.period, self.delay, len(law.A)
        drives = discretize_drives(self.lag, np.full(n, np.inf), h)
        # State: q, dq, torque of the drives, torques in transit, last q, memory of the law.
        sizes = [n, n, n, delay * n, n if self.differenced else 0, m]
        q, dq, torque, transit, last_q, memory = np.split(
            np.eye(sum(sizes)), np.cumsum(np.array(sizes))[:-1])
        y = np.vstack([q, (q - last_q) / h if self.differenced else dq])
        sent = law.C @ memory + law.D @ y
        commands = np.vstack([transit, sent])
        command = commands[:n]
        gap = torque - command
        mean = command + drives.mean[:, np.newaxis] * gap
        weighted = command + drives.weighted[:, np.newaxis] * gap
        values, vectors = np.linalg.eigh(mass)
        root = vectors / np.sqrt(values) @ vectors.T
        B = np.zeros((sum(sizes), 2 * n))
        B[:n, :n] = B[:n, n:] = 0.5 * h * h * root
        B[n:2 * n, :n] = h * root
        scale = np.array([1.0] * n + [_SCALE] * n)
        return SampledLoop(
            np.vstack([q + h * dq, dq, command + drives.decay[:, np.newaxis] * gap, commands[n:],
                       q[:len(last_q)], law.A @ memory + law.B @ y]),
            B / scale, scale[:, np.newaxis] * np.vstack([root @ mean, root @ (weighted - mean)]))

    def radius(self, ratio: float = 1.0) -> float:
        """Return the largest absolute value of a pole for M̂ = `ratio` M."""
        return max(float(np.abs(np.linalg.eigvals(x.closed(ratio))).max()) for x in self.sampled)

    def ratios(self) -> StableRange | None:
        """Return the eigenvalues of M̂ M⁻¹ around 1 for which all poles are stable."""
        return stable_range(self.radius, 1.0, _RATIO_GRID)

    def guaranteed(self) -> StableRange | None:
        """Return the interval of (MG1) whose nearer end is farthest from 1, by ratio; or None."""

        def interval(c: float) -> StableRange:
            d = 0.0
            if self.radius(c) < 1.0:
                d = min(1.0 / peak_gain(x.closed(c), x.B, x.C) for x in self.sampled)
            return StableRange(c - d, c + d)

        def nearer_end(c: float) -> float:
            """Return the factor from 1 to the nearer end, below 1 if 1 is outside."""
            low, high = interval(c)
            return min(high, 1.0 / max(low, 1e-9))

        best = int(np.argmax([nearer_end(c) for c in _CENTRES]))
        bounds = _CENTRES[[max(best - 1, 0), min(best + 1, len(_CENTRES) - 1)]]
        result = minimize_scalar(
            lambda c: -nearer_end(c), bounds=bounds, method='bounded', options={'xatol': 1e-4})
        return interval(float(result.x)) if result.fun < -1.0 else None

    def lags(self, ratio: float = 1.0) -> StableRange | None:
        """
        Return the true lags [s] for which all poles are stable; None if there is none.

        They are around the robot's lag, or around the shortest stable one.
        """
        def radius(lag: float) -> float:
            return dataclasses.replace(self, lag=np.full_like(self.lag, lag)).radius(ratio)
        lag = float(self.lag.max())
        grid = np.linspace(0.0, 20.0 * (lag + self.period * (1 + self.delay)), 200)
        start = next((x for x in (lag, *grid.tolist()) if radius(x) < 1.0), lag)
        return stable_range(radius, start, grid)

    def delays(self, ratio: float = 1.0) -> tuple[int, ...]:
        """Return the true delays, in samples, for which all poles are stable."""
        return tuple(d for d in range(self.delay + 20)
                     if dataclasses.replace(self, delay=d).radius(ratio) < 1.0)

    def margins(self) -> Margins:
        """Return all margins."""
        return Margins(self.radius(), self.ratios(), self.guaranteed(),
                       tuple(map(self.lags, RATIOS)), tuple(map(self.delays, RATIOS)))


def stable_range(radius: Callable[[float], float], start: float, grid: Array
                 ) -> StableRange | None:
    """Return the range around `start`, within a grid, with a radius below 1; None if empty."""
    if not radius(start) < 1.0:
        return None
    ends = []
    for side in (np.flip(grid[grid < start]), grid[grid > start]):
        inside = start
        for x in side.tolist():
            if not radius(x) < 1.0:
                inside = bisect(lambda y: radius(y) - 1.0, inside, x)
                break
            inside = x
        ends.append(inside)
    return StableRange(*ends)


class ArmMargins(NamedTuple):
    """
    Inertias of an arm for which its loop is stable; None where it does not apply, or none is.

    Attributes
    ----------
    rotors : StableRange or None
        Rotors over those of the model.
    lacking : float or None
        Largest rotors per effort limit where the model has none [kg·m² per N·m].
    masses : StableRange or None
        Masses of all bodies over those of the model.

    """

    rotors: StableRange | None
    lacking: float | None
    masses: StableRange | None


class ArmInertia(NamedTuple):
    """Inertias of an arm."""

    #: M of the bodies at positions [kg·m²], each of shape (n, n).
    bodies: Sequence[Array]
    #: Rotors [kg·m²] and effort limits [N·m], diagonal matrices.
    rotors: Array
    effort: Array

    def margins(self, ratios: StableRange | None) -> ArmMargins:
        """Return the inertias for which the eigenvalues of M̂ M⁻¹ are within `ratios`."""
        if ratios is None:
            return ArmMargins(None, None, None)
        rotors = lacking = None
        if self.rotors.any():
            rotors = self._range(ratios, lambda body, x: body + x * self.rotors)
        elif np.isfinite(self.effort).all():
            added = self._range(ratios, lambda body, x: body + x * self.effort, _ROTOR_GRID[0],
                                _ROTOR_GRID)
            lacking = added.high if added else 0.0
        masses = self._range(ratios, lambda body, x: x * body + self.rotors)
        return ArmMargins(rotors, lacking, masses)

    def _range(self, ratios: StableRange, actual: Callable[[Array, float], Array],
               start: float = 1.0, grid: Array = _RATIO_GRID) -> StableRange | None:
        """Return the numbers for which the eigenvalues are within `ratios`."""
        def excess(x: float) -> float:
            return max(_excess(ratios, body + self.rotors, actual(body, x))
                       for body in self.bodies)
        return stable_range(excess, start, grid)


def _excess(ratios: StableRange, assumed: Array, actual: Array) -> float:
    """Return by which ratio the eigenvalues of M̂ M⁻¹ exceed an interval; below 1 inside."""
    eigenvalues = eigh(assumed, actual, eigvals_only=True)
    return float(max(eigenvalues[-1] / ratios.high, ratios.low / eigenvalues[0]))

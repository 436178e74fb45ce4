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
Rotors and masses of an arm with a stable loop.

`runs/arm_margins.py` makes an `ArmInertia` from the model of an arm, and passes the eigenvalues of
M̂ M⁻¹ that `Loops.ratios` allows. With M̂ = B + R of bodies and rotors::

    rotors x R:  ρ of (B + R) (B + x R)⁻¹       masses x B:  ρ of (B + R) (x B + R)⁻¹     (AM1)
    rotors that the model lacks, per effort limit E:  ρ of M̂ (M̂ + x E)⁻¹                 (AM2)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from ctc_chattering.margins.loop_margins import RATIO_GRID, stable_range, StableRange
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.linalg import eigh  # type: ignore[import-untyped]

#: Rotors per effort limit that are examined [kg·m² per N·m].
_ROTOR_GRID = np.geomspace(1e-6, 0.1, 200)


class ArmMargins(NamedTuple):
    """
    Inertias of an arm with a stable loop.

    A margin is None where it does not apply, or where no inertia is stable.

    Attributes
    ----------
    rotors : StableRange or None
        Rotors over those of the model.
    lacking : float or None
        Largest rotors per effort limit where the model has none [kg·m² per N·m].
    masses : StableRange or None
        Masses of all bodies over those of the model.

    """

    rotors: StableRange | None = None
    lacking: float | None = None
    masses: StableRange | None = None


class ArmInertia(NamedTuple):
    """Inertias of an arm."""

    #: M of the bodies at positions [kg·m²], each of shape (n, n).
    bodies: Sequence[Array]
    #: Rotors [kg·m²], a diagonal matrix.
    rotors: Array
    #: Effort limits [N·m], a diagonal matrix.
    effort: Array

    def margins(self, ratios: StableRange | None) -> ArmMargins:
        """Return the inertias with eigenvalues of M̂ M⁻¹ within `ratios`."""
        if ratios is None:
            return ArmMargins()
        rotors = lacking = None
        if self.rotors.any():
            rotors = self._range(ratios, lambda body, x: body + x * self.rotors)
        elif np.isfinite(self.effort).all():
            lacking = self._largest_lacking(ratios)
        masses = self._range(ratios, lambda body, x: x * body + self.rotors)
        return ArmMargins(rotors, lacking, masses)

    def _largest_lacking(self, ratios: StableRange) -> float:
        """Return the largest rotors of (AM2)."""
        added = self._range(
            ratios,
            lambda body, x: body + x * self.effort,
            _ROTOR_GRID[0],
            _ROTOR_GRID)
        return added.high if added else 0.0

    def _range(
            self,
            ratios: StableRange,
            actual: Callable[[Array, float], Array],
            start: float = 1.0,
            grid: Array = RATIO_GRID) -> StableRange | None:
        """Return the numbers with eigenvalues within `ratios`."""

        def excess(x: float) -> float:
            return max(_excess(ratios, body + self.rotors, actual(body, x))
                       for body in self.bodies)

        return stable_range(excess, start, grid)


def _excess(ratios: StableRange, assumed: Array, actual: Array) -> float:
    """
    Return the ratio by which eigenvalues exceed an interval.

    It is below 1 inside.
    """
    eigenvalues = eigh(assumed, actual, eigvals_only=True)
    highest = eigenvalues[-1] / ratios.high
    lowest = ratios.low / eigenvalues[0]
    return float(max(highest, lowest))

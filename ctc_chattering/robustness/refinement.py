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
Points of a map near the boundary between failing and passing.

The grid is first run at every 2ᴸth value of its axes. A cell of points that were run, of any size,
is mixed if some of the points in it or on its sides fail and others do not; mixed cells are halved
along all axes until their points are neighbours in the grid. A point on the side that two cells
share counts for both, so that a boundary is followed from cell to cell once a point of the coarse
grid is on each side of it. What lies within a cell, or reaches into it between points that were
run, is not found if all of these agree.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ctc_chattering.robustness.runs import Runs
import numpy as np
import numpy.typing as npt

Mask = npt.NDArray[np.bool_]
#: Of a point: not run yet, less than half of its runs fail, half or more.
UNKNOWN, PASSES, FAILS = -1, 0, 1


def wanted(state: npt.NDArray[np.int8], coarse: tuple[int, ...]) -> Mask:
    """
    Return which points of a grid to run next; none when the boundary is found.

    Parameters
    ----------
    state : array
        `UNKNOWN`, `PASSES` or `FAILS` of each point.
    coarse : tuple of int
        Of each axis, the step of the coarse grid, 1 or the same power of two.

    """
    found: Mask = np.zeros(state.shape, bool)
    unknown: Mask = state == UNKNOWN
    found[tuple(slice(None, None, step) for step in coarse)] = True
    if unknown[found].any():
        return np.logical_and(found, unknown)
    steps = np.array(coarse)
    while (steps > 1).any():
        for cell in np.argwhere(_mixed(state, steps)):
            first = cell * steps
            found[tuple(slice(a, a + step + (step > 1), max(step // 2, 1))
                        for a, step in zip(first.tolist(), steps.tolist()))] = True
        steps = np.maximum(steps // 2, 1)
    return np.logical_and(found, unknown)


def _mixed(state: npt.NDArray[np.int8], steps: npt.NDArray[np.int_]) -> Mask:
    """Return which cells of a size were run at their corners, and fail in part."""
    sizes = np.where(steps > 1, steps + 1, 1)
    cells: Any = np.lib.stride_tricks.sliding_window_view(state, tuple(sizes.tolist()))
    cells = cells[tuple(slice(None, None, step) for step in steps.tolist())]
    within = tuple(range(state.ndim, 2 * state.ndim))
    at_corners: Any = (Ellipsis, *(slice(None, None, step) for step in steps.tolist()))
    corners = cells[at_corners]
    mixed: Mask = ((cells == PASSES).any(axis=within) & (cells == FAILS).any(axis=within)
                   & (corners != UNKNOWN).all(axis=within))
    return mixed


class Refinement:
    """
    Which runs of a map come next, by what came of those before; all at once if it is not refined.

    Parameters
    ----------
    runs : Runs
        Of the map.

    """

    def __init__(self, runs: Runs) -> None:
        self._runs, self._taken = runs, False
        self._state: npt.NDArray[np.int8] | None = None
        if runs.spec.refined:
            self._state = np.full((len(runs.spec.variants), *runs.spec.shape), UNKNOWN, np.int8)

    def numbers(self) -> Sequence[int]:
        """Return the next runs, ascending; none when the boundary of every law is found."""
        if self._state is None:
            return range(0 if self._taken else len(self._runs))
        laws, repeats = len(self._state), self._runs.spec.repeats.repeats
        firsts = np.concatenate([
            (np.flatnonzero(wanted(state, self._runs.spec.coarse)) * laws + v) * repeats
            for v, state in enumerate(self._state)])
        found: list[int] = (np.sort(firsts)[:, np.newaxis] + np.arange(repeats)).ravel().tolist()
        return found

    def take(self, rows: Callable[[], Any]) -> None:
        """Take the rows of what `numbers` returned, a pyarrow table, if they are needed."""
        self._taken = True
        if self._state is None:
            return
        table, repeats = rows(), self._runs.spec.repeats.repeats
        place, index = np.unique(np.asarray(table['run']) // repeats, return_inverse=True)
        failed = np.bincount(index, np.asarray(table['failure'].to_pylist()) != '')
        point, variant = np.divmod(place, len(self._state))
        self._state.reshape(len(self._state), -1)[variant, point] = np.where(
            2 * failed >= repeats, FAILS, PASSES)

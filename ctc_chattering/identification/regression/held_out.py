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

"""Whether corrected bodies explain windows better that they were not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses

from ctc_chattering.errors import CtcError
from ctc_chattering.identification.regression.attribution import Explanation, Projected
from ctc_chattering.identification.regression.causes import DRIVE
from ctc_chattering.identification.regression.error_columns import ErrorColumns
from ctc_chattering.identification.regression.estimated_bodies import body_estimate
from ctc_chattering.identification.regression.least_squares import Data, Term
from ctc_chattering.identification.regression.physical_consistency import consistent
from ctc_chattering.identification.regression.selection import drive_terms
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Part of a joint's torque that counts as left in any case: below it nothing is worse.
_TRIFLE = 1e-3


def left_over(data: Data, terms: Sequence[Term], columns: ErrorColumns,
              scales: Explanation | None) -> Array:
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
            change = consistent(estimate).found - estimate.known if estimate else None
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
        length = np.sqrt(np.square(x).sum(axis=0))
        x = x / np.where(length > 0.0, length, 1.0)
        rest = y - x @ np.linalg.lstsq(x, y, rcond=1e-9)[0]
        trifle = _TRIFLE ** 2 * float(np.square(data.torque[used, i]).mean())
        before, after = np.sqrt(np.square(rest).mean(axis=0) + trifle)
        found[i] = after / before if before > 0.0 else 1.0
    return found

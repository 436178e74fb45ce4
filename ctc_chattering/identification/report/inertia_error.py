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

"""Where the model's inertia is so wrong that gains for it would be for another robot."""

from __future__ import annotations

from collections.abc import Iterator

from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.regression.finding import Finding, Severity
from ctc_chattering.identification.regression.identify import Identification
from ctc_chattering.identification.regression.least_squares import TermKind
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: The most by which the inertia may be too small or too large: a usual margin of gain.
_MOST = 2.0
#: Poses that are looked at.
_POSES = 20


def inertia_findings(found: Identification, model: Model, positions: Array) -> Iterator[Finding]:
    """
    Yield the joints whose inertia the model has wrong by more than a loop stands.

    Parameters
    ----------
    found : Identification
        With errors of the model.
    model : Model
        As `identify` had it.
    positions : ndarray, shape (N, n)
        Of the run [rad].

    """
    for i, (low, high) in enumerate(_ratios(found, model, positions)):
        if low > _MOST or high < 1.0 / _MOST:
            yield Finding(
                Severity.REFUSED, i, f'the inertia about it is {0.5 * (low + high):.3g} times '
                f'that of the model, allowed for gains: {1.0 / _MOST:g} to {_MOST:g}',
                'correct the description: rotor inertia, masses and inertias')


def _ratios(found: Identification, model: Model, positions: Array) -> Array:
    """Return the interval of M_ii of the robot over that of the model, shape (n, 2)."""
    fit, spread, n = found.selected.fit, found.selected.spread, model.n
    mine = [k for k, term in enumerate(fit.terms) if term.kind == TermKind.MODEL]
    if not mine or found.columns is None:
        return np.ones((n, 2))
    mixing = found.selected.mixing[:, [int(fit.terms[k].which) for k in mine]]
    covariance, zero = spread.covariance[np.ix_(mine, mine)], np.zeros(n)
    ratios = []
    for q in positions[::max(1, len(positions) // _POSES)]:
        mass = np.diagonal(model.mass_matrix(q.tolist()))
        rest = found.columns.at(q, zero, zero)
        columns = np.array([(found.columns.at(q, zero, x) - rest)[i]
                            for i, x in enumerate(np.eye(n))]) @ mixing
        half = spread.factor * np.sqrt(np.maximum(
            np.einsum('np,pq,nq->n', columns, covariance, columns), 0.0))
        change = columns @ fit.value[mine]
        ratios.append(1.0 + np.stack((change - half, change + half), axis=1) / mass[:, None])
    middle: Array = np.median(ratios, axis=0)
    return middle

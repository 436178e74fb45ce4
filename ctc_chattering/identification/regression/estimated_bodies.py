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

"""The inertial parameters of a robot's bodies from the regression, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Sequence

from ctc_chattering.errors import CtcError
from ctc_chattering.identification.regression.attribution import Explanation, Projected
from ctc_chattering.identification.regression.body_estimate import BodyEstimate
from ctc_chattering.identification.regression.finding import ALL_JOINTS, Finding, Severity
from ctc_chattering.identification.regression.physical_bounds import physical_findings
from ctc_chattering.identification.regression.physical_consistency import (
    consistent,
    ConsistentBodies,
)
import numpy as np

#: Singular value below which an error as large as its size is less than noise.
_SEEN = 1.0


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
    p = columns.count
    if p != 10 * n or not projected.joints:
        return None
    sizes, prior = columns.sizes, columns.prior
    blocks, right = projected.whole(found)
    root = np.concatenate(blocks)
    u, s, v = np.linalg.svd(root * sizes, full_matrices=False)
    seen = s > _SEEN
    x = prior + sizes * (v[seen].T @ (u[:, seen].T @ right / s[seen]))
    torque = np.zeros((n, len(x), len(x)))
    for i, block, power in zip(projected.joints, blocks, projected.powers):
        torque[i] = block.T @ block / power
    return BodyEstimate(
        tuple(names), prior[:p].reshape(n, 10), x[:p].reshape(n, 10),
        (v[seen].T * np.square(s[seen]) @ v[seen]) / np.outer(sizes, sizes), prior[p:p + n],
        x[p:p + n], torque, prior[p + n:], x[p + n:], columns.gravity)


def judged(estimate: BodyEstimate | None, joints: Sequence[str], friction: Sequence[float]
           ) -> tuple[ConsistentBodies | None, tuple[Finding, ...]]:
    """Return bodies that can be, and findings; None without an estimate, or without a solver."""
    if estimate is None:
        return None, ()
    try:
        bodies = consistent(estimate)
    except CtcError as error:
        return None, (Finding(Severity.NOTE, ALL_JOINTS, f'no corrected URDF: {error}'),)
    return bodies, tuple(physical_findings(bodies, joints, friction))

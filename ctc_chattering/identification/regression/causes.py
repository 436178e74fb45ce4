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
Causes that an error of the model may have, each with few numbers: what is looked for by name.

A cause is a function of its numbers that gives the parameters x of `ErrorColumns`, and is 0
without it. A torque that is off by a factor is in the torque itself, and no x.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.identification.regression.error_columns import ErrorColumns
from ctc_chattering.identification.regression.model_errors import ModelError
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

#: In place of an index: of all joints, or all masses.
ALL = -1
#: Part of the size of a number by which it is changed for a derivative.
_STEP = 1e-3
#: Part of the largest of its columns below which one is rounding.
_ROUNDING = 1e-9


class CauseKind(Enum):
    """What a cause is."""

    SCALE = 'torque scale'
    DEAD_BAND = 'dead band'
    FADING = 'fading torque'
    MASSES = 'all masses'
    GRAVITY = 'direction of gravity'
    ROTOR = 'rotor inertia'
    LINK = 'mass'
    CENTRE = 'centre of mass'
    BODY = 'mass, centre and inertia'


#: What a drive makes of its command: columns beside those of the model's errors.
DRIVE = (CauseKind.SCALE, CauseKind.DEAD_BAND, CauseKind.FADING)


class Cause(NamedTuple):
    """
    A cause.

    Attributes
    ----------
    kind : CauseKind
        What it is.
    which : int
        Joint, body or candidate; `ALL` for all.
    size : ndarray, shape (k,)
        How large its numbers are roughly.
    direction : ndarray, shape (p + n + 3,) or (3,)
        x of a candidate for 1; across a planar arm, for the gravity there; empty for others.

    """

    kind: CauseKind
    which: int
    size: Array
    direction: Array = np.zeros(0)

    def errors(self, columns: ErrorColumns, value: Array) -> Array:
        """Return x for these numbers, shape (p + n + 3,)."""
        x = np.zeros(len(columns.sizes))
        p, i = columns.count, self.which
        body = slice(10 * i, 10 * i + 10)
        if self.kind == CauseKind.LINK:
            x = value[0] * self.direction
        elif self.kind == CauseKind.MASSES:
            x[:p] = value[0] * columns.prior[:p]
        elif self.kind == CauseKind.ROTOR:
            x[p + np.arange(len(value)) if i == ALL else [p + i]] = value
        elif self.kind == CauseKind.BODY:
            x[body] = value
        elif self.kind == CauseKind.CENTRE:
            x[body] = _moved(columns.prior[body], value) - columns.prior[body]
        elif self.kind == CauseKind.GRAVITY:
            down = columns.prior[-3:]
            if len(self.direction):
                # A base that leans across the plane of the arm lessens gravity in the plane.
                inside = down - self.direction * (self.direction @ down)
                turn = Rotation.from_rotvec(value[0] * self.direction)
                x[-3:] = (1.0 - value[1]) * turn.apply(inside) - inside
            else:
                x[-3:] = Rotation.from_rotvec([*value, 0.0]).apply(down) - down
        return x

    def design(self, columns: ErrorColumns, value: Array) -> Array:
        """
        Return the coefficients of the columns for each number, shape (m, k).

        For these numbers they are exact, and for others the derivative.
        """
        here = self.errors(columns, value)
        slopes = [(self.errors(columns, value + step) - self.errors(columns, value - step))
                  / (2.0 * step.sum()) for step in np.diag(_STEP * self.size)]
        jacobian = np.stack(slopes, axis=1)
        power = float(value @ value)
        if power > 0.0:
            jacobian += np.outer(here - jacobian @ value, value) / power
        found = columns.coordinates(jacobian)
        # What no motion shows, as a turn about an axis in the plane of an arm, is rounding.
        length = np.linalg.norm(found * self.size, axis=0)
        return np.where(length > _ROUNDING * length.max(initial=0.0), found, 0.0)


def _moved(body: Array, shift: Array) -> Array:
    """Return the ten parameters of a body whose centre of mass is moved [m]."""
    mass, first = body[0], body[1:4]
    after = first + mass * shift
    if mass <= 0.0:
        return body

    def about(c: Array) -> Array:
        inertia: Array = (c @ c * np.eye(3) - np.outer(c, c)) / mass
        found: Array = inertia[(0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)]
        return found
    return np.concatenate(([mass], after, body[4:] - about(first) + about(after)))


def causes(columns: ErrorColumns | None, joints: int, candidates: Sequence[ModelError],
           torque: Array) -> list[Cause]:
    """
    Return all causes that are looked for, those with fewer numbers first.

    Parameters
    ----------
    columns : ErrorColumns or None
        Of the model.
    joints : int
        n.
    candidates : sequence of ModelError
        Masses that may be off.
    torque : ndarray, shape (n,)
        Root mean square of each joint's [N·m].

    """
    scales = [Cause(CauseKind.SCALE, i, np.full(1, 0.1)) for i in (ALL, *range(joints))]
    if columns is None:
        return []
    p, sizes = columns.count, columns.sizes
    found = [*scales, *(Cause(CauseKind.ROTOR, i, sizes[p + i:p + i + 1]) for i in range(joints))]
    found.append(Cause(CauseKind.ROTOR, ALL, sizes[p:p + joints]))
    for k, direction in enumerate(columns.directions([x.model for x in candidates])):
        if direction is not None:
            found.append(Cause(CauseKind.LINK, k, np.full(1, 0.1), direction))
    found.append(Cause(CauseKind.MASSES, ALL, np.full(1, 0.1)))
    across = columns.across()
    found.append(Cause(CauseKind.GRAVITY, ALL, np.array([0.1, 0.01 if len(across) else 0.1]),
                       across))
    if isinstance(columns.model, UrdfModel):
        found += [Cause(CauseKind.CENTRE, i, np.full(3, 0.01)) for i in range(joints)]
        found += [Cause(CauseKind.BODY, i, sizes[10 * i:10 * i + 10]) for i in range(joints)]
    for kind, size in ((CauseKind.DEAD_BAND, 0.02 * torque),
                       (CauseKind.FADING, 0.05 / np.maximum(torque, 1e-12))):
        found += [Cause(kind, i, size[i:i + 1]) for i in range(joints)]
        found.append(Cause(kind, ALL, size))
    return found

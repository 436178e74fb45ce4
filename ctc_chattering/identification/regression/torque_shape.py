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
A torque signal compared with the model, joint by joint, and with the order of the joints.

Weight, inertial torque and friction are free columns, so that errors of the model change little.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import NamedTuple

from ctc_chattering.analysis.recording import Stretch
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.regression.intervals import correlation_length
from ctc_chattering.identification.regression.rows import Rows
from ctc_chattering.identification.regression.torque import has
from ctc_chattering.identification.regression.weak_form import TestFunction
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.optimize import linear_sum_assignment  # type: ignore[import-untyped]

#: Fewest and most windows of a joint that are used.
_FEWEST, _MOST = 30, 4000
#: Part of a signal's variance that may be left for it to say something.
_UNEXPLAINED = 0.3
#: Ratio of the variances left, in the order given and in the one found, on each moved joint.
_CLEARLY = 4.0
#: Weight, as a part of the torque, that counts as none.
_NOTHING = 1e-6
#: Part of the variance that counts as explained altogether.
_ALL = 1e-4


class TorqueShape(NamedTuple):
    """
    A torque by what explains it; n joints, nan where a joint does not tell.

    Attributes
    ----------
    weight, inertia : ndarray, shape (n,)
        Part of the model's weight, and of its inertial torque.
    weight_error, inertia_error : ndarray, shape (n,)
        Their standard errors.
    friction, friction_error : ndarray, shape (n,)
        Coulomb friction and viscous friction at the RMS velocity, and its standard error [N·m].
    size, load : ndarray, shape (n,)
        RMS of the torque, and of the model's weight [N·m].

    """

    weight: Array
    inertia: Array
    weight_error: Array
    inertia_error: Array
    friction: Array
    friction_error: Array
    size: Array
    load: Array


@dataclasses.dataclass(frozen=True)
class TorqueWindows:
    """
    What may explain a torque in J windows of n joints.

    Attributes
    ----------
    way, weight, inertia, velocity : ndarray, shape (J, n)
        Direction of sliding, parts of the model's torque [N·m], and velocity [rad/s].

    """

    way: Array
    weight: Array
    inertia: Array
    velocity: Array

    @classmethod
    def of(cls, rows: Sequence[Rows]) -> TorqueWindows:
        """Return those of stretches."""
        way, base, weight, velocity = (
            np.concatenate([getattr(part, name) for part in rows])
            for name in ('way', 'base', 'gravity', 'velocity'))
        return cls(way, weight, base - weight, velocity)

    def shape(self, torque: Array) -> TorqueShape:
        """Return what explains a torque, by windows and joints [N·m], nan where unknown."""
        found = np.full((len(TorqueShape._fields), torque.shape[1]), np.nan)
        for i, y in enumerate(torque.T):
            x, y = self._columns(i, y)
            if len(y) < _FEWEST:
                continue
            value, rest, errors = _solved(x, y)
            if rest.dot(rest) > _UNEXPLAINED * np.square(y - y.mean()).sum():
                continue
            speed = float(np.sqrt(np.square(x[:, 3]).mean()))
            found[:, i] = (value[0], value[1], errors[0], errors[1], value[2] + value[3] * speed,
                           np.hypot(errors[2], errors[3] * speed), np.sqrt(np.square(y).mean()),
                           np.sqrt(np.square(x[:, 0]).mean()))
        return TorqueShape(*found)

    def check_order(self, torque: Array, joints: Sequence[str]) -> None:
        """Raise `CtcError` if the columns of a torque fit other joints better."""
        moving = [i for i in range(len(joints))
                  if len(self._columns(i, torque[:, i])[1]) >= _FEWEST
                  and np.nanstd(torque[:, i]) > 0.0]
        left = np.array([[self._left(i, torque[:, column]) for i in moving]
                         for column in moving])
        if len(moving) < 2:
            return
        _, fitting = linear_sum_assignment(np.log(left))
        given, best = left.diagonal(), left[np.arange(len(moving)), fitting]
        moved = fitting != np.arange(len(moving))
        if (moved.any() and (best[moved] < _UNEXPLAINED).all()
                and np.log(given[moved] / best[moved]).mean() > np.log(_CLEARLY)):
            order = list(joints)
            for column, i in zip(moving, fitting):
                order[column] = joints[moving[i]]
            raise CtcError(
                f'the commands do not fit the joints in the order {",".join(joints)}: they leave '
                f"{given[moved].max():.0%} of a joint's torque unexplained, and "
                f'{best[moved].max():.0%} in the order that fits: --joints {",".join(order)}')

    def _columns(self, i: int, y: Array) -> tuple[Array, Array]:
        """Return the columns of joint i, shape (rows, 5), and y where it slides and y is known."""
        used = np.flatnonzero((self.way[:, i] != 0.0) & np.isfinite(y))
        used = used[::len(used) // _MOST + 1]
        return np.column_stack([
            self.weight[used, i], self.inertia[used, i], self.way[used, i],
            self.velocity[used, i], np.ones(len(used))]), y[used]

    def _left(self, i: int, y: Array) -> float:
        """Return which part of the variance of y the columns of joint i leave."""
        x, y = self._columns(i, y)
        whole = float(np.square(y - y.mean()).sum()) if len(y) else 0.0
        if len(y) < _FEWEST or whole <= 0.0:
            return 1.0
        _, rest, _ = _solved(x, y)
        return max(_ALL, float(rest.dot(rest)) / whole)


def _solved(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Return coefficients, residuals and standard errors; an error is inf where none is told."""
    length = np.sqrt(np.square(x).sum(axis=0))
    length[:2][length[:2] < _NOTHING * np.linalg.norm(y)] = 0.0
    scaled = np.where(length > 0.0, x / np.where(length > 0.0, length, 1.0), 0.0)
    u, s, vt = np.linalg.svd(scaled, full_matrices=False)
    kept = s > 1e-6 * s[0]
    value = vt[kept].T @ ((u[:, kept].T @ y) / s[kept])
    rest = y - scaled @ value
    variance = float(rest.dot(rest)) / len(y) * max(1.0, correlation_length(rest))
    errors = np.sqrt(variance * np.square(vt[kept].T / s[kept]).sum(axis=1))
    # What a direction without data contains is not told.
    told = (length > 0.0) & (np.square(vt[~kept]).sum(axis=0) < 1e-6)
    scale = np.where(length > 0.0, length, 1.0)
    return value / scale, rest, np.where(told, errors / scale, np.inf)


def weak_torques(parts: Sequence[Stretch], rows: Sequence[Rows], phi: TestFunction, source: str
                 ) -> Array | None:
    """Return a signal over all windows, shape (J, n) [N·m], nan for unknown; None without it."""
    found = []
    for part, mine in zip(parts, rows):
        values = has(part, source)
        found.append(np.full_like(mine.base, np.nan) if values is None
                     else phi.sums(values, phi.over, mine.centres))
    torque = np.concatenate(found)
    return torque if np.isfinite(torque).any() else None

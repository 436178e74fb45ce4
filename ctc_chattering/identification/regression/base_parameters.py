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
Base parameters: the combinations of inertial parameters that have a torque of their own.

Columns of the regressor are taken from the base outwards; one that is a combination of those
before it is added to these (Gautier and Khalil, 1990; Gautier, 1991). Which of the combinations
the recorded motion shows, and how exactly, is in the covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import Any

from ctc_chattering.dynamics.model import LinearModel
from ctc_chattering.identification.regression.body_estimate import PARAMETERS
from ctc_chattering.identification.regression.estimate import Estimate
from ctc_chattering.identification.regression.physical_consistency import ConsistentBodies
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Moments of inertia, first moments and mass of a body, in the order in which they are taken.
_ORDER = (4, 5, 6, 7, 8, 9, 1, 2, 3, 0)
_UNITS = ('kg', *['kg*m'] * 3, *['kg*m^2'] * 6)
#: Random states; parts of a column, and of the longest, that are rounding; a factor that is 0.
_STATES, _DEPENDENT, _ROUNDING, _ZERO = 60, 1e-6, 1e-5, 1e-6
#: Terms of a combination that are written out.
_SHOWN = 3
#: Deviations in half an interval of 95 %.
_HALF = 1.96


@dataclasses.dataclass(frozen=True)
class BaseParameter:
    """
    A combination of inertial parameters.

    Attributes
    ----------
    body : str
        Of its first term.
    terms : tuple of (str, float)
        Names of parameters and their factors; the first one has 1.
    known : float
        As the model has it.
    found : Estimate
        As identified.

    """

    body: str
    terms: tuple[tuple[str, float], ...]
    known: float
    found: Estimate

    def __str__(self) -> str:
        """Return the combination, with the largest terms."""
        first, *more = self.terms
        text = first[0] + ''.join(f' {x:+.3g} {name}' for name, x in more[:_SHOWN])
        return text + (f' and {len(more) - _SHOWN} more' if len(more) > _SHOWN else '')

    def as_mapping(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        return {'terms': dict(self.terms), 'model': self.known, **self.found.as_mapping()}


def base_parameters(bodies: ConsistentBodies, model: LinearModel, joints: Sequence[str]
                    ) -> list[BaseParameter]:
    """
    Return the base parameters, from the base outwards, those of rotors last.

    Parameters
    ----------
    bodies : ConsistentBodies
        As identified.
    model : LinearModel
        Whose parameters they are.
    joints : sequence of str, length n
        Names.

    """
    count = len(bodies.estimate.names)
    labels = [f'{key} {name}' for name in bodies.estimate.names for key in PARAMETERS]
    labels += [f'rotor {name}' for name in joints[:len(bodies.rotor)]]
    units = [*_UNITS * count, *['kg*m^2'] * len(bodies.rotor)]
    order = [*(10 * i + k for i in range(count) for k in _ORDER),
             *range(10 * count, len(labels))]
    rows = _regressor(model, len(bodies.rotor))
    kept, factors = _grouped(rows[:, order])
    size = np.sqrt(bodies.unit.diagonal())
    found = []
    for k, row in zip(kept, factors):
        combination = np.zeros(len(size))
        combination[order] = row
        others = [i for i in np.argsort(-np.abs(combination) * size) if combination[i]
                  and i != order[k]]
        first = order[k]
        found.append(BaseParameter(
            labels[first].split(' ', 1)[1],
            ((labels[first], 1.0), *((labels[i], float(combination[i])) for i in others)),
            float(combination @ bodies.estimate.known),
            _estimate(bodies, combination, units[first])))
    return found


def _estimate(bodies: ConsistentBodies, combination: Array, unit: str) -> Estimate:
    """Return a combination with its interval, or that the motion does not show it."""
    half = _HALF * float(np.sqrt(combination @ bodies.covariance @ combination))
    size = float(np.sqrt(combination @ bodies.unit @ combination))
    if half > size:
        return Estimate.none('this motion does not show it')
    return Estimate(float(combination @ bodies.found), half, unit)


def _regressor(model: LinearModel, rotors: int) -> Array:
    """Return the regressor at random states, rows of all joints, scaled to the same length."""
    rng, rows = np.random.default_rng(0), []
    down = np.array([0.0, 0.0, -model.gravity])
    for q, dq, ddq in rng.normal(size=(_STATES, 3, model.n)):
        rows.append(np.hstack((model.torque_regressor(q, dq, ddq, down),
                               np.diag(ddq)[:, :rotors])))
    found = np.array(rows)
    length = np.sqrt(np.square(found).mean(axis=(0, 2), keepdims=True))
    found /= np.where(length > 0.0, length, 1.0)
    return found.reshape(-1, found.shape[2])


def _grouped(columns: Array) -> tuple[list[int], Array]:
    """Return the independent columns, in order, and the factors of all in each combination."""
    basis, kept = np.empty((len(columns), 0)), []
    least = _ROUNDING * np.linalg.norm(columns, axis=0).max()
    for k, column in enumerate(columns.T):
        rest = column - basis @ (basis.T @ column)
        rest -= basis @ (basis.T @ rest)
        size = float(np.linalg.norm(rest))
        if size > max(_DEPENDENT * np.linalg.norm(column), least):
            basis = np.column_stack((basis, rest / size))
            kept.append(k)
    factors = np.linalg.lstsq(columns[:, kept], columns, rcond=None)[0]
    return kept, np.where(np.abs(factors) > _ZERO, factors, 0.0)

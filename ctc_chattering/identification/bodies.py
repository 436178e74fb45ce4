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
Bodies of an arm as identified: inertial parameters, rotors, direction of gravity.

They are those of the model with the change that the regression gives. `identified_robot` writes
them into the corrected URDF, and `perturbation` bounds the error of the model with them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from functools import cached_property
from typing import Any

from ctc_chattering.dynamics.corrected_urdf import corrected_urdf
from ctc_chattering.identification.conventions import angle_between
from ctc_chattering.identification.findings import Estimate, Gap
from ctc_chattering.identification.prior import finite_efforts, LEAST_ROTOR_PER_EFFORT
from ctc_chattering.identification.regression import Fit
from ctc_chattering.identification.regressor import BodyRegressor
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: The ten parameters of a body, in Pinocchio's order: mass [kg], first moments [kg·m], and moments
#: of inertia about the joint's frame [kg·m²].
PARAMETERS = ('m', 'mx', 'my', 'mz', 'Ixx', 'Ixy', 'Iyy', 'Ixz', 'Iyz', 'Izz')
#: A rotor inertia below this part of half its interval is at its bound, 0.
BOUND = 0.01


@dataclasses.dataclass(frozen=True)
class IdentifiedBodies:
    """
    Bodies of n joints as identified, with p inertial parameters.

    Attributes
    ----------
    regressor : BodyRegressor
        Of the model that was corrected.
    fit : Fit
        With their change.
    values : ndarray, shape (p + n + 3,)
        Inertial parameters, rotor inertias [kg·m²] and gravity [m/s²].

    """

    regressor: BodyRegressor
    fit: Fit
    values: Array

    @classmethod
    def of(cls, fit: Fit, regressor: BodyRegressor) -> IdentifiedBodies:
        """Return the bodies of a fit."""
        of_model = np.append(regressor.parameters[:-3], regressor.gravity)
        values = of_model + fit.body_change()
        values[regressor.inertial_count:-3] = _assumed_rotors(fit, regressor, values)
        strength = float(np.linalg.norm(regressor.gravity))
        if strength:
            values[-3:] *= strength / np.linalg.norm(values[-3:])
            # A smaller turn of gravity is rounding.
            if angle_between(values[-3:], of_model[-3:]) < 3e-4:
                values[-3:] = of_model[-3:]
        return cls(regressor, fit, values)

    @cached_property
    def rotors(self) -> list[Estimate]:
        """
        Inertia of each rotor at the joint [kg·m²].

        The model's own is part of it.
        """
        first, estimates = self.regressor.inertial_count, []
        change = self.fit.body_change()[first:-3]
        values = self.regressor.parameters[first:-3] + change
        for i, value in enumerate(values.tolist()):
            half = half_interval_of(self.fit, first + i)
            if not half:
                estimates.append(Estimate.unknown(Gap.NOT_FELT))
                continue
            estimates.append(
                Estimate(value, half, 'kg*m^2')
                if value > BOUND * half
                else Estimate.none(gap=Gap.AT_BOUND, at_most=half, unit='kg*m^2')
            )
        return estimates

    @property
    def gravity(self) -> Array:
        """Gravity in the frame of the base, shape (3,) [m/s²]."""
        return np.asarray(self.values[-3:])

    @property
    def turn(self) -> float:
        """Angle by which the base is turned against the model [rad]."""
        of_model = self.regressor.parameters[-3:]
        return angle_between(self.gravity, of_model) if of_model.any() else 0.0

    def change_rms(self) -> Array:
        """Return the RMS of the change of torque, shape (n,) [N·m]."""
        data = self.fit.data
        torque = data.windows.bodies @ (self.values - self.regressor.parameters)
        count = np.maximum(data.used.sum(axis=0), 1)
        squares = np.square(np.where(data.used, torque, 0.0)).sum(axis=0)
        return np.asarray(np.sqrt(squares / count))

    @cached_property
    def uncertainty(self) -> float:
        """Largest error of the bodies, as a part of a joint's torque."""
        data, unknowns = self.fit.data, self.fit.unknowns
        errors = [0.0]
        for joint in np.flatnonzero(data.moving).tolist():
            columns = unknowns.columns(data, joint)[data.used[:, joint]]
            columns[:, unknowns.body_count:] = 0.0
            half = float(np.median(self.fit.half_interval(columns)))
            errors.append(half / float(data.deviation[joint]))
        return max(errors)

    def differ(self) -> bool:
        """Return whether a joint's torque changes by more than 1 %."""
        return bool((self.change_rms() > 0.01 * self.fit.data.deviation).any())

    def description(
        self, urdf: str, joints: Sequence[str], locked: Mapping[str, float] | None = None
    ) -> str:
        """Return a URDF with these bodies, rotors and turned base."""
        count = self.regressor.inertial_count
        return corrected_urdf(
            urdf,
            joints,
            self.values[:count].reshape(-1, 10),
            self.values[count:-3].tolist(),
            self.gravity.tolist(),
            locked,
        )

    def as_mapping(self, joints: Sequence[str]) -> dict[str, Any]:
        """Return gravity and the bodies as JSON has them, by joint."""
        rows = self.values[: self.regressor.inertial_count]
        is_urdf = len(rows) == len(PARAMETERS) * len(joints)
        bodies = zip(joints, rows.reshape(len(joints), -1).tolist()) if is_urdf else ()
        return {
            'gravity_mps2': self.gravity.tolist(),
            'bodies': {joint: dict(zip(PARAMETERS, row)) for joint, row in bodies},
            'bodies_uncertainty': self.uncertainty,
        }

    def torque_error(self, q: Array, dq: Array, ddq: Array) -> Array:
        """
        Return the error of the torque in a state, shape (n,) [N·m].

        It is half the interval of the torque of the bodies.
        """
        unknowns = self.fit.unknowns
        rows = np.zeros((self.regressor.model.n, unknowns.count))
        rows[:, : unknowns.body_count] = (
            self.regressor.torque(q, dq, ddq) @ unknowns.prior.transform
        )
        return self.fit.half_interval(rows)

    def torque_change(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the change of the torque in a state, shape (n,) [N·m]."""
        change = self.values - self.regressor.parameters
        return np.asarray(self.regressor.torque(q, dq, ddq) @ change)


def half_interval_of(fit: Fit, parameter: int) -> float:
    """Return half the interval of a body parameter, by its index."""
    transform = fit.unknowns.prior.transform
    row = np.zeros(fit.unknowns.count)
    row[: transform.shape[1]] = transform[parameter]
    return float(fit.half_interval(row))


def _assumed_rotors(fit: Fit, regressor: BodyRegressor, values: Array) -> Array:
    """
    Return the rotor inertias of the corrected model, shape (n,) [kg·m²].

    Where a rotor is at its bound, and the data do not exclude the least one of geared arms, that
    is assumed: without any rotor, a light wrist would need gains that no real one stands.
    """
    first = regressor.inertial_count
    rotors = np.maximum(values[first:-3], 0.0)
    usual = LEAST_ROTOR_PER_EFFORT * finite_efforts(regressor.model)
    for joint, rotor in enumerate(rotors.tolist()):
        half = half_interval_of(fit, first + joint)
        possible = min(float(usual[joint]), half)
        if rotor < possible and rotor <= BOUND * half:
            rotors[joint] = possible
    return rotors

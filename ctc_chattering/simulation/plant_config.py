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
Parameters of the simulated plant and of the run.

This is their one declaration. Parameter files, nodes and `ctc` read and check them here. Records
of `drive.py`, `friction.py` and `sensor.py` take them by name with `PlantConfig.select`.
"""

from __future__ import annotations

import dataclasses
from math import inf
from typing import Any, TypeVar

from ctc_chattering.dynamics.registry import RobotConfig
from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.time_grid import period_ns, samples
from ctc_chattering.parameters import LEAST, parameter, PerJoint
import numpy as np

#: Values of the parameter ``velocity_sensor``.
VELOCITY_SENSORS = ('exact', 'difference', 'filtered')
#: Values of the parameter ``pacing``.
PACINGS = ('real_time', 'lockstep')
R = TypeVar('R', bound=tuple[Any, ...])


@dataclasses.dataclass(frozen=True)
class PlantConfig(RobotConfig):
    """Parameters of the simulated plant and of the run."""

    payload: float = parameter(
        0.0, 'Mass at the end of the arm that the model does not know; for a URDF only.',
        'kg', read_only=True)
    coulomb_friction: PerJoint = parameter(9.9, 'Coulomb friction Kf.', 'N*m')
    viscous_friction: PerJoint = parameter(
        0.0, 'Viscous friction coefficient.', 'N*m*s/rad')
    stribeck_friction: PerJoint = parameter(
        0.0, 'Additional friction at rest beyond Kf, which fades as exp(-(dq / '
        'stribeck_velocity)^2).', 'N*m')
    stribeck_velocity: PerJoint = parameter(
        0.05, 'Velocity at which the additional friction has faded to 1/e.',
        'rad/s', minimum=LEAST)
    load_friction: PerJoint = parameter(
        0.0, "Fraction of the mean torque's magnitude that adds to Kf.", maximum=0.9)
    friction_asymmetry: PerJoint = parameter(
        0.0, 'Asymmetry a of Coulomb friction, Kf (1 + a) forwards and Kf (1 - a) backwards.',
        minimum=-1.0, maximum=1.0)
    friction_model: str = parameter(
        '', 'Friction of your own; empty for none.', choices=('',), custom=True, read_only=True)
    joint_stiffness: PerJoint = parameter(
        inf, 'Stiffness between motor and link; .inf for a rigid joint.', 'N*m/rad', minimum=LEAST,
        read_only=True)
    joint_damping: PerJoint = parameter(
        0.0, 'Viscous damping between motor and link.', 'N*m*s/rad', read_only=True)
    motor_inertia: PerJoint = parameter(
        0.0, 'Inertia of the motor of an elastic joint, reflected to the joint.', 'kg*m^2',
        read_only=True)
    disturbance_amplitude: PerJoint = parameter(
        0.0, 'Amplitude of the disturbance d(t).', 'N*m', name='disturbance.amplitude',
        minimum=-inf)
    disturbance_frequency: PerJoint = parameter(
        0.0, 'Frequency of the disturbance d(t).', 'rad/s', name='disturbance.frequency',
        minimum=-inf)
    disturbance_push: PerJoint = parameter(
        0.0, 'Torque of a push that lasts disturbance.push_duration from when it is set.', 'N*m',
        name='disturbance.push', minimum=-inf)
    disturbance_push_duration: float = parameter(
        0.2, 'Duration of a push.', 's', name='disturbance.push_duration', maximum=3600.0)
    initial_position: PerJoint = parameter(
        0.0, 'Position at t = 0.', 'rad', minimum=-inf, read_only=True)
    initial_velocity: PerJoint = parameter(
        0.0, 'Velocity at t = 0.', 'rad/s', minimum=-inf, read_only=True)
    position_noise: PerJoint = parameter(
        0.0, 'Standard deviation of the noise on the position.', 'rad', read_only=True)
    velocity_noise: PerJoint = parameter(
        0.0, 'Standard deviation of the noise on the velocity.', 'rad/s', read_only=True)
    encoder_resolution: PerJoint = parameter(
        0.0, 'Quantisation step of the measured position; 0 for none.', 'rad', read_only=True)
    encoder_side: str = parameter(
        'motor', 'Measured side of elastic joints.', choices=('motor', 'link'),
        read_only=True)
    velocity_sensor: str = parameter(
        'exact', 'Source of the measured velocity: the exact one, the difference of two measured '
        'positions, or this difference after a first-order low-pass.',
        choices=VELOCITY_SENSORS, read_only=True)
    velocity_cutoff: float = parameter(
        500.0, 'Cut-off frequency of velocity sensor filtered.', 'rad/s', minimum=LEAST,
        read_only=True)
    sample_loss: float = parameter(
        0.0, 'Probability that a state is not sent. At most two in a row are lost, never the '
        'first or the last.', maximum=0.5)
    sample_jitter: float = parameter(
        0.0, 'Largest deviation of the time and stamp of a measurement from its sample, less '
        'than half a period.', 's')
    late_samples: float = parameter(
        0.0, 'Probability that a torque arrives one period late.', maximum=1.0)
    noise_seed: int = parameter(
        0, 'Seed of noise, jitter, lost and late samples.', maximum=2 ** 62, read_only=True)
    input_delay: int = parameter(
        0, 'Delay from receiving a torque to applying it, in samples.', maximum=100,
        read_only=True)
    torque_saturation: PerJoint = parameter(
        inf, 'Largest torque of the drives; .inf for unlimited.', 'N*m', minimum=LEAST,
        read_only=True)
    torque_resolution: PerJoint = parameter(
        0.0, 'Quantisation step of the commanded torque; 0 for none.', 'N*m', read_only=True)
    torque_rate_limit: PerJoint = parameter(
        inf, 'Rate limit of the drives; .inf for unlimited.', 'N*m/s', minimum=LEAST,
        read_only=True)
    actuator_lag: PerJoint = parameter(
        0.0, 'Time constant of the drives; 0 for none.', 's', read_only=True)
    fault_damping: PerJoint = parameter(
        20.0, 'Viscous friction of the brakes, which act while no torque arrives.', 'N*m*s/rad')
    integration_step: float = parameter(
        1e-3, 'Largest step of the integrator, at most one control period.', 's', minimum=1e-9,
        read_only=True)
    pacing: str = parameter(
        'real_time', 'Pace of the run: the clock (real_time), or simulated time that waits for '
        'each answer (lockstep).', choices=PACINGS,
        read_only=True)
    duration: float = parameter(
        0.0, 'Simulated time after which the run ends; 0 for no end.', 's', read_only=True)
    experiment: str = parameter(
        '', 'Title of the run in metrics and figures; empty for the name of file or bag.',
        read_only=True)

    def validate(self) -> None:
        """Check parameters that depend on each other."""
        super().validate()
        if self.friction_model and self.elastic:
            raise ParameterError('friction_model', self.friction_model,
                                 'empty with elastic joints')
        if self.payload and not self.described:
            raise ParameterError('payload', self.payload, '0 without a description of the robot')
        if self.sample_jitter >= 0.5 * self.control_period:
            raise ParameterError('sample_jitter', self.sample_jitter,
                                 f'less than half a period, {0.5 * self.control_period:g}')
        self._check_elasticity()
        samples(self.duration, period_ns(self.control_period))

    def _check_elasticity(self) -> None:
        """Check that elastic joints, and no others, have a motor."""
        motors = tuple(zip(self.joint_stiffness, self.motor_inertia, self.joint_damping))
        if any((k < inf) != (m > 0.0) for k, m, _ in motors):
            raise ParameterError('motor_inertia', self.motor_inertia,
                                 'above 0 where joint_stiffness is finite, and 0 elsewhere')
        if any(k == inf and d for k, _, d in motors):
            raise ParameterError('joint_damping', self.joint_damping,
                                 '0 where joint_stiffness is inf')

    @property
    def elastic(self) -> bool:
        """Return true if there is an elastic joint."""
        return min(self.joint_stiffness) < inf

    def select(self, record: type[R], **derived: Any) -> R:
        """
        Return a record of parameters as arrays of shape (n,).

        Parameters
        ----------
        record : type
            A NamedTuple whose fields have names of parameters.
        **derived
            Its further fields.

        """
        fields: Any = record._fields  # type: ignore[attr-defined]
        return record(**derived, **{
            name: np.array(getattr(self, name)) for name in fields if name not in derived})

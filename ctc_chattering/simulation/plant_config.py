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

"""Parameters of the simulated plant and of the run."""

from __future__ import annotations

import dataclasses
from math import inf
from typing import ClassVar

from ctc_chattering.dynamics.registry import check_model, locked_positions, RobotConfig
from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.time_grid import period_ns, samples
from ctc_chattering.parameters import parameter
from ctc_chattering.simulation.sensor import VELOCITY_SENSORS

#: Values of the parameter ``pacing``.
PACINGS = ('real_time', 'lockstep')


@dataclasses.dataclass(frozen=True)
class PlantConfig(RobotConfig):
    """Parameters of the simulated plant and of the run."""

    title: ClassVar[str] = 'plant'

    payload: float = parameter(
        'payload', 'float', 0.0,
        'Mass at the end of the arm, unknown to the model; URDF only.',
        unit='kg', minimum=0.0, read_only=True)
    coulomb_friction: tuple[float, ...] = parameter(
        'coulomb_friction', 'float[]', 9.9, 'Coulomb friction Kf.', unit='N*m', minimum=0.0,
        shape='n')
    viscous_friction: tuple[float, ...] = parameter(
        'viscous_friction', 'float[]', 0.0, 'Viscous friction coefficient.',
        unit='N*m*s/rad', minimum=0.0, shape='n')
    stribeck_friction: tuple[float, ...] = parameter(
        'stribeck_friction', 'float[]', 0.0,
        'Friction at rest beyond Kf; fades as exp(-(dq / stribeck_velocity)^2).',
        unit='N*m', minimum=0.0, shape='n')
    stribeck_velocity: tuple[float, ...] = parameter(
        'stribeck_velocity', 'float[]', 0.05, 'Velocity at which stribeck_friction is 1/e.',
        unit='rad/s', minimum=0.0, exclusive=True, shape='n')
    load_friction: tuple[float, ...] = parameter(
        'load_friction', 'float[]', 0.0,
        'Fraction of the magnitude of the mean torque that adds to Kf.',
        minimum=0.0, maximum=0.9, shape='n')
    friction_asymmetry: tuple[float, ...] = parameter(
        'friction_asymmetry', 'float[]', 0.0,
        'Coulomb friction is Kf (1 + this) forwards and Kf (1 - this) backwards.',
        minimum=-1.0, maximum=1.0, shape='n')
    friction_model: str = parameter(
        'friction_model', 'str', '',
        'Friction of your own; empty for none.', choices=('',), own=True,
        read_only=True)
    joint_stiffness: tuple[float, ...] = parameter(
        'joint_stiffness', 'float[]', float('inf'),
        'Stiffness between motor and link; .inf for a rigid joint.',
        unit='N*m/rad', minimum=0.0, exclusive=True, infinite=True, shape='n', read_only=True)
    joint_damping: tuple[float, ...] = parameter(
        'joint_damping', 'float[]', 0.0, 'Viscous damping between motor and link.',
        unit='N*m*s/rad', minimum=0.0, shape='n', read_only=True)
    motor_inertia: tuple[float, ...] = parameter(
        'motor_inertia', 'float[]', 0.0,
        'Inertia of the motor of an elastic joint, reflected to the joint.', unit='kg*m^2',
        minimum=0.0, shape='n', read_only=True)
    disturbance_amplitude: tuple[float, ...] = parameter(
        'disturbance.amplitude', 'float[]', 0.0, 'Amplitude of the disturbance d(t).', unit='N*m',
        shape='n')
    disturbance_frequency: tuple[float, ...] = parameter(
        'disturbance.frequency', 'float[]', 0.0, 'Frequency of the disturbance d(t).',
        unit='rad/s', shape='n')
    disturbance_push: tuple[float, ...] = parameter(
        'disturbance.push', 'float[]', 0.0,
        'Torque added for disturbance.push_duration after it is set.',
        unit='N*m', shape='n')
    disturbance_push_duration: float = parameter(
        'disturbance.push_duration', 'float', 0.2, 'Duration of a push.', unit='s',
        minimum=0.0, maximum=3600.0)
    initial_position: tuple[float, ...] = parameter(
        'initial_position', 'float[]', 0.0, 'Position at t = 0.', unit='rad', shape='n',
        read_only=True)
    initial_velocity: tuple[float, ...] = parameter(
        'initial_velocity', 'float[]', 0.0, 'Velocity at t = 0.', unit='rad/s', shape='n',
        read_only=True)
    position_noise: tuple[float, ...] = parameter(
        'position_noise', 'float[]', 0.0, 'Standard deviation of the noise on the position.',
        unit='rad', minimum=0.0, shape='n', read_only=True)
    velocity_noise: tuple[float, ...] = parameter(
        'velocity_noise', 'float[]', 0.0, 'Standard deviation of the noise on the velocity.',
        unit='rad/s', minimum=0.0, shape='n', read_only=True)
    encoder_resolution: tuple[float, ...] = parameter(
        'encoder_resolution', 'float[]', 0.0,
        'Quantisation step of the measured position; 0 for none.',
        unit='rad', minimum=0.0, shape='n', read_only=True)
    encoder_side: str = parameter(
        'encoder_side', 'str', 'motor',
        'Elastic joints: the side that is measured.',
        choices=('motor', 'link'), read_only=True)
    velocity_sensor: str = parameter(
        'velocity_sensor', 'str', 'exact',
        'Measured velocity: exact, difference of two measured positions, or that behind a '
        'first-order low-pass.',
        choices=VELOCITY_SENSORS, read_only=True)
    velocity_cutoff: float = parameter(
        'velocity_cutoff', 'float', 500.0, 'Velocity sensor filtered: cut-off frequency.',
        unit='rad/s', minimum=0.0, exclusive=True, read_only=True)
    sample_loss: float = parameter(
        'sample_loss', 'float', 0.0,
        'Probability that a state is not sent: at most two in a row, never the first or the last.',
        minimum=0.0, maximum=0.5)
    sample_jitter: float = parameter(
        'sample_jitter', 'float', 0.0,
        'A state is measured up to this long before or after its sample, and stamped so; less '
        'than half a period.', unit='s', minimum=0.0)
    late_samples: float = parameter(
        'late_samples', 'float', 0.0,
        'Probability that a torque arrives one period late.',
        minimum=0.0, maximum=1.0)
    noise_seed: int = parameter(
        'noise_seed', 'int', 0,
        'Seed of noise, jitter, lost and late samples.', minimum=0,
        maximum=2 ** 62, read_only=True)
    input_delay: int = parameter(
        'input_delay', 'int', 0, 'Delay from receiving a torque to applying it, in samples.',
        minimum=0, maximum=100, read_only=True)
    torque_saturation: tuple[float, ...] = parameter(
        'torque_saturation', 'float[]', float('inf'),
        'Largest torque of the drives; .inf for unlimited.', unit='N*m', minimum=0.0,
        exclusive=True, infinite=True, shape='n', read_only=True)
    torque_resolution: tuple[float, ...] = parameter(
        'torque_resolution', 'float[]', 0.0, 'Quantisation step of the commanded torque; 0 for '
        'none.', unit='N*m', minimum=0.0, shape='n', read_only=True)
    torque_rate_limit: tuple[float, ...] = parameter(
        'torque_rate_limit', 'float[]', float('inf'),
        'Rate limit of the drives; .inf for unlimited.', unit='N*m/s',
        minimum=0.0, exclusive=True, infinite=True, shape='n', read_only=True)
    actuator_lag: tuple[float, ...] = parameter(
        'actuator_lag', 'float[]', 0.0,
        'Time constant of the drives; 0 for none.', unit='s',
        minimum=0.0, shape='n', read_only=True)
    fault_damping: tuple[float, ...] = parameter(
        'fault_damping', 'float[]', 20.0,
        'Viscous friction of the brakes while no torque arrives.', unit='N*m*s/rad',
        minimum=0.0, shape='n')
    control_period: float = parameter(
        'control_period', 'float', 1e-3, 'Sample period h.', unit='s', minimum=0.0,
        exclusive=True, maximum=10.0, read_only=True)
    integration_step: float = parameter(
        'integration_step', 'float', 1e-3,
        'Largest step of the integrator, at most one control period.', unit='s',
        minimum=1e-9, read_only=True)
    pacing: str = parameter(
        'pacing', 'str', 'real_time',
        'By the clock, or in simulated time after each answer.',
        choices=PACINGS, read_only=True)
    duration: float = parameter(
        'duration', 'float', 0.0, 'Simulated time after which the run ends; 0 for never.',
        unit='s', minimum=0.0, maximum=1e9, read_only=True)
    experiment: str = parameter(
        'experiment', 'str', '',
        'Title of the run in metrics and figures; empty for the name of file or bag.',
        read_only=True)

    def validate(self) -> None:
        """Check the model's number of joints, its friction, and that the run ends on the grid."""
        check_model(self.model, self.joint_names)
        if self.friction_model and self.elastic:
            raise ParameterError('friction_model', self.friction_model,
                                 'empty with elastic joints')
        if self.payload and not self.described:
            raise ParameterError('payload', self.payload, '0 without a description of the robot')
        if self.sample_jitter >= 0.5 * self.control_period:
            raise ParameterError('sample_jitter', self.sample_jitter,
                                 f'less than half a period, {0.5 * self.control_period:g}')
        self._check_elasticity()
        locked_positions(self.locked)
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
        """Whether there is an elastic joint."""
        return min(self.joint_stiffness) < inf

    @property
    def described(self) -> bool:
        """Whether a description of the robot is needed."""
        return self.model == 'urdf'

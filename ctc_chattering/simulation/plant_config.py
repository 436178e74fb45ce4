"""Parameters of the simulated plant and of the run."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

from ctc_chattering.dynamics.registry import check_model, locked_positions
from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.time_grid import period_ns, samples
from ctc_chattering.parameters import Config, parameter

#: Values of the parameter ``pacing``.
PACINGS = ('real_time', 'lockstep')
#: Values of the parameter ``plant_backend``.
BACKENDS = ('builtin', 'mujoco')


@dataclasses.dataclass(frozen=True)
class PlantConfig(Config):
    """Parameters of the simulated plant and of the run."""

    title: ClassVar[str] = 'plant'

    joint_names: tuple[str, ...] = parameter(
        'joint_names', 'str[]', ('joint1', 'joint2'), 'Joints in the order of the model.',
        read_only=True)
    model: str = parameter(
        'model', 'str', 'two_link',
        'Robot model: M, C and G; two_link, urdf, or package.module:Class.', read_only=True)
    plant_backend: str = parameter(
        'plant_backend', 'str', 'builtin',
        'What moves the robot: the equations of `model`, or MuJoCo from `description`.',
        choices=BACKENDS, read_only=True)
    description: str = parameter(
        'description', 'str', '',
        "Model urdf or backend mujoco: the robot's file, a path or package://NAME/PATH; empty for "
        'the topic robot_description.', read_only=True)
    locked: tuple[str, ...] = parameter(
        'locked', 'str[]', ('',),
        'Positions of its joints that are not in joint_names, each "name position"; 0 for those '
        'left out.', shape='any', read_only=True)
    gravity: float = parameter(
        'gravity', 'float', 9.81, 'Acceleration of gravity in G.', unit='m/s^2', minimum=0.0,
        read_only=True)
    coulomb_friction: tuple[float, ...] = parameter(
        'coulomb_friction', 'float[]', 9.9, 'Coulomb friction Kf.', unit='N*m', minimum=0.0,
        shape='n')
    viscous_friction: tuple[float, ...] = parameter(
        'viscous_friction', 'float[]', 0.0, 'Viscous friction, times the velocity.',
        unit='N*m*s/rad', minimum=0.0, shape='n')
    stribeck_friction: tuple[float, ...] = parameter(
        'stribeck_friction', 'float[]', 0.0,
        'How far friction at rest exceeds Kf; it fades as exp(-(dq / stribeck_velocity)^2).',
        unit='N*m', minimum=0.0, shape='n')
    stribeck_velocity: tuple[float, ...] = parameter(
        'stribeck_velocity', 'float[]', 0.05, 'Velocity at which it has fallen to 1/e.',
        unit='rad/s', minimum=0.0, exclusive=True, shape='n')
    disturbance_amplitude: tuple[float, ...] = parameter(
        'disturbance.amplitude', 'float[]', 0.0, 'Amplitude of the disturbance d(t).', unit='N*m',
        shape='n')
    disturbance_frequency: tuple[float, ...] = parameter(
        'disturbance.frequency', 'float[]', 0.0, 'Frequency of the disturbance d(t).',
        unit='rad/s', shape='n')
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
        'encoder_resolution', 'float[]', 0.0, 'Step of the measured position; 0 for none.',
        unit='rad', minimum=0.0, shape='n', read_only=True)
    noise_seed: int = parameter(
        'noise_seed', 'int', 0, 'Seed of the noise: the same seed, the same noise.', minimum=0,
        maximum=2 ** 62, read_only=True)
    input_delay: int = parameter(
        'input_delay', 'int', 0, 'Delay between a torque received and applied, in samples.',
        minimum=0, maximum=100, read_only=True)
    torque_saturation: tuple[float, ...] = parameter(
        'torque_saturation', 'float[]', float('inf'),
        'Largest torque the drives give; .inf for unlimited.', unit='N*m', minimum=0.0,
        exclusive=True, infinite=True, shape='n', read_only=True)
    fault_damping: tuple[float, ...] = parameter(
        'fault_damping', 'float[]', 20.0,
        'Viscous friction of the brakes, which hold while no torque comes.', unit='N*m*s/rad',
        minimum=0.0, shape='n')
    control_period: float = parameter(
        'control_period', 'float', 1e-3, 'Sample period h; the torque is held over it.', unit='s',
        minimum=0.0, exclusive=True, maximum=10.0, read_only=True)
    integration_step: float = parameter(
        'integration_step', 'float', 1e-3,
        'Largest step of the integrator; at most one control period is taken at once.', unit='s',
        minimum=1e-9, read_only=True)
    pacing: str = parameter(
        'pacing', 'str', 'real_time',
        'Publish on the node clock, or in simulated time after each answer.', choices=PACINGS,
        read_only=True)
    duration: float = parameter(
        'duration', 'float', 0.0, 'Simulated time after which the run ends; 0 for never.',
        unit='s', minimum=0.0, maximum=1e9, read_only=True)
    experiment: str = parameter(
        'experiment', 'str', '',
        'Title of the run in metrics and figures; empty for the name of the parameter file, or of '
        'the bag.',
        read_only=True)

    def validate(self) -> None:
        """Check the model's number of joints, its friction, and that the run ends on the grid."""
        if self.plant_backend == 'builtin':
            check_model(self.model, self.joint_names)
        elif any(self.stribeck_friction):
            raise ParameterError('stribeck_friction', self.stribeck_friction,
                                 f'0 with plant_backend {self.plant_backend}')
        locked_positions(self.locked)
        samples(self.duration, period_ns(self.control_period))

    @property
    def described(self) -> bool:
        """Whether a description of the robot is needed."""
        return self.plant_backend != 'builtin' or self.model == 'urdf'

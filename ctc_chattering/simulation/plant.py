"""
The simulated robot: equation (1) with set-valued Coulomb friction, under a held torque.

Between changes of stick and slide the motion is smooth and a Runge-Kutta step of fourth order
follows it. Where a sliding joint comes to rest, or a stuck one is overloaded, the instant is
located within the step, the modes are determined again there, and the rest of the step goes on.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from math import exp, inf
from typing import ClassVar

from ctc_chattering.dynamics.model import Model, Vector
from ctc_chattering.dynamics.registry import check_model, locked_positions, model_of
from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.event_location import first_negative
from ctc_chattering.numerics.runge_kutta import Dynamics, step, step_two
from ctc_chattering.numerics.time_grid import period_ns, samples
from ctc_chattering.parameters import Config, parameter
from ctc_chattering.simulation.friction import bit_mask, excess, modes
from ctc_chattering.simulation.simulated_robot import Robot

#: Values of the parameter ``pacing``.
PACINGS = ('real_time', 'lockstep')
#: Values of the parameter ``plant_backend``.
BACKENDS = ('builtin', 'mujoco')
#: Changes of mode that one step may hold; beyond it the step ends in the mode it is in.
_MAX_EVENTS = 50


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


class Plant(Robot):
    """
    The simulated robot of a `Model`.

    Parameters
    ----------
    config : PlantConfig
        Physics and start.
    model : Model, optional
        In place of the one that the configuration names.

    Attributes
    ----------
    modes : tuple of int, shape (n,)
        +1 and -1 for a joint that slides, 0 for one that sticks or has no friction.

    """

    def __init__(self, config: PlantConfig, model: Model | None = None) -> None:
        super().__init__(config)
        self.model = model or model_of(config)
        self.modes: tuple[int, ...] = (0,) * self.n
        self._step = step_two if self.n == 2 else step
        self.configure(config)

    def configure(self, config: PlantConfig) -> None:
        """Use another friction or disturbance from the next step on."""
        super().configure(config)
        self._breakaway = [
            a + b for a, b in zip(config.coulomb_friction, config.stribeck_friction)]
        self._velocity_friction = None
        viscous = self._viscous_friction()
        if any(viscous) or any(config.stribeck_friction):
            self._velocity_friction = list(zip(
                viscous, config.stribeck_friction, config.stribeck_velocity))
        self._rubbing = [i for i, x in enumerate(self._breakaway) if x > 0.0]
        self._decided = False

    def _move(self, t: float, tau: Vector) -> None:
        """Go on by one control period in as many steps as `integration_step` asks for."""
        if not self._decided or self._stuck or 0.0 in self.dq:
            self._decide(t, tau)
        h = self._h
        for i in range(self._substeps):
            self._advance(t + i * h, h, tau)

    def _decide(self, t: float, tau: Vector) -> None:
        """Set the modes from the state and the load at time `t`."""
        load = self._torque(t, tau)
        if self._velocity_friction:
            signs = [(x > 0.0) - (x < 0.0) for x in self.dq]
            load = self._minus_velocity_friction(self.dq, load, signs)
        self.modes = modes(self.model, self.q, self.dq, load, self._breakaway)
        mode = self.modes
        self._stuck = [i for i in self._rubbing if not mode[i]]
        self._sliding = [i for i in self._rubbing if mode[i]]
        self._fixed_joints = bit_mask(self._stuck)
        self._friction = [x * m for x, m in zip(self._breakaway, mode)]
        self._decided = True

    def _advance(self, t: float, h: float, tau: Vector) -> None:
        """Integrate over `h` [s] from `t` [s], through any change of mode."""
        load = [a - f for a, f in zip(tau, self._friction)]
        for _ in range(_MAX_EVENTS):
            q, dq = self._runge_kutta(t, h, load)
            held = self._margin(t + h, q, dq, load)
            if held >= 0.0:
                self.q, self.dq = q, dq
                return
            s = self._locate(t, h, load, held)
            self.q, dq = self._runge_kutta(t, s, load)
            mode = self.modes
            self.dq = [x if x * m >= 0.0 else 0.0 for x, m in zip(dq, mode)]
            t, h = t + s, h - s
            self._decide(t, tau)
            load = [a - f for a, f in zip(tau, self._friction)]
        self.q, self.dq = self._runge_kutta(t, h, load)

    def _margin(self, t: float, q: Vector, dq: Vector, load: Vector) -> float:
        """Return how far the joint nearest to it is from leaving its mode; negative if it has."""
        mode = self.modes
        margin = inf
        for i in self._sliding:
            x = dq[i] * mode[i]
            if x < margin:
                margin = x
        if self._stuck:
            u = self._torque(t, load)
            if self._velocity_friction:
                u = self._minus_velocity_friction(dq, u, mode)
            beyond = max(excess(self.model, q, dq, u, self._breakaway, self._stuck))
            if -beyond < margin:
                margin = -beyond
        return margin

    def _locate(self, t: float, h: float, load: Vector, held: float) -> float:
        """
        Return an instant after `t` [s], to 1e-12 h late, at which a joint first left its mode.

        Parameters
        ----------
        t, h : float
            Start and length of the step [s].
        load : sequence of float, shape (n,)
            Torque less sliding friction [N·m].
        held : float
            What `_margin` is at the end of the step: negative.

        """
        def margin(s: float) -> float:
            q, dq = self._runge_kutta(t, s, load)
            return self._margin(t + s, q, dq, load)

        return first_negative(margin, h, held, 1e-12 * h)

    def _sliding_dynamics(self, q: Vector, dq: Vector, u: Vector, fixed_joints: int) -> Vector:
        """Return ddq where friction depends on the velocity; `u` has its value near rest off."""
        u = self._minus_velocity_friction(dq, u, self.modes)
        return self.model.forward_dynamics(q, dq, u, fixed_joints)

    def _minus_velocity_friction(self, dq: Vector, u: Vector, mode: Sequence[int]) -> Vector:
        """Return `u` less what friction at the velocity `dq` exceeds its value near rest by."""
        assert self._velocity_friction is not None
        return [
            x - viscous * v + (fall * m * (1.0 - exp(-(r := v / speed) * r)) if fall else 0.0)
            for x, v, m, (viscous, fall, speed) in zip(u, dq, mode, self._velocity_friction)]

    def _runge_kutta(self, t: float, h: float, load: Vector) -> tuple[Vector, Vector]:
        """Return q and dq after one step of fourth order in the present modes."""
        dynamics: Dynamics = self.model.forward_dynamics
        if self._velocity_friction:
            dynamics = self._sliding_dynamics
        loads = (load, load, load)
        if self._disturbed:
            loads = (self._torque(t, load), self._torque(t + 0.5 * h, load),
                     self._torque(t + h, load))
        return self._step(dynamics, self.q, self.dq, loads, self._fixed_joints, h)

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
The simulated robot.

It is equation (1) with rigid or elastic joints, drives, sensors and a network. The node `plant`
and `run_closed_loop` step a `Plant` with torques. `plant_step.py` says what happens from one
sample to the next, in plain Python or compiled. This module does the remainder: the start, a
change of parameters, and random numbers.
"""

from __future__ import annotations

from math import ceil, inf, isfinite
from random import Random

from ctc_chattering.compiled.compilable import RECORDS
from ctc_chattering.compiled.machine_code import MACHINE_CODE, PLAIN_PYTHON
from ctc_chattering.dynamics.compiled_model import arm_of, ArmNumbers
from ctc_chattering.dynamics.elastic_model import Elastic
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.payload import with_payload
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.numerics.time_grid import NANOSECONDS, period_ns, samples, seconds
from ctc_chattering.simulation.coordinates import ElasticJoints, RigidJoints
from ctc_chattering.simulation.drive import Driven, Drives
from ctc_chattering.simulation.friction import Friction, own_friction
from ctc_chattering.simulation.motion import Mechanics, Mechanism, Motion
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.simulation.plant_step import (
    advance_plant,
    CompiledPlantStep,
    PlantInput,
    PlantParameters,
    PlantState,
)
from ctc_chattering.simulation.sensor import draw_noise, encoders_of, measured_at_start
from ctc_chattering.trajectory.joint_limits import check_limits, JointLimits, read_limits
import numpy as np

#: Largest step of the integrator times the fastest eigenvalue of an elastic joint.
_MAX_STEP_RATE = 0.2
#: Most steps of elastic joints in a control period. More would seem to hang.
_MAX_ELASTIC_STEPS = 10_000
#: Random numbers of a sample, by the parameter that says how often or how far: name of the seed.
_DRAWS = {'late_samples': 'lateness', 'sample_loss': 'loss', 'sample_jitter': 'jitter'}


class Plant:
    """
    The simulated robot of a `Model`.

    Contract: `step` advances `k` by one and the time by one control period.

    Parameters
    ----------
    config : PlantConfig
        Physics, start, drives, sensors and network.
    model : Model, optional
        Of the links, in place of the one that the configuration names.

    Attributes
    ----------
    n : int
        Number of joints.
    q, dq : sequence of float, shape (n,)
        True position [rad] and velocity [rad/s] at sample `k`.
    k : int
        Sample index. The time is k h.
    last : int
        Last sample of the run.
    applied : sequence of float, shape (n,)
        Torque of the drives at the end of the last period [N·m]. It is that of the whole period if
        they have neither lag nor rate limit.
    measured : (sequence of float, sequence of float), each of shape (n,)
        Position and velocity as the sensors have them at sample `k`.
    offset : float
        Time from the sample to that measurement [s].
    lost : bool
        True if that measurement is not sent. Then `step` takes the last torque again.
    braking : bool
        True while the brakes are on.
    state : PlantState
        Of drives, coordinates and sensors. Of machine code it is views of its memory.
    config : PlantConfig
        In force.
    parameters : PlantParameters
        Those of `config`, as `plant_step.py` takes them.
    own_friction : record
        Friction of `friction_model`.
    arm : ArmNumbers or None
        Numbers of the model, if the plant can be machine code.
    transit : array, shape (delay, n)
        Torques in transit [N·m], at least one row.
    noise : Random
        Source of the sensors' noise.
    draws : dict of Random
        Sources of the numbers that decide which samples are late, lost and off the grid.

    """

    def __init__(self, config: PlantConfig, model: Model | None = None) -> None:
        self.model = self._coupled = model or model_of(config)
        self.n = len(config.joint_names)
        self.k = 0
        if self.model.n != self.n:
            raise CtcError(f'joint_names: {list(config.joint_names)} are not allowed with a model '
                           f'of {self.model.n} joints')
        q = config.initial_position
        dq = config.initial_velocity
        self._joints: RigidJoints | ElasticJoints = RigidJoints()
        max_step = config.integration_step
        if config.elastic:
            elastic = self._coupled = Elastic(
                self.model, config.joint_stiffness, config.joint_damping, config.motor_inertia)
            self._joints = ElasticJoints(elastic, config.encoder_side)
            max_step = min(max_step, _elastic_step(config, elastic))
            q, dq = map(tuple, elastic.start(q, dq))
        self.own_friction = own_friction(config.friction_model, config.joint_names)
        self.arm: ArmNumbers | None = None
        if config.compiled and not config.elastic and type(self.own_friction) in RECORDS:
            self.arm = arm_of(self.model)
        self.braking = False
        self._push: Vector = (0.0,) * self.n
        self._push_end = 0
        self.period_ns = period_ns(config.control_period)
        self._period = seconds(self.period_ns)
        self.last = samples(config.duration, self.period_ns)
        self._steps = max(1, ceil(self._period / max_step - 1e-9))
        self._encoders = encoders_of(config, self._period)
        self.noise = Random(config.noise_seed)
        self.draws = {parameter: Random(f'{config.noise_seed} {name}')
                      for parameter, name in _DRAWS.items()}
        zero = np.zeros(self.n)
        undecided = np.zeros(self._coupled.n)
        motion = Motion(np.array(q), np.array(dq), undecided, undecided, undecided, False)
        shown = measured_at_start(self._encoders, self.noise, self._joints.seen(motion.q),
                                  self._joints.seen(motion.dq))
        state = PlantState(0, Driven(zero, zero, zero, zero), motion, shown, 0.0, 0)
        self._begin(config, state, np.zeros((max(config.input_delay, 1), self.n)))

    def configure(self, config: PlantConfig) -> None:
        """Use another friction or disturbance from the next step on."""
        motion = self.state.motion._replace(decided=False)
        self._begin(config, self.state._replace(motion=motion), self.transit)

    def _begin(self, config: PlantConfig, state: PlantState, transit: Array) -> None:
        """Go on from a state with other parameters."""
        self.config = config
        mechanics = self._mechanics()
        self.parameters = PlantParameters(
            mechanics, self._encoders, config.sample_loss, config.sample_jitter, self.last)
        self._mechanism = self._mechanism_of(mechanics)
        self.state = state
        self.transit = transit
        self._compiled_step: CompiledPlantStep | None = None
        noise = *config.position_noise, *config.velocity_noise
        self._is_random = any(noise) or any(getattr(config, name) for name in self.draws)
        self._read_state()

    def _mechanism_of(self, mechanics: Mechanics) -> Mechanism:
        """Return what plain Python moves."""
        return Mechanism(self._coupled, self.own_friction, mechanics, self._joints)

    def _mechanics(self) -> Mechanics:
        """Return all that acts: a disturbance on links, friction on motors."""
        config = self.config
        joints = self._joints
        if config.disturbance_push != self._push:
            self._push = config.disturbance_push
            self._push_end = self.k + round(config.disturbance_push_duration / self._period)
        ideal = not any(config.actuator_lag) and min(config.torque_rate_limit) == inf
        drives = config.select(
            Drives, period=self._period, input_delay=config.input_delay,
            late_samples=config.late_samples, ideal=ideal)
        amplitude, frequency, push = (joints.on_links(np.array(x)) for x in (
            config.disturbance_amplitude, config.disturbance_frequency, self._push))
        return Mechanics(
            self.period_ns, self._period, self._steps, amplitude, frequency, push,
            self._push_end if any(self._push) else 0, drives, self._friction(),
            bool(config.friction_model))

    def _friction(self) -> Friction:
        """Return the friction of the coordinates, 0 for links."""
        friction = self.config.select(Friction)
        if self.braking:
            viscous = friction.viscous_friction + self.config.fault_damping
            friction = friction._replace(viscous_friction=viscous)
        friction = Friction(*map(self._joints.on_motors, friction))
        velocity = friction.stribeck_velocity
        return friction._replace(stribeck_velocity=np.where(velocity > 0.0, velocity, 1.0))

    @property
    def compiled_step(self) -> CompiledPlantStep | None:
        """Return the step for machine code, or None where that cannot be."""
        if self._compiled_step is None and self.arm is not None:
            step = self._compiled_step = CompiledPlantStep(
                self.arm, self.own_friction, self.parameters, self.state, self.transit)
            if step.compiled:
                self.state = step.state
                self.transit = step.transit
        return self._compiled_step

    def _read_state(self) -> None:
        """Set the attributes of the present sample."""
        n = self.n
        state = self.state
        self.q: Vector = state.motion.q.tolist()[:n]  # Links come before motors.
        self.dq: Vector = state.motion.dq.tolist()[:n]
        self.measured: tuple[Vector, Vector] = state.shown.q.tolist(), state.shown.dq.tolist()
        self.applied: Vector = state.driven.torque.tolist()
        self.offset = float(state.offset)
        self.lost = bool(state.lost_in_a_row)

    @property
    def computed_by(self) -> str:
        """Return what computes the next step."""
        step = self.compiled_step
        return MACHINE_CODE if step is not None and step.compiled else PLAIN_PYTHON

    @property
    def modes(self) -> tuple[int, ...]:
        """Return ±1 for each coordinate that slides, else 0."""
        return tuple(map(int, self.state.motion.mode))

    @property
    def t(self) -> float:
        """Time of the present sample [s]."""
        return self.k * self.period_ns / NANOSECONDS

    @property
    def stamp(self) -> int:
        """Time of the measurement since the start [ns]."""
        return self.k * self.period_ns + round(1e9 * self.offset)

    def brake(self, on: bool) -> None:
        """Put the brakes, a viscous friction `fault_damping`, on or off."""
        if on != self.braking:
            self.braking = on
            self.configure(self.config)

    def step(self, tau: Vector | Array) -> None:
        """
        Receive a torque and go on by one control period.

        The torque received `input_delay` samples ago is quantised and saturated. The drives follow
        it over the period.

        Parameters
        ----------
        tau : sequence of float, shape (n,)
            Torque [N·m].

        Raises
        ------
        CtcError
            If the motion leaves the range of floating-point numbers.

        """
        torque = np.array(tau, float)
        if torque.shape != (self.n,) or not isfinite(sum(torque.tolist())):
            raise ParameterError('tau', tau, f'{self.n} finite numbers')
        try:
            step = self.compiled_step
            if step is not None and step.compiled:
                if self._is_random:
                    step.set_input(self._draw_input(torque))
                step.advance(torque)
            else:
                received = self._draw_input(torque)
                with np.errstate(all='ignore'):  # What overflows shows in the state.
                    self.state = advance_plant(
                        self._mechanism, self.parameters, self.state, self.transit, received)
            self._read_state()
            if not isfinite(sum(self.q) + sum(self.dq)):
                raise OverflowError
        except (ArithmeticError, ValueError, np.linalg.LinAlgError):  # sin(inf)
            raise diverged(self.t, self.state.driven.commanded) from None
        self.k += 1

    def _draw_input(self, torque: Array) -> PlantInput:
        """Return the input of a sample, with random numbers where the parameters ask for any."""
        late, loss, jitter = [random.random() if getattr(self.config, name) else 1.0
                              for name, random in self.draws.items()]
        return PlantInput(
            torque, late, loss, jitter, draw_noise(self.noise, self._encoders.position_noise),
            draw_noise(self.noise, self._encoders.velocity_noise))


def _elastic_step(config: PlantConfig, elastic: Elastic) -> float:
    """Return the largest step [s], or raise `CtcError` if it is too small."""
    step = _MAX_STEP_RATE / elastic.rate(config.initial_position)
    if step * _MAX_ELASTIC_STEPS < config.control_period:
        raise CtcError(
            f'joint_stiffness {list(config.joint_stiffness)}, joint_damping and motor_inertia '
            f'take integration steps of {step:.2g} s; allowed: at most {_MAX_ELASTIC_STEPS} in a '
            'control period; set joint_stiffness to .inf for a joint that is this stiff')
    return step


def diverged(t: float, torque: Array) -> CtcError:
    """Return the error of a motion that diverges at `t` [s]."""
    shown = ', '.join(f'{x:.4g}' for x in torque)
    return CtcError(f'the motion of the plant diverged at t = {t:g} s, '
                    f'under a torque of [{shown}] N*m')


def limits_of(config: PlantConfig, description: str) -> list[JointLimits] | None:
    """Return the limits of the description, which no plant keeps; None without any."""
    if config.model != 'urdf' or not description:
        return None
    return read_limits(description, config.joint_names)


def check_start(config: PlantConfig, description: str) -> None:
    """Raise `CtcError` if the plant starts beyond its limits."""
    limits = limits_of(config, description)
    if limits is not None:
        check_limits('the start of the plant', limits,
                     [(config.initial_position, config.initial_velocity, ())])


def make_plant(config: PlantConfig, description: str = '') -> Plant:
    """
    Return the robot that `config` describes, at its start.

    Parameters
    ----------
    config : PlantConfig
        Of the plant.
    description : str
        Text of the URDF, where one is needed.

    Raises
    ------
    CtcError
        If there is no description, it does not have the joints, or the start is beyond its
        limits.

    """
    check_start(config, description)
    if config.payload:
        description = with_payload(description, config.joint_names, config.payload)
    return Plant(config, model_of(config, description))

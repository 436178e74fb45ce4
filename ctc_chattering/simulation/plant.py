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
The simulated robot: equation (1) with rigid or elastic joints, drives, sensors and a network.

What it does from sample to sample is `plant_step.stepped`, in plain Python or compiled; here is
what happens in between: a start, other parameters, and random numbers.
"""

from __future__ import annotations

from math import ceil, inf, isfinite
from random import Random
from typing import Any

from ctc_chattering.compiled.compilable import RECORDS
from ctc_chattering.compiled.machine_code import MACHINE_CODE, PLAIN_PYTHON
from ctc_chattering.dynamics.compiled_model import Arm, arm_of
from ctc_chattering.dynamics.elastic_model import Elastic
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.payload import with_payload
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.numerics.time_grid import period_ns, samples, seconds
from ctc_chattering.simulation.drive import Driven, Drives
from ctc_chattering.simulation.friction import Friction, own_friction
from ctc_chattering.simulation.motion import Mechanics, Mechanism, Motion, Rigid
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.simulation.plant_step import (
    CompiledPlantStep,
    PlantInput,
    PlantParameters,
    PlantState,
    stepped,
)
from ctc_chattering.simulation.sensor import Sensor
from ctc_chattering.trajectory.joint_limits import check_limits, JointLimits, read_limits
import numpy as np

#: Largest step of the integrator times the fastest eigenvalue of an elastic joint.
_STEP_RATE = 0.2
#: Most steps in a control period that elastic joints may take; more would seem to hang.
_MOST_STEPS = 10_000


class _ElasticJoints:
    """Joints whose motors are coordinates of their own; as `motion.Rigid`."""

    def __init__(self, model: Elastic, encoder_side: str) -> None:
        self._motors, self._n = model.motors, model.n
        self._seen = self._motors if encoder_side == 'motor' else range(len(model.motors))

    def on_motors(self, x: Array) -> Array:
        """Return values of the joints as those of their motors; 0 of links."""
        values = np.zeros(self._n)
        values[self._motors] = x
        return values

    def seen(self, x: Array) -> Array:
        """Return what the encoders see of values of the coordinates: motors or links."""
        values: Array = x[self._seen]
        return values


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
        Sample index; the time is k h.
    applied : sequence of float, shape (n,)
        Torque of the drives at the end of the last period [N·m]; that of the whole period if they
        have neither lag nor rate limit.
    measured : (sequence of float, sequence of float), each of shape (n,)
        Position and velocity as the sensors have them at sample `k`.
    offset : float
        How long after the sample that is [s].
    lost : bool
        Whether that measurement is not sent: `step` then takes the last torque again.
    braking : bool
        Whether the brakes are on.
    state : PlantState
        Of drives, coordinates and sensors; of machine code, views of its memory.
    config : PlantConfig
        In force.
    parameters : PlantParameters
        What follows from it.
    own : record
        Own friction.
    arm : Arm or None
        Numbers of the model, if the plant can be machine code.
    transit : array, shape (delay, n)
        Torques in transit [N·m], at least one row.
    chances : dict of Random
        Of what decides which samples are late, lost and off the grid, by parameter.

    """

    def __init__(self, config: PlantConfig, model: Model | None = None) -> None:
        self.model = self._coupled = model or model_of(config)
        self.n, self.k = len(config.joint_names), 0
        if self.model.n != self.n:
            raise CtcError(f'joint_names: {list(config.joint_names)} are not allowed with a model '
                           f'of {self.model.n} joints')
        q, dq = config.initial_position, config.initial_velocity
        self._joints: Any = Rigid()
        self._motors, longest = list(range(self.n)), inf
        if config.elastic:
            elastic = self._coupled = Elastic(
                self.model, config.joint_stiffness, config.joint_damping, config.motor_inertia)
            self._joints = _ElasticJoints(elastic, config.encoder_side)
            self._motors, longest = elastic.motors, _STEP_RATE / elastic.rate(q)
            if longest * _MOST_STEPS < config.control_period:
                raise CtcError(
                    f'joint_stiffness {list(config.joint_stiffness)}, joint_damping and '
                    f'motor_inertia take integration steps of {longest:.2g} s; allowed: at most '
                    f'{_MOST_STEPS} in a control period; set joint_stiffness to .inf for a joint '
                    'that is this stiff')
            q, dq = map(tuple, elastic.start(q, dq))
        self.own = own_friction(config.friction_model, config.joint_names)
        self.arm: Arm | None = None
        if config.compiled and not config.elastic and type(self.own) in RECORDS:
            self.arm = arm_of(self.model)
        self.braking = False
        #: The push, and the first sample after it.
        self._push: Vector = (0.0,) * self.n
        self._push_end = 0
        self.period_ns = period_ns(config.control_period)
        self._period = seconds(self.period_ns)
        self.last = samples(config.duration, self.period_ns)
        self._substeps = max(1, ceil(
            self._period / min(longest, config.integration_step) - 1e-9))
        self.sensor = Sensor(
            config.encoder_resolution, config.position_noise, config.velocity_noise,
            config.noise_seed, config.velocity_sensor, config.velocity_cutoff, self._period)
        self.chances = {parameter: Random(f'{config.noise_seed} {of}') for parameter, of in (
            ('late_samples', 'lateness'), ('sample_loss', 'loss'), ('sample_jitter', 'jitter'))}
        rest, zero = np.zeros(self._coupled.n), np.zeros(self.n)
        motion = Motion(np.array(q), np.array(dq), rest, rest, rest, 0.0)
        self._begin(config, PlantState(
            0, Driven(zero, zero, zero, zero), motion,
            self.sensor.first(*map(self._joints.seen, (motion.q, motion.dq))), 0.0, 0),
            np.zeros((max(config.input_delay, 1), self.n)))

    def _mechanism(self, mechanics: Mechanics) -> Mechanism:
        """Return what plain Python moves."""
        return Mechanism(self._coupled, self.own, mechanics, self._joints)

    def configure(self, config: PlantConfig) -> None:
        """Use another friction or disturbance from the next step on."""
        motion = self.state.motion._replace(decided=0.0)
        self._begin(config, self.state._replace(motion=motion), self.transit)

    def _begin(self, config: PlantConfig, state: PlantState, transit: Array) -> None:
        """Go on from a state with other parameters."""
        self.config = config
        drives = self._drives()
        mechanics = self._mechanics(drives.ideal)
        self.parameters = PlantParameters(
            mechanics, drives, self.sensor.encoders, config.sample_loss, config.sample_jitter,
            self.last)
        self._moving = self._mechanism(mechanics)
        self.state, self.transit = state, transit
        self._compiled_step: CompiledPlantStep | None = None
        noise = *config.position_noise, *config.velocity_noise
        self._is_random = any(noise) or any(getattr(config, name) for name in self.chances)
        self._show()

    @property
    def compiled_step(self) -> CompiledPlantStep | None:
        """Return the step from now on as machine code takes it; None where it cannot."""
        if self._compiled_step is None and self.arm is not None:
            step = self._compiled_step = CompiledPlantStep(
                self.arm, self.own, self.parameters, self.state, self.transit)
            if step.compiled:
                self.state, self.transit = step.state, step.transit
        return self._compiled_step

    def _show(self) -> None:
        """Take over what is known of the present sample."""
        n, state = self.n, self.state
        self.q: Vector = state.motion.q[:n].tolist()  # Links come before motors.
        self.dq: Vector = state.motion.dq[:n].tolist()
        self.measured: tuple[Vector, Vector] = state.shown.q.tolist(), state.shown.dq.tolist()
        self.applied: Vector = state.driven.torque.tolist()
        self.offset, self.lost = float(state.offset), bool(state.lost_in_a_row)

    def _drives(self) -> Drives:
        config = self.config
        return Drives(
            self._period, config.input_delay, config.late_samples,
            np.array(config.torque_resolution), np.array(config.torque_saturation),
            np.array(config.actuator_lag), np.array(config.torque_rate_limit),
            float(not any(config.actuator_lag) and min(config.torque_rate_limit) == inf))

    def _mechanics(self, ideal: float) -> Mechanics:
        """Return what acts on the coordinates: disturbance on links, the rest on motors."""
        config, more = self.config, (0.0,) * (self._coupled.n - self.n)
        if config.disturbance_push != self._push:
            self._push = config.disturbance_push
            self._push_end = self.k + round(config.disturbance_push_duration / self._period)

        def on_links(x: Vector) -> Array:
            return np.array((*x, *more))

        def on_motors(x: Vector | Array, of_links: float = 0.0) -> Array:
            values = np.full(self._coupled.n, of_links)
            values[self._motors] = x
            return values

        viscous = np.array(config.viscous_friction)
        if self.braking:
            viscous = viscous + config.fault_damping
        friction = Friction(
            on_motors(config.coulomb_friction), on_motors(config.load_friction),
            on_motors(config.friction_asymmetry), on_motors(viscous),
            on_motors(config.stribeck_friction), on_motors(config.stribeck_velocity, 1.0),
            float(bool(config.friction_model)))
        return Mechanics(
            self.period_ns, self._period, self._substeps,
            on_links(config.disturbance_amplitude), on_links(config.disturbance_frequency),
            on_links(self._push), self._push_end if any(self._push) else 0,
            on_motors(config.actuator_lag), on_motors(config.torque_rate_limit, inf), ideal,
            friction)

    @property
    def computed_by(self) -> str:
        """Return what computes the next step."""
        step = self.compiled_step
        return MACHINE_CODE if step is not None and step.compiled else PLAIN_PYTHON

    @property
    def modes(self) -> tuple[int, ...]:
        """Return +1 or -1 for each coordinate that slides, 0 if it sticks or has no friction."""
        return tuple(map(int, self.state.motion.mode))

    @property
    def t(self) -> float:
        """Time of the present sample [s]."""
        return seconds(self.k * self.period_ns)

    @property
    def stamp(self) -> int:
        """Return the time of the measurement since the start [ns]."""
        return self.k * self.period_ns + round(1e9 * self.offset)

    def brake(self, on: bool) -> None:
        """Put the brakes on or off: viscous friction `fault_damping` beside all other."""
        if on != self.braking:
            self.braking = on
            self.configure(self.config)

    def step(self, tau: Vector | Array) -> None:
        """
        Receive the torque `tau`, shape (n,) [N·m], and go on by one control period.

        The torque received `input_delay` samples ago is quantised and saturated; the drives follow
        it over the period.

        Raises
        ------
        CtcError
            If the motion leaves the range of floating-point numbers.

        """
        command = np.array(tau, float)
        if command.shape != (self.n,) or not isfinite(sum(command.tolist())):
            raise ParameterError('tau', tau, f'{self.n} finite numbers')
        try:
            step = self.compiled_step
            if step is not None and step.compiled:
                if self._is_random:
                    step.set_input(self._draw_input(command))
                step.go_on(command)
            else:
                with np.errstate(all='ignore'):  # What overflows shows in the state.
                    self.state = stepped(self._moving, self.parameters, self.state, self.transit,
                                         self._draw_input(command))
            self._show()
            if not isfinite(sum(self.q) + sum(self.dq)):
                raise OverflowError
        except (ArithmeticError, ValueError, np.linalg.LinAlgError):  # sin(inf)
            raise diverged(self.t, self.state.driven.commanded) from None
        self.k += 1

    def _draw_input(self, command: Array) -> PlantInput:
        """Return the input of a sample, with random numbers where the parameters ask for any."""
        late, lost, off = [random.random() if getattr(self.config, name) else 1.0
                           for name, random in self.chances.items()]
        sensor = self.sensor.encoders
        return PlantInput(command, late, lost, off, self.sensor.noise(sensor.position_noise),
                          self.sensor.noise(sensor.velocity_noise))


def diverged(t: float, torque: Array) -> CtcError:
    """Return the error of a motion that leaves the range of numbers at `t` [s]."""
    shown = ', '.join(f'{x:.4g}' for x in torque)
    return CtcError(f'the motion of the plant diverged at t = {t:g} s, '
                    f'under a torque of [{shown}] N*m')


def limits_of(config: PlantConfig, description: str) -> list[JointLimits] | None:
    """Return the limits of the description, which no plant keeps by itself; None without any."""
    if config.model != 'urdf' or not description:
        return None
    return read_limits(description, config.joint_names)


def check_start(config: PlantConfig, description: str) -> None:
    """Raise `CtcError` if the plant starts beyond the limits of its description."""
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

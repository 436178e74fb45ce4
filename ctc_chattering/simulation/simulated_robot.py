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

"""What every simulated robot has, whatever moves it: a clock, drives, sensors, and a network."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
import math
from math import inf, isfinite
import operator
from random import Random

from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.numerics.compilable import each
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.numerics.time_grid import period_ns, samples, seconds
from ctc_chattering.simulation.compiled_plant import CompiledPlantStep
from ctc_chattering.simulation.drive import Driven, driven, Drives
from ctc_chattering.simulation.friction import Friction
from ctc_chattering.simulation.motion import Acting, acting, Mechanics
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.simulation.plant_step import lost_in_a_row, offset_of
from ctc_chattering.simulation.sensor import off_the_grid, Sensor

#: Values of the joints as those of the coordinates.
ToCoordinates = Callable[..., Vector]


class Robot(ABC):
    """
    State of a simulated robot; a subclass has the physics.

    Contract: `step` advances `k` by one and the time by one control period.

    Parameters
    ----------
    config : PlantConfig
        Start, drives, sensors and network.
    on_motors, on_links : callable, optional
        Return values of the joints, shape (n,), as those of the coordinates of `_move`: of their
        motors, and of their links. Left out, the joints are the coordinates.
    longest_step : float
        Largest step that the physics can integrate [s].

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
    config : PlantConfig
        In force.

    """

    def __init__(self, config: PlantConfig, on_motors: ToCoordinates | None = None,
                 on_links: ToCoordinates | None = None, longest_step: float = inf) -> None:
        self.n = len(config.joint_names)
        self.q: Vector = config.initial_position
        self.dq: Vector = config.initial_velocity
        self.k = 0
        rest = [0.0] * self.n
        self.driven = Driven(rest, rest, rest, rest)
        self.transit: list[Vector] = [rest] * config.input_delay
        self._on_motors = on_motors or _joints
        self._on_links = on_links or _joints
        self._braking = False
        #: The push, and the first sample after it.
        self._push: Vector = rest
        self._push_end = 0
        self.period_ns = period_ns(config.control_period)
        self._period = seconds(self.period_ns)
        self.last = samples(config.duration, self.period_ns)
        self.sensor = Sensor(
            config.encoder_resolution, config.position_noise, config.velocity_noise,
            config.noise_seed, config.velocity_sensor, config.velocity_cutoff, self._period)
        self.measured = self.sensor.measure(*self._seen())
        self.offset = 0.0
        #: As of `plant_step.lost_in_a_row`.
        self.lost_in_a_row = 0
        self.loss, self.lateness, self.jitter = (
            Random(f'{config.noise_seed} {of}') for of in ('loss', 'lateness', 'jitter'))
        self._substeps = max(1, math.ceil(
            self._period / min(longest_step, config.integration_step) - 1e-9))
        self._h = self._period / self._substeps

    @property
    def applied(self) -> Vector:
        """Return the torque of the drives at the end of the last period, shape (n,) [N·m]."""
        return self.driven.torque

    def compiled_step(self) -> CompiledPlantStep | None:
        """Return the step from now on as machine code takes it; None where it cannot."""
        return None

    @property
    @abstractmethod
    def computed_by(self) -> str:
        """Return what computes the next step, such as plain Python."""

    @property
    def lost(self) -> bool:
        """Whether the measurement is not sent: `step` then takes the last torque again."""
        return self.lost_in_a_row > 0

    @property
    def stamp(self) -> int:
        """Return the time of the measurement since the start [ns]."""
        return self.k * self.period_ns + round(1e9 * self.offset)

    @property
    def steps(self) -> int:
        """Return the number of steps of the integrator in the whole run."""
        return self.last * self._substeps

    def _seen(self) -> tuple[Vector, Vector]:
        """Return the position and the velocity that the sensors turn into measurements."""
        return self.q, self.dq

    def configure(self, config: PlantConfig) -> None:
        """Use another friction or disturbance from the next step on."""
        self.config = config
        if config.disturbance_push != self._push:
            self._push = config.disturbance_push
            self._push_end = self.k + round(config.disturbance_push_duration / self._period)
        ideal = not any(config.actuator_lag) and min(config.torque_rate_limit) == inf
        self.drives = Drives(
            self._period, config.input_delay, config.late_samples, config.torque_resolution,
            config.torque_saturation, config.actuator_lag, config.torque_rate_limit,
            float(any(config.torque_resolution)), float(min(config.torque_saturation) < inf),
            float(ideal))
        links, motors = self._on_links, self._on_motors
        self.mechanics = Mechanics(
            self.period_ns, self._period, self._substeps, self._h,
            links(config.disturbance_amplitude), links(config.disturbance_frequency),
            float(any(config.disturbance_amplitude)), links(self._push),
            self._push_end if any(self._push) else 0, motors(config.actuator_lag),
            motors(config.torque_rate_limit, inf), float(ideal), self._friction())

    def _friction(self) -> Friction:
        """Return the friction in force, that of the brakes included."""
        config, motors = self.config, self._on_motors
        viscous: Vector = config.viscous_friction
        if self._braking:
            viscous = each(operator.add, viscous, config.fault_damping)
        return Friction(
            motors(config.coulomb_friction), motors(config.load_friction),
            motors(config.friction_asymmetry),
            motors(each(operator.add, config.coulomb_friction, config.stribeck_friction)),
            motors(viscous), motors(config.stribeck_friction), motors(config.stribeck_velocity),
            float(any(config.load_friction)), float(any(config.friction_asymmetry)),
            float(any(viscous) or any(config.stribeck_friction)),
            float(bool(config.friction_model)))

    @property
    def braking(self) -> bool:
        """Whether the brakes are on: viscous friction `fault_damping` beside all other."""
        return self._braking

    @braking.setter
    def braking(self, on: bool) -> None:
        if on != self._braking:
            self._braking = on
            self.configure(self.config)

    @property
    def t(self) -> float:
        """Time of the present sample [s]."""
        return seconds(self.k * self.period_ns)

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
        try:
            command = [float(x) for x in tau]
        except (TypeError, ValueError, OverflowError):
            command = []
        if len(command) != self.n:
            raise ParameterError('tau', tau, f'{self.n} numbers')
        tau = command
        if not isfinite(sum(tau)):
            raise CtcError(f'the torque {tau} at t = {self.t:g} s is not finite')
        try:
            self._go_on(tau)
            if not isfinite(sum(self.q) + sum(self.dq)):
                raise OverflowError
        except (ArithmeticError, ValueError):  # sin(inf)
            raise diverged(self.t, self.driven.commanded) from None
        self.k += 1

    def _go_on(self, tau: Vector) -> None:
        """Bring all but `k` to the next sample."""
        late = self.lateness.random() if self.config.late_samples else 1.0
        self.driven = driven(self.drives, self.driven, self.transit, self.k, tau, late)
        drives = self.driven
        if self._on_motors is not _joints:
            drives = Driven(*map(self._on_motors, drives))
        _, before = self._seen()
        self._move(acting(self.mechanics, drives, self.k))
        q, dq = self._seen()
        last, self.offset = self.offset, 0.0
        if self.config.sample_jitter:
            self.offset = offset_of(self.config.sample_jitter, self.jitter.random())
            q, dq = off_the_grid(q, dq, before, self.offset, self._period)
        self.measured = self.sensor.measure(q, dq, self._period + self.offset - last)
        if self.lost_in_a_row or self.config.sample_loss:
            loss = self.loss.random() if self.config.sample_loss else 1.0
            self.lost_in_a_row = lost_in_a_row(
                self.config.sample_loss, loss, self.lost_in_a_row, self.k + 1, self.last)

    @abstractmethod
    def _move(self, now: Acting) -> None:
        """Bring `q` and `dq` to the next sample."""


def _joints(values: Vector, _of_links: float = 0.0) -> Vector:
    """Return values of the joints, which are the coordinates."""
    return values


def diverged(t: float, torque: Vector) -> CtcError:
    """Return the error of a motion that leaves the range of numbers at `t` [s]."""
    shown = ', '.join(f'{x:.4g}' for x in torque)
    return CtcError(f'the motion of the plant diverged at t = {t:g} s, '
                    f'under a torque of [{shown}] N*m')

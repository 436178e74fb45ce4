"""What every simulated robot has, whatever moves it: a clock, drives, sensors, and a network."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
import math
from math import inf, isfinite
from random import Random

from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.numerics.time_grid import period_ns, samples, seconds
from ctc_chattering.simulation.disturbance import disturbance
from ctc_chattering.simulation.drive import Drives
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.simulation.sensor import quantised, Sensor

#: Most samples in a row that are lost: the controller takes a gap of three periods for no outage.
_MOST_LOST = 2


class Robot(ABC):
    """
    State of a simulated robot; a subclass has the physics.

    Contract: `step` advances `k` by one and the time by one control period.

    Parameters
    ----------
    config : PlantConfig
        Start, drives, sensors and network.
    motors : sequence of int, optional
        Index in the torques of `_move` on which each drive acts; 0 to n - 1 if left out.
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
    lost : bool
        Whether that measurement is not sent: `step` then takes the last torque again.
    config : PlantConfig
        In force.

    """

    def __init__(self, config: PlantConfig, motors: Sequence[int] | None = None,
                 longest_step: float = inf) -> None:
        self.n = len(config.joint_names)
        self.q: Vector = config.initial_position
        self.dq: Vector = config.initial_velocity
        self.k = 0
        rest = (0.0,) * self.n
        self.applied: Vector = rest
        self._received: Vector = rest
        self._coming: deque[Vector] = deque([rest] * config.input_delay)
        self._limited = min(config.torque_saturation) < inf
        self._coarse = any(config.torque_resolution)
        self._drives = Drives(config.actuator_lag, config.torque_rate_limit)
        self._motors = motors or range(self.n)
        self._braking = False
        #: The push, and the first sample after it.
        self._push: Vector = rest
        self._push_end = 0
        self.period_ns = period_ns(config.control_period)
        self._period = seconds(self.period_ns)
        self._last = samples(config.duration, self.period_ns)
        self._sensor = Sensor(
            config.encoder_resolution, config.position_noise, config.velocity_noise,
            config.noise_seed, config.velocity_sensor, config.velocity_cutoff, self._period)
        self.measured = self._sensor.measure(*self._seen())
        self.lost, self._lost_in_a_row = False, 0
        self._loss, self._lateness = (
            Random(f'{config.noise_seed} {of}').random for of in ('loss', 'lateness'))
        self._substeps = max(1, math.ceil(
            self._period / min(longest_step, config.integration_step) - 1e-9))
        self._h = self._period / self._substeps

    @property
    def steps(self) -> int:
        """Return the number of steps of the integrator in the whole run."""
        return self._last * self._substeps

    def _seen(self) -> tuple[Vector, Vector]:
        """Return the position and the velocity that the sensors turn into measurements."""
        return self.q, self.dq

    def configure(self, config: PlantConfig) -> None:
        """Use another friction or disturbance from the next step on."""
        self.config = config
        if config.disturbance_push != self._push:
            self._push = config.disturbance_push
            self._push_end = self.k + round(config.disturbance_push_duration / self._period)
        self._set_disturbed()
        self._loaded = any(config.load_friction)
        self._uneven = any(config.friction_asymmetry)

    def _set_disturbed(self) -> None:
        """Set what acts over the next periods."""
        self._pushing = any(self._push) and self.k < self._push_end
        self._disturbed = self._pushing or any(self.config.disturbance_amplitude)
        self._varying = self._disturbed or not self._drives.ideal

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
        t = self.t
        try:
            command = [float(x) for x in tau]
        except (TypeError, ValueError, OverflowError):
            command = []
        if len(command) != self.n:
            raise ParameterError('tau', tau, f'{self.n} numbers')
        tau = command
        if not isfinite(sum(tau)):
            raise CtcError(f'the torque {tau} at t = {t:g} s is not finite')
        self.applied = tau = self._commanded(tau)
        if not self._drives.ideal:
            self._drives.command(tau, self._period)
            self.applied = self._drives.torque
        try:
            self._move(t, self._minus_asymmetry(tau))
            if not isfinite(sum(self.q) + sum(self.dq)):
                raise OverflowError
        except (ArithmeticError, ValueError):  # sin(inf)
            shown = ', '.join(f'{x:.4g}' for x in tau)
            raise CtcError(f'the motion of the plant diverged at t = {t:g} s, '
                           f'under a torque of [{shown}] N*m') from None
        self.k += 1
        if self.k == self._push_end:
            self._set_disturbed()
        self.measured = self._sensor.measure(*self._seen())
        self._lose()

    def _commanded(self, tau: Vector) -> Vector:
        """Return what is commanded to the drives over the period that a torque `tau` begins."""
        now = tau
        if self.config.late_samples and self._lateness() < self.config.late_samples:
            now = self._received
        self._received = tau
        if self._coming:
            self._coming.append(now)
            now = self._coming.popleft()
        if self._coarse:
            now = quantised(now, self.config.torque_resolution)
        if self._limited:
            now = [min(max(x, -limit), limit)
                   for x, limit in zip(now, self.config.torque_saturation)]
        return now

    def _lose(self) -> None:
        """Decide whether the measurement is lost."""
        lost = self.config.sample_loss > 0.0 and self._loss() < self.config.sample_loss
        self.lost = lost and self._lost_in_a_row < _MOST_LOST and self.k != self._last
        self._lost_in_a_row = self._lost_in_a_row + 1 if self.lost else 0

    def _coulomb_friction(self) -> Vector:
        """Return Kf with what the torque over the present period adds to it, shape (n,)."""
        config = self.config
        if not self._loaded:
            return config.coulomb_friction
        torque = self.applied if self._drives.ideal else self._drives.mean
        return [kf + share * abs(x) for kf, share, x in zip(
            config.coulomb_friction, config.load_friction, torque)]

    def _minus_asymmetry(self, tau: Vector) -> Vector:
        """Return `tau` less the constant part of a friction that depends on the direction."""
        if not self._uneven:
            return tau
        return [x - a * kf for x, a, kf in zip(
            tau, self.config.friction_asymmetry, self._coulomb_friction())]

    def _viscous_friction(self) -> Vector:
        """Return the viscous friction in force, that of the brakes included, shape (n,)."""
        viscous = self.config.viscous_friction
        if self._braking:
            return [a + b for a, b in zip(viscous, self.config.fault_damping)]
        return viscous

    @abstractmethod
    def _move(self, t: float, tau: Vector) -> None:
        """Bring `q` and `dq` from `t` [s] to the next sample under the command `tau` [N·m]."""

    def _torque(self, t: float, tau: Vector, half: float = 0.0) -> Vector:
        """
        Return torque plus disturbance at `t`, shape (n,).

        Parameters
        ----------
        t : float
            Time [s].
        tau : sequence of float, shape (n,)
            Command [N·m].
        half : float
            If not 0, `t` is the middle of a step of twice this length [s], and Simpson's rule
            over it must have the impulse of the drives.

        """
        if self._disturbed:
            tau = plus(tau, range(self.n), disturbance(
                self.config.disturbance_amplitude, self.config.disturbance_frequency, t))
        if self._pushing:
            tau = plus(tau, range(self.n), self._push)
        if not self._drives.ideal:
            s = t - self.t
            tau = plus(tau, self._motors,
                       self._drives.middle(s, half) if half else self._drives.error(s))
        return tau


def plus(x: Vector, indices: Sequence[int], more: Vector) -> list[float]:
    """Return `x` with `more` added to its elements of these indices."""
    result = list(x)
    for i, value in zip(indices, more):
        result[i] += value
    return result

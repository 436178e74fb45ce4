"""What every simulated robot has, whatever moves it: a clock, drives, and sensors."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
import math
from math import isfinite

from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import period_ns, seconds
from ctc_chattering.simulation.disturbance import disturbance
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.simulation.sensor import Sensor


class Robot(ABC):
    """
    State of a simulated robot; a subclass has the physics.

    Contract: `step` holds the torque for exactly one control period and advances `k` by one.

    Parameters
    ----------
    config : PlantConfig
        Start, drives and sensors.

    Attributes
    ----------
    n : int
        Number of joints.
    q, dq : sequence of float, shape (n,)
        True position [rad] and velocity [rad/s] at sample `k`.
    k : int
        Sample index; the time is k h.
    applied : sequence of float, shape (n,)
        Torque that was applied over the last period, delayed and saturated [N·m].
    measured : (sequence of float, sequence of float), each of shape (n,)
        Position and velocity as the sensors have them at sample `k`.
    config : PlantConfig
        In force.

    """

    def __init__(self, config: PlantConfig) -> None:
        self.n = len(config.joint_names)
        self.q: Vector = config.initial_position
        self.dq: Vector = config.initial_velocity
        self.k = 0
        rest = (0.0,) * self.n
        self.applied: Vector = rest
        self._coming: deque[Vector] = deque([rest] * config.input_delay)
        self._sensor = Sensor(config.encoder_resolution, config.position_noise,
                              config.velocity_noise, config.noise_seed)
        self.measured = self._sensor.measure(self.q, self.dq)
        self._braking = False
        self.period_ns = period_ns(config.control_period)
        period = seconds(self.period_ns)
        self._substeps = max(1, math.ceil(period / config.integration_step - 1e-9))
        self._h = period / self._substeps

    def configure(self, config: PlantConfig) -> None:
        """Use another friction or disturbance from the next step on."""
        self.config = config
        self._disturbed = any(config.disturbance_amplitude)

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

    def step(self, tau: Vector) -> None:
        """
        Receive the torque `tau`, shape (n,) [N·m], and go on by one control period.

        What is held over the period is the torque received `input_delay` samples ago, within
        the saturation.

        Raises
        ------
        CtcError
            If the motion leaves the range of floating-point numbers.

        """
        t = self.t
        if not isfinite(sum(tau)):
            raise CtcError(f'the torque {list(tau)} at t = {t:g} s is not finite')
        self._coming.append(tau)
        self.applied = tau = [min(max(x, -limit), limit) for x, limit in zip(
            self._coming.popleft(), self.config.torque_saturation)]
        try:
            self._move(t, tau)
            if not isfinite(sum(self.q) + sum(self.dq)):
                raise OverflowError
        except (ArithmeticError, ValueError):  # sin(inf)
            shown = ', '.join(f'{x:.4g}' for x in tau)
            raise CtcError(f'the motion of the plant diverged at t = {t:g} s, '
                           f'under a torque of [{shown}] N*m') from None
        self.k += 1
        self.measured = self._sensor.measure(self.q, self.dq)

    def _viscous_friction(self) -> Vector:
        """Return the viscous friction in force, that of the brakes included, shape (n,)."""
        viscous = self.config.viscous_friction
        if self._braking:
            return [a + b for a, b in zip(viscous, self.config.fault_damping)]
        return viscous

    @abstractmethod
    def _move(self, t: float, tau: Vector) -> None:
        """Bring `q` and `dq` from `t` [s] to the next sample under the torque `tau` [N·m]."""

    def _torque(self, t: float, tau: Vector) -> Vector:
        """Return torque plus disturbance, shape (n,)."""
        if not self._disturbed:
            return tau
        d = disturbance(
            self.config.disturbance_amplitude, self.config.disturbance_frequency, t)
        return [a + b for a, b in zip(tau, d)]

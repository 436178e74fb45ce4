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
An independent plant, with the faults of real arms, under a control loop of its own.

Nothing here is of `ctc_chattering.simulation`, `control` or `dynamics`: bodies by Pinocchio's
parser, dynamics by `rigid_bodies`, steps with set-valued friction by `faulty_dynamics`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from typing import Any, NamedTuple

from ctc_chattering.bags.recording import Recording
from ctc_chattering.live.skeleton import two_link_urdf
from ctc_chattering.trajectory.motions import Route
from faulty_dynamics import advance, Physics, play, State
from identified_robots import arm, motion
import numpy as np
from rigid_bodies import Array, Bodies, bodies_of, dynamics

#: Longest step of the plant [s].
_STEP = 2.5e-4
#: The paper's arm has 0.76 kg m² in place of the 0.62 of bodies, beside its cosine.
_COUPLING = 0.14


@dataclasses.dataclass(frozen=True)
class Faulty:
    """
    A robot with its truth; arrays have shape (n,).

    Attributes
    ----------
    name : str
        As `identified_robots.arm` has it.
    nominal : Bodies
        What the lab believes.
    physics : Physics
        What is true.
    period : float
        Of control [s].
    delay : int
        Samples.
    encoder, position_noise, velocity_noise : ndarray
        Step of the encoders [rad], and deviations of noise [rad, rad/s].
    caution : float
        Part of the usual gains that the lab dares.
    ahead : float
        Part of the Coulomb friction that the lab adds to its commands.

    """

    name: str
    nominal: Bodies
    physics: Physics
    period: float = 1e-3
    delay: int = 0
    encoder: Any = 0.0
    position_noise: Any = 0.0
    velocity_noise: Any = 1e-3
    caution: float = 1.0
    ahead: float = 0.0

    @property
    def joints(self) -> tuple[str, ...]:
        """Return the names of the joints."""
        return arm(self.name).joints

    @property
    def n(self) -> int:
        """Return the number of joints."""
        return len(self.physics.coulomb)

    def with_physics(self, **values: Any) -> Faulty:
        """Return it with other values of `Physics`, numbers for all joints or arrays."""
        full: dict[str, Any] = {key: x if key in ('bodies', 'helper') else np.array(
            np.broadcast_to(x, self.n), float) for key, x in values.items()}
        return dataclasses.replace(self, physics=self.physics._replace(**full))

    def with_bodies(self, **values: Any) -> Faulty:
        """Return it with other values of its true `Bodies`."""
        return self.with_physics(bodies=self.physics.bodies._replace(**values))


def description(name: str) -> str:
    """Return the URDF of a robot; that of the paper's arm has the joints that it has."""
    return arm(name).urdf or two_link_urdf(arm(name).joints)


def plain(name: str, seed: int) -> Faulty:
    """Return a robot without a fault, whose friction is drawn."""
    robot = arm(name)
    n = len(robot.joints)
    bodies = bodies_of(description(name), robot.joints)
    if not robot.urdf:
        bodies = bodies._replace(more=np.array([[0.0, _COUPLING], [_COUPLING, 0.0]]))
    rng = np.random.default_rng((seed, 1))
    coulomb = np.array([rng.uniform(*limits) for limits in robot.friction])
    zero, one = np.zeros(n), np.ones(n)
    return Faulty(name, bodies, Physics(
        bodies=bodies, helper=bodies, coulomb=coulomb, offset=zero,
        viscous=rng.uniform(0.1, 0.4, n) * coulomb, stribeck=zero, stribeck_speed=one, load=zero,
        load_bias=zero,
        ripple=zero, cogging=zero, waves=zero, phase=zero, drift=zero, drift_time=one,
        rotor=zero, elastic=np.zeros(1, np.int64), stiffness=zero, damping=zero, gap=zero,
        scale=one, lag=zero, rate=np.inf * one, saturation=np.inf * one, helped=zero,
        quadratic=zero, band=zero, stop=np.inf * one),
        encoder=robot.resolution * one, position_noise=zero, velocity_noise=1e-3 * one)


class Plant:
    """
    A faulty robot that receives one command a period.

    Parameters
    ----------
    robot : Faulty
        What it is.
    start : sequence of float, shape (n,)
        Position at rest [rad].
    seed : int
        Of the noise of its sensors.

    Attributes
    ----------
    state : State
        The truth.

    """

    def __init__(self, robot: Faulty, start: Sequence[float], seed: int = 0) -> None:
        self.robot = robot
        self.state = state_of(robot, start)
        self._noise = np.random.default_rng((seed, 2))

    def measured(self) -> tuple[Array, Array]:
        """Return positions [rad] and velocities [rad/s] as the sensors have them now."""
        robot, n = self.robot, self.robot.n
        noise = self._noise.normal(size=(2, n))
        q = self.state.x[:n] + robot.position_noise * noise[0]
        step = np.where(robot.encoder > 0.0, robot.encoder, 1.0)
        return (np.where(robot.encoder > 0.0, step * np.floor(q / step + 0.5), q),
                self.state.v[:n] + robot.velocity_noise * noise[1])

    def step(self, command: Sequence[float] | Array) -> None:
        """Receive a command [N·m], and go on by a period."""
        steps = round(np.ceil(self.robot.period / _STEP))
        advance(self.robot.physics, self.state, np.array(command, float), steps,
                self.robot.period / steps)


def state_of(robot: Faulty, start: Sequence[float]) -> State:
    """Return a robot at rest, held by the drives against its weight."""
    n, physics = robot.n, robot.physics
    x, still = np.array(start, float), np.zeros(n)
    weight, inside, mass = np.zeros(n), np.zeros(n), np.zeros((n, n))
    dynamics(physics.bodies, x, still, mass, weight)
    dynamics(physics.helper, x, still, mass, inside)
    torque = np.clip((weight - physics.helped * inside) / physics.scale, -physics.saturation,
                     physics.saturation)
    if physics.elastic[0]:
        sag = np.where(weight > 0.0, 0.5, -0.5) * physics.gap + weight / physics.stiffness
        x = np.concatenate((x, x - sag))
    return State(np.zeros(1), x, np.zeros_like(x), np.zeros_like(x), torque, weight,
                 np.tile(torque, (robot.delay + 1, 1)))


class Played(NamedTuple):
    """
    A motion that was played; N samples.

    Attributes
    ----------
    t : ndarray, shape (N,)
        [s].
    q, dq : ndarray, shape (N, n)
        As measured.
    drive, link, command : ndarray, shape (N, n)
        Torque of the drives, torque behind the gears, and that commanded at a sample [N·m].
    position, velocity, acceleration, wanted : ndarray, shape (N, n)
        The truth, and positions asked for.

    """

    t: Array
    q: Array
    dq: Array
    drive: Array
    link: Array
    command: Array
    position: Array
    velocity: Array
    acceleration: Array
    wanted: Array

    def perturbation(self, nominal: Bodies) -> Array:
        """Return torque of the drives less inverse dynamics, means of 20 samples [N·m]."""
        n = self.q.shape[1]
        mass, bias, found = np.empty((n, n)), np.empty(n), self.drive.copy()
        for k, (q, dq, ddq) in enumerate(zip(self.position, self.velocity, self.acceleration)):
            dynamics(nominal, q, dq, mass, bias)
            found[k] -= mass @ ddq + bias
        whole = len(found) // 20
        mean: Array = found[:20 * whole].reshape(whole, 20, n).mean(axis=1)
        return mean


def played(robot: Faulty, route: Route, seed: int, gains: tuple[float, float] | None = None
           ) -> Played:
    """Return what is seen of a motion under computed torque; `gains` are kp and kv."""
    wanted = sampled(route, robot.period)
    n = robot.n
    rng = np.random.default_rng((seed, 3))
    noise = rng.normal(size=(len(wanted), 2, n)) * np.array(
        [robot.position_noise, robot.velocity_noise])
    kp, kv = gains or lab_gains(robot)
    steps = round(np.ceil(robot.period / _STEP))
    out = np.empty((len(wanted), 8, n))
    play(robot.physics, state_of(robot, wanted[0, 0]), robot.nominal,
         np.stack((np.full(n, kp), np.full(n, kv), robot.ahead * robot.physics.coulomb)),
         wanted, noise, np.array(robot.encoder, float),
         robot.period, steps, out)
    t: Array = robot.period * np.arange(len(wanted), dtype=float)
    return Played(t, *out.transpose(1, 0, 2), wanted[:, 0])  # type: ignore[call-arg]


def lab_gains(robot: Faulty) -> tuple[float, float]:
    """Return kp [1/s²] and kv [1/s] that a lab would have, with what it knows of its delays."""
    late = robot.period * (1 + robot.delay) + float(robot.physics.lag.max())
    kv = robot.caution * min(60.0, 0.2 / late)
    return 0.25 * kv * kv, kv


def sampled(route: Route, period: float) -> Array:
    """Return positions, velocities and accelerations of quintics, shape (N, 3, n)."""
    times = np.array(route.times) * 1e-9
    points = np.array(route.points, float)
    t = period * np.arange(int(times[-1] / period + 1e-9) + 1)
    k = np.clip(np.searchsorted(times, t, side='right') - 1, 0, len(times) - 2)
    h = (times[k + 1] - times[k])[:, None]
    s = (t - times[k])[:, None] / h
    a, b = points[k], points[k + 1]
    q0, v0, a0 = a[:, 0], a[:, 1] * h, a[:, 2] * h * h
    q1, v1, a1 = b[:, 0], b[:, 1] * h, b[:, 2] * h * h
    way, v, w = q1 - q0 - v0 - 0.5 * a0, v1 - v0 - a0, a1 - a0
    c = (10.0 * way - 4.0 * v + 0.5 * w, -15.0 * way + 7.0 * v - w, 6.0 * way - 3.0 * v + 0.5 * w)
    rest = [c[0] * s ** 3 + c[1] * s ** 4 + c[2] * s ** 5,
            3.0 * c[0] * s ** 2 + 4.0 * c[1] * s ** 3 + 5.0 * c[2] * s ** 4,
            6.0 * c[0] * s + 12.0 * c[1] * s ** 2 + 20.0 * c[2] * s ** 3]
    found: Array = np.stack((
        q0 + v0 * s + 0.5 * a0 * s * s + rest[0], (v0 + a0 * s + rest[1]) / h,
        (a0 + rest[2]) / (h * h)), axis=1)
    return found


def recording_of(robot: Faulty, seen: Played, effort: str = 'none') -> Recording:
    """Return a recording; `effort` is none, motor or link."""
    measured = {'none': None, 'motor': seen.drive, 'link': seen.link}[effort]
    return Recording(robot.name, robot.joints, seen.t, seen.q, seen.dq, measured, seen.command)


def record(name: str, seed: int, duration: float = 25.0, **more: Mapping[str, Any]
           ) -> tuple[Faulty, Recording]:
    """Return a plain robot and a recording of it; `more` are values of `Physics`."""
    robot = plain(name, seed).with_physics(**more)
    route = motion(arm(name), duration, seed)
    return robot, recording_of(robot, played(robot, route, seed))

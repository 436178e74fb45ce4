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
Robots with the faults of real arms, on the independent plant, under a control loop of its own.

Nothing here is of `ctc_chattering.simulation`, `control` or `dynamics`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import dataclasses
from typing import Any, NamedTuple

from ctc_chattering.identification.recording import Recording
from ctc_chattering.trajectory.waypoints import Route
from independent_plant import advance, at_rest, ideal, Physics, Plant, State
import numpy as np
from rigid_bodies import Array, Bodies, compiled, dynamics
from robots import arm
from scipy.interpolate import BPoly  # type: ignore[import-untyped]

#: Longest step of the plant [s].
_STEP = 2.5e-4
Rng = np.random.Generator


@dataclasses.dataclass(frozen=True)
class Faulty:
    """
    A robot with its truth; arrays have shape (n,).

    Attributes
    ----------
    name : str
        As `robots.arm` has it.
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
        return dataclasses.replace(self, physics=self.physics.changed(**values))

    def with_bodies(self, **values: Any) -> Faulty:
        """Return it with other values of its true `Bodies`."""
        return self.with_physics(bodies=self.physics.bodies._replace(**values))


@dataclasses.dataclass(frozen=True)
class Case:
    """
    A robot with a fault, and how it is recorded.

    Attributes
    ----------
    robot : Faulty
        The truth.
    effort : str
        What the states have: none, motor, or link.
    alter : callable, optional
        What the recorder makes of the recording.
    bag : bool
        Whether it must go through a bag with receive jitter.
    slower : callable, optional
        What the lab makes of the usual motion.
    believed : str
        The arm whose description the user gives, if it is another one.
    own_delay : ndarray, shape (n,)
        Samples by which commands of a joint act later than those of the others.
    band : ndarray, shape (n,)
        Torque that each drive takes of its command [N·m].

    """

    robot: Faulty
    effort: str = 'none'
    alter: Callable[[Recording], Recording] | None = None
    bag: bool = False
    slower: Callable[[Route], Route] | None = None
    believed: str = ''
    own_delay: Array | float = 0.0
    band: Array | float = 0.0


Made = Callable[[Faulty, Rng, float], Faulty | Case]


def plain(name: str, seed: int) -> Faulty:
    """Return a robot without a fault, whose friction is drawn."""
    robot = arm(name)
    rng = np.random.default_rng((seed, 1))
    coulomb = np.array([rng.uniform(*limits) for limits in robot.friction])
    one, bodies = np.ones(robot.n), robot.bodies()
    return Faulty(name, bodies, ideal(bodies).changed(
        coulomb=coulomb, viscous=rng.uniform(0.1, 0.4, robot.n) * coulomb),
        encoder=robot.resolution * one, position_noise=0.0 * one, velocity_noise=1e-3 * one)


def plant_of(robot: Faulty, start: Sequence[float], seed: int = 0) -> Plant:
    """Return the plant of a robot, held at rest at a position [rad]."""
    return Plant(robot.physics, start, robot.period, robot.delay, encoder=robot.encoder,
                 position_noise=robot.position_noise, velocity_noise=robot.velocity_noise,
                 longest=_STEP, seed=seed)


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
    play(robot.physics, at_rest(robot.physics, wanted[0, 0], robot.delay), robot.nominal,
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
    t = period * np.arange(int(times[-1] / period + 1e-9) + 1)
    motion = BPoly.from_derivatives(times, np.array(route.points, float))
    return np.stack([motion(t, k) for k in range(3)], axis=1)


def recording_of(robot: Faulty, seen: Played, effort: str = 'none') -> Recording:
    """Return a recording; `effort` is none, motor or link."""
    measured = {'none': None, 'motor': seen.drive, 'link': seen.link}[effort]
    return Recording(robot.name, robot.joints, seen.t, seen.q, seen.dq, measured, seen.command)


@compiled
def play(plant: Physics, now: State, nominal: Bodies, gains: Array, wanted: Array, noise: Array,
         resolution: Array, period: float, steps: int, out: Array) -> None:
    """
    Play a motion under computed torque with PD, and write what is recorded of it.

    Parameters
    ----------
    plant, now : Physics, State
        The robot, and where it is; `now` goes on.
    nominal : Bodies
        Of the computed torque.
    gains : ndarray, shape (3, n)
        kp [1/s²], kv [1/s], and the friction that is added ahead [N·m].
    wanted : ndarray, shape (N, 3, n)
        Positions, velocities and accelerations.
    noise : ndarray, shape (N, 2, n)
        Of positions, before they are quantised, and of velocities.
    resolution : ndarray, shape (n,)
        Of the encoders [rad]; 0 for none.
    period, steps : float, int
        Of the control [s], and of the integration within it.
    out : ndarray, shape (N, 8, n)
        Measured positions and velocities, torques of the drives and through the gears, commands,
        true positions, velocities and accelerations.

    """
    n = len(plant.coulomb)
    mass, bias, weight = np.empty((n, n)), np.empty(n), np.zeros(n)
    command, still = np.empty(n), np.zeros(n)
    for k in range(len(wanted)):
        for i in range(n):
            q = now.x[i] + noise[k, 0, i]
            if resolution[i] > 0.0:
                q = resolution[i] * np.floor(q / resolution[i] + 0.5)
            out[k, 0, i], out[k, 1, i] = q, now.v[i] + noise[k, 1, i]
            out[k, 2, i], out[k, 3, i] = now.torque[i], now.through[i]
            out[k, 5, i], out[k, 6, i], out[k, 7, i] = now.x[i], now.v[i], now.a[i]
        if plant.helped.any():
            dynamics(nominal, out[k, 0], still, mass, weight)
        dynamics(nominal, out[k, 0], out[k, 1], mass, bias)
        for i in range(n):
            command[i] = (bias[i] - plant.helped[i] * weight[i]
                          + gains[2, i] * np.tanh(wanted[k, 1, i] / 0.02))
            for j in range(n):
                command[i] += mass[i, j] * (
                    wanted[k, 2, j] + gains[1, j] * (wanted[k, 1, j] - out[k, 1, j])
                    + gains[0, j] * (wanted[k, 0, j] - out[k, 0, j]))
            out[k, 4, i] = command[i]
        advance(plant, now, out[k, 4], steps, period / steps)

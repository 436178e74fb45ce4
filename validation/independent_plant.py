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
The plant of all studies, independent of this package: nothing here is of `ctc_chattering`.

Rigid bodies (`rigid_bodies`), elastic joints with backlash, friction that is set-valued or of
bristles (LuGre), drives with a lag, a limit of the rate, a delay and a limit of the torque,
encoders, and noise. A step is of second order: forces at the midpoint, and the friction of joints
that slide or stick as a linear complementarity problem, which is solved exactly: a joint that
sticks has velocity 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from rigid_bodies import Array, Bodies, compiled, dynamics

#: Stiffness of an end stop [N·m/rad].
_STOP = 2000.0
#: Attempts at the friction in which all joints may change between sliding and sticking. Later,
#: one joint an attempt may.
_TOGETHER = 10
#: All attempts.
_ATTEMPTS = 200


class Physics(NamedTuple):
    """
    A robot of n joints as it is; arrays have shape (n,) and units in N·m, rad, s.

    Attributes
    ----------
    bodies : Bodies
        Without the rotors.
    helper : Bodies
        Whose weight the robot compensates inside, where `helped` is 1.
    coulomb, offset, viscous : ndarray
        Coulomb friction is coulomb + offset forwards, and coulomb - offset backwards.
    stribeck, stribeck_speed : ndarray
        Ks and v_s of Ks exp(-(dq / v_s)²).
    bristle : ndarray
        Stiffness of bristles [N·m/rad]; 0 for set-valued friction.
    load, load_bias : ndarray
        Friction as a part of the magnitude of the torque that goes through the gear: load times
        1 + load_bias forwards, and 1 - load_bias backwards.
    ripple, cogging, waves, phase : ndarray
        Coulomb friction times 1 + ripple sin(waves q + phase); a torque cogging sin(waves q).
    drift, drift_time : ndarray
        Friction times 1 + drift exp(-t / drift_time).
    rotor : ndarray
        Inertia of the rotor, at the joint [kg m²].
    stiffness, damping, gap : ndarray
        Of a spring between rotor and link [N·m/rad, N·m·s/rad, rad]; rigid if all are 0.
    scale, lag, rate, saturation : ndarray
        The drive: torque for a commanded one, lag [s], rate limit [N·m/s], largest command.
    helped : ndarray
        1 where the robot adds the weight of `helper`.
    quadratic, band : ndarray
        Friction quadratic max(|v| - band, 0)² [N·m s²/rad², rad/s].
    stop : ndarray
        Position of a hard end stop [rad].
    push, pushed : ndarray, shape (n,) and (2,)
        A torque against the motor between two instants.

    """

    bodies: Bodies
    helper: Bodies
    coulomb: Array
    offset: Array
    viscous: Array
    stribeck: Array
    stribeck_speed: Array
    bristle: Array
    load: Array
    load_bias: Array
    ripple: Array
    cogging: Array
    waves: Array
    phase: Array
    drift: Array
    drift_time: Array
    rotor: Array
    stiffness: Array
    damping: Array
    gap: Array
    scale: Array
    lag: Array
    rate: Array
    saturation: Array
    helped: Array
    quadratic: Array
    band: Array
    stop: Array
    push: Array
    pushed: Array

    def changed(self, **values: Any) -> Physics:
        """Return it with other values; numbers are of all joints."""
        n = len(self.coulomb)
        full: dict[str, Any] = {
            key: x if key in ('bodies', 'helper') else np.array(
                np.broadcast_to(x, 2 if key == 'pushed' else n), float)
            for key, x in values.items()}
        return self._replace(**full)


def ideal(bodies: Bodies) -> Physics:
    """Return a robot without friction, whose drives are perfect."""
    n = len(bodies.mass)
    others = {'stribeck_speed': 1.0, 'drift_time': 1.0, 'scale': 1.0, 'rate': np.inf,
              'saturation': np.inf, 'stop': np.inf}
    arrays = {name: np.full(n, others.get(name, 0.0)) for name in Physics._fields[2:-1]}
    return Physics(bodies, bodies, **arrays, pushed=np.zeros(2))


class State(NamedTuple):
    """
    State of N coordinates, which are the joints, or rotors and then links.

    Attributes
    ----------
    time : ndarray, shape (1,)
        [s].
    x, v, a : ndarray, shape (N,)
        Positions, velocities, accelerations.
    torque, through, bend : ndarray, shape (n,)
        Of the drives, before their scale, and that which goes through the gears [N·m]; of the
        bristles [rad].
    queue : ndarray, shape (delay + 1, n)
        Commands in transit, the oldest first.

    """

    time: Array
    x: Array
    v: Array
    a: Array
    torque: Array
    through: Array
    bend: Array
    queue: Array


def at_rest(physics: Physics, start: Sequence[float] | Array, delay: int = 0, held: bool = True
            ) -> State:
    """Return a robot at rest; if `held`, by the drives against its weight, else without torque."""
    n = len(physics.coulomb)
    x, still = np.array(start, float), np.zeros(n)
    weight, inside, mass = np.zeros(n), np.zeros(n), np.zeros((n, n))
    if held:
        dynamics(physics.bodies, x, still, mass, weight)
        dynamics(physics.helper, x, still, mass, inside)
    torque = np.clip((weight - physics.helped * inside) / physics.scale, -physics.saturation,
                     physics.saturation)
    if physics.stiffness.any():
        sag = np.where(weight > 0.0, 0.5, -0.5) * physics.gap + weight / physics.stiffness
        x = np.concatenate((x, x - sag))
    return State(np.zeros(1), x, np.zeros_like(x), np.zeros_like(x), torque, weight, np.zeros(n),
                 np.tile(torque, (delay + 1, 1)))


@compiled
def solve(w: Array, rhs: Array, free: Array, out: Array) -> None:
    """Write the solution of the rows and columns of a positive definite w that are free."""
    n = len(rhs)
    low = np.empty((n, n))
    for i in range(n):
        if free[i] == 0.0:
            out[i] = 0.0
            continue
        y = rhs[i]
        for j in range(i + 1):
            if free[j] == 0.0:
                continue
            value = w[i, j]
            for k in range(j):
                if free[k] != 0.0:
                    value -= low[i, k] * low[j, k]
            low[i, j] = np.sqrt(value) if i == j else value / low[j, j]
            if j < i:
                y -= low[i, j] * out[j]
        out[i] = y / low[i, i]
    for i in range(n - 1, -1, -1):
        if free[i] == 0.0:
            continue
        y = out[i]
        for j in range(i + 1, n):
            if free[j] != 0.0:
                y -= low[j, i] * out[j]
        out[i] = y / low[i, i]


@compiled
def with_friction(w: Array, rhs: Array, most: Array, least: Array, way: Array, v: Array) -> None:
    """
    Write velocities v for w v = rhs - f, with friction f in its set, and f into rhs.

    f_i = most_i where v_i > 0, least_i where v_i < 0, and between them where v_i = 0. `way` is
    the guess, 1, -1 or 0 for each coordinate, and becomes what is found.
    """
    n = len(rhs)
    free, known = np.empty(n), np.empty(n)
    for attempt in range(_ATTEMPTS):
        for i in range(n):
            held = most[i] > least[i] and way[i] == 0.0
            free[i] = 0.0 if held else 1.0
            known[i] = rhs[i] - (most[i] if way[i] > 0.0 else least[i] if way[i] < 0.0 else 0.0)
        solve(w, known, free, v)
        changed = False
        for i in range(n):
            if most[i] <= least[i] or (changed and attempt > _TOGETHER):
                continue
            if way[i] == 0.0:
                need = rhs[i]
                for j in range(n):
                    need -= w[i, j] * v[j]
                known[i] = need
                if need > most[i] or need < least[i]:
                    way[i] = 1.0 if need > most[i] else -1.0
                    changed = True
            elif way[i] * v[i] <= 0.0:
                way[i] = 0.0
                changed = True
        if not changed:
            break
    for i in range(n):
        rhs[i] = 0.0 if most[i] <= least[i] else (
            most[i] if way[i] > 0.0 else least[i] if way[i] < 0.0 else known[i])


@compiled
def driven(plant: Physics, now: State, h: float, mean: Array) -> None:
    """Let the drives go on by h, and write the mean of their torque."""
    for i in range(len(mean)):
        limit = plant.saturation[i]
        target = min(max(now.queue[0, i], -limit), limit)
        before, lag, rate = now.torque[i], plant.lag[i], plant.rate[i]
        after, mean[i] = target, target
        if lag > 0.0:
            part = np.exp(-h / lag)
            after = target + (before - target) * part
            mean[i] = target + (before - target) * (1.0 - part) * lag / h
        way = after - before
        if abs(way) > rate * h:
            after = before + (rate * h if way > 0.0 else -rate * h)
            mean[i] = 0.5 * (before + after)
        elif lag == 0.0 and way != 0.0:
            mean[i] = target - way * abs(way) / (2.0 * rate * h)
        now.torque[i] = after


@compiled
def frictions(plant: Physics, now: State, h: float, most: Array, least: Array) -> None:
    """Write the impulses that friction takes on at most, forwards and backwards."""
    for i in range(len(plant.coulomb)):
        x, v = now.x[i] + 0.5 * h * now.v[i], now.v[i] + 0.5 * h * now.a[i]
        warm = 1.0 + plant.drift[i] * np.exp(-now.time[0] / plant.drift_time[i])
        size = warm * (1.0 + plant.ripple[i] * np.sin(plant.waves[i] * x + plant.phase[i]))
        load = plant.load[i] * abs(now.through[i])
        more = load + plant.stribeck[i] * np.exp(
            -(v / plant.stribeck_speed[i]) ** 2) + plant.quadratic[i] * max(
                abs(v) - plant.band[i], 0.0) ** 2
        biased = size * plant.offset[i] + load * plant.load_bias[i]
        most[i] = h * (size * plant.coulomb[i] + more + biased)
        least[i] = -h * (size * plant.coulomb[i] + more - biased)


@compiled
def bend(plant: Physics, now: State, h: float, w: Array, rhs: Array, most: Array, least: Array,
         turn: Array) -> None:
    """Put bristles in the place of set-valued friction: w v = rhs; write what turns them back."""
    for i in range(len(plant.bristle)):
        stiff = plant.bristle[i]
        if stiff > 0.0:
            turn[i] = h * stiff * abs(now.v[i] + 0.5 * h * now.a[i]) / (most[i] / h)
            keeps, damps = 1.0 / (1.0 + turn[i]), np.sqrt(stiff * w[i, i])
            rhs[i] -= h * (stiff * keeps + damps * (keeps - 1.0) / h) * now.bend[i]
            w[i, i] += h * keeps * (h * stiff + damps)
            most[i], least[i] = 0.0, 0.0


@compiled
def advance(plant: Physics, now: State, command: Array, steps: int, h: float) -> None:
    """Receive a command, and go on by `steps` steps of h [s]."""
    n, size = len(plant.coulomb), len(now.x)
    for i in range(n):
        for k in range(len(now.queue) - 1):
            now.queue[k, i] = now.queue[k + 1, i]
        now.queue[-1, i] = command[i]
    links = size - n
    w, rhs, v = np.empty((size, size)), np.empty(size), np.empty(size)
    mass, bias, help_mass, weight = (
        np.empty((n, n)), np.empty(n), np.empty((n, n)), np.zeros(n))
    mean, most, least, way = np.empty(n), np.zeros(size), np.zeros(size), np.empty(size)
    middle = np.empty(size)
    still, turned = np.zeros(n), np.zeros(n)
    for _ in range(steps):
        driven(plant, now, h, mean)
        frictions(plant, now, h, most, least)
        for i in range(size):
            middle[i] = now.x[i] + 0.5 * h * now.v[i]
            v[i] = now.v[i] + 0.5 * h * now.a[i]
        if plant.helped.any():
            dynamics(plant.helper, middle[:n], still, help_mass, weight)
        dynamics(plant.bodies, middle[links:], v[links:], mass, bias)
        pushed = 1.0 if plant.pushed[0] <= now.time[0] < plant.pushed[1] else 0.0
        for i in range(size):
            rhs[i] = 0.0
            for j in range(size):
                w[i, j] = mass[i - links, j - links] if min(i, j) >= links else 0.0
        for i in range(n):
            mean[i] = (plant.scale[i] * mean[i] + plant.helped[i] * weight[i]
                       - plant.cogging[i] * np.sin(plant.waves[i] * middle[i])
                       - _STOP * max(middle[i] - plant.stop[i], 0.0))
            w[i, i] += plant.rotor[i]
        for i in range(size):
            for j in range(size):
                rhs[i] += w[i, j] * now.v[j]
            way[i] = np.sign(now.v[i])
        bend(plant, now, h, w, rhs, most, least, turned)
        for i in range(n):
            rhs[i] += h * (mean[i] - 0.5 * plant.viscous[i] * now.v[i])
            rhs[links + i] -= h * (bias[i] + pushed * plant.push[i])
            w[i, i] += 0.5 * h * plant.viscous[i]
            if links:
                turn, slip = now.x[i] - now.x[n + i], now.v[i] - now.v[n + i]
                edge = 0.5 * plant.gap[i]
                ahead = turn + 0.5 * h * slip
                touches = abs(ahead) >= edge
                rest = min(max(ahead, -edge), edge)
                rigid = h * (0.25 * h * plant.stiffness[i] + 0.5 * plant.damping[i]) * touches
                pull = h * plant.stiffness[i] * (turn - rest) * touches + rigid * slip
                rhs[i] -= pull
                rhs[n + i] += pull
                w[i, i] += rigid
                w[n + i, n + i] += rigid
                w[i, n + i] -= rigid
                w[n + i, i] -= rigid
        with_friction(w, rhs, most, least, way, v)
        for i in range(n):
            now.through[i] = (mean[i] - rhs[i] / h - 0.5 * plant.viscous[i] * (now.v[i] + v[i])
                              - plant.rotor[i] * (v[i] - now.v[i]) / h)
            now.bend[i] = (now.bend[i] + h * v[i]) / (1.0 + turned[i])
        for i in range(size):
            now.x[i] += 0.5 * h * (now.v[i] + v[i])
            now.a[i] = (v[i] - now.v[i]) / h
            now.v[i] = v[i]
        now.time[0] += h


class Plant:
    """
    A robot that receives a command a period, and its sensors.

    Parameters
    ----------
    physics : Physics
        What it is.
    start : sequence of float, shape (n,)
        Position at rest [rad].
    period : float
        Of the control [s].
    delay : int
        Samples after which a command acts.
    held : bool
        Whether the drives hold it at first; else they have no torque.
    encoder, position_noise, velocity_noise : float or ndarray of shape (n,)
        Step of the encoders [rad], 0 for none; deviations of noise [rad, rad/s]. Without
        `velocity_noise` velocities are differences of the positions that were measured.
    longest : float
        Longest step [s].
    seed : int
        Of the noise.

    Attributes
    ----------
    state : State
        The truth.

    """

    def __init__(self, physics: Physics, start: Sequence[float] | Array, period: float = 1e-3,
                 delay: int = 0, held: bool = True, encoder: Any = 0.0,
                 position_noise: Any = 0.0, velocity_noise: Any = None, longest: float = 2.5e-4,
                 seed: int = 0) -> None:
        self.state = at_rest(physics, start, delay, held)
        self._physics, self._period, self._longest = physics, period, longest
        self._encoder = np.broadcast_to(encoder, len(physics.coulomb))
        self._deviation = position_noise, velocity_noise
        self._noise = np.random.default_rng((seed, 2))
        self._before: tuple[float, Array] | None = None

    @property
    def q(self) -> Array:
        """Return the true positions of the joints, shape (n,) [rad]."""
        return self.state.x[:len(self._encoder)]

    def measured(self) -> tuple[Array, Array]:
        """Return positions [rad] and velocities [rad/s] as the sensors have them now."""
        n, (of_q, of_dq) = len(self._encoder), self._deviation
        noise = self._noise.normal(size=(2, n))
        q = quantised(self.q + of_q * noise[0], self._encoder)
        if of_dq is not None:
            return q, self.state.v[:n] + of_dq * noise[1]
        t = float(self.state.time[0])
        at, last = self._before or (t - self._period, q)
        self._before = t, q
        return q, (q - last) / (t - at)

    def step(self, command: Sequence[float] | Array, duration: float | None = None) -> None:
        """Receive a command [N·m], and go on by a period, or another duration [s]."""
        h = self._period if duration is None else duration
        steps = max(int(np.ceil(h / self._longest - 1e-9)), 1)
        advance(self._physics, self.state, np.array(command, float), steps, h / steps)


def quantised(q: Array, step: Array) -> Array:
    """Return positions as encoders have them; with a step of 0 as they are."""
    steps = np.where(step > 0.0, step, 1.0)
    return np.where(step > 0.0, steps * np.floor(q / steps + 0.5), q)

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
The step of a plant with the faults of real arms, as machine code; friction is set-valued.

A step is of second order: forces at the midpoint, and the friction of joints that slide or stick
as a linear complementarity problem, which is solved exactly: a joint that sticks has velocity 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from rigid_bodies import Array, Bodies, compiled, dynamics
from set_valued_friction import with_friction

#: Stiffness of an end stop [N·m/rad].
_STOP = 2000.0


class Physics(NamedTuple):
    """
    A plant of n joints; arrays have shape (n,) and units in N·m, rad, s.

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
    load, load_bias : ndarray
        Friction as a part of the magnitude of the torque that goes through the gear: load times
        1 + load_bias forwards, and 1 - load_bias backwards.
    ripple, cogging, waves, phase : ndarray
        Coulomb friction times 1 + ripple sin(waves q + phase); a torque cogging sin(waves q).
    drift, drift_time : ndarray
        Friction times 1 + drift exp(-t / drift_time).
    rotor : ndarray
        Inertia of the rotor, at the joint [kg m²].
    elastic : ndarray of int, shape (1,)
        Whether rotor and link are joined by a spring; then rotors are the first n coordinates.
    stiffness, damping, gap : ndarray
        Of that spring [N·m/rad, N·m·s/rad, rad].
    scale, lag, rate, saturation : ndarray
        The drive: torque for a commanded one, lag [s], rate limit [N·m/s], largest command.
    helped : ndarray
        1 where the robot adds the weight of `helper`.
    quadratic, band : ndarray
        Friction quadratic max(|v| - band, 0)² [N·m s²/rad², rad/s].
    stop : ndarray
        Position of a hard end stop [rad].

    """

    bodies: Bodies
    helper: Bodies
    coulomb: Array
    offset: Array
    viscous: Array
    stribeck: Array
    stribeck_speed: Array
    load: Array
    load_bias: Array
    ripple: Array
    cogging: Array
    waves: Array
    phase: Array
    drift: Array
    drift_time: Array
    rotor: Array
    elastic: Array
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


class State(NamedTuple):
    """
    What changes; N coordinates, which are the joints, or rotors and then links.

    Attributes
    ----------
    time : ndarray, shape (1,)
        [s].
    x, v, a : ndarray, shape (N,)
        Positions, velocities, accelerations.
    torque, through : ndarray, shape (n,)
        Of the drives, before their scale, and that which goes through the gears [N·m].
    queue : ndarray, shape (delay + 1, n)
        Commands in transit.

    """

    time: Array
    x: Array
    v: Array
    a: Array
    torque: Array
    through: Array
    queue: Array


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
def advance(plant: Physics, now: State, command: Array, steps: int, h: float) -> None:
    """Receive a command, and go on by `steps` steps of h [s]."""
    n, size = len(plant.coulomb), len(now.x)
    for k in range(len(now.queue) - 1):
        now.queue[k] = now.queue[k + 1]
    now.queue[-1] = command
    links = size - n
    w, rhs, v = np.empty((size, size)), np.empty(size), np.empty(size)
    mass, bias, help_mass, weight = (
        np.empty((n, n)), np.empty(n), np.empty((n, n)), np.zeros(n))
    mean, most, least, way = np.empty(n), np.zeros(size), np.zeros(size), np.empty(size)
    still = np.zeros(n)
    for _ in range(steps):
        driven(plant, now, h, mean)
        frictions(plant, now, h, most, least)
        middle = now.x + 0.5 * h * now.v
        if plant.helped.any():
            dynamics(plant.helper, middle[:n], still, help_mass, weight)
        dynamics(plant.bodies, middle[links:], (now.v + 0.5 * h * now.a)[links:], mass, bias)
        w[:] = 0.0
        w[links:, links:] = mass
        rhs[:] = 0.0
        for i in range(n):
            mean[i] = (plant.scale[i] * mean[i] + plant.helped[i] * weight[i]
                       - plant.cogging[i] * np.sin(plant.waves[i] * middle[i])
                       - _STOP * max(middle[i] - plant.stop[i], 0.0))
            w[i, i] += plant.rotor[i]
        for i in range(size):
            for j in range(size):
                rhs[i] += w[i, j] * now.v[j]
            way[i] = np.sign(now.v[i])
        for i in range(n):
            rhs[i] += h * (mean[i] - 0.5 * plant.viscous[i] * now.v[i])
            rhs[links + i] -= h * bias[i]
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
        for i in range(size):
            now.x[i] += 0.5 * h * (now.v[i] + v[i])
            now.a[i] = (v[i] - now.v[i]) / h
            now.v[i] = v[i]
        now.time[0] += h


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

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
An independent plant for judging laws: nothing here is of `ctc_chattering`.

The two-link arm is written down from its Lagrangian, other arms by `rigid_bodies`. Friction is
set-valued (Coulomb and Stribeck), viscous, or of bristles (LuGre); drives have a lag, a limit of
the rate, a delay and a limit of the torque; encoders are quantised. A step of the plant is of
second order between events, and joints that stick have the velocity 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from rigid_bodies import Array, Bodies, compiled, dynamics
from set_valued_friction import with_friction

#: Velocities [rad/s] above which a joint that rested slips, and below which it rests again.
_SLIPS, _RESTS = 1e-3, 1e-4


class Arm(NamedTuple):
    """
    A robot as it is; arrays have shape (n,) and units in N·m, rad, s.

    Attributes
    ----------
    bodies : Bodies
        Not of the two-link arm.
    numbers : ndarray, shape (7,) or (0,)
        Of the two-link arm: M11 = a + 2 b cos q2, M12 = c + b cos q2, M22 = d, and the weights
        g1, g2, in this order a, b, c, d, g1, g2, and gravity; empty for `bodies`.
    coulomb, viscous, stribeck, speed : ndarray
        F = ±(coulomb + stribeck exp(-(v / speed)²)) + viscous v.
    bristle : ndarray
        Stiffness of bristles; 0 for set-valued friction.
    lag, rate, saturation : ndarray
        Of the drives.
    load, times : ndarray, shape (n,) and (2,)
        A torque against the motor between two instants.
    rest : ndarray, shape (k, 2)
        Intervals in which slips are counted [s].

    """

    bodies: Bodies
    numbers: Array
    coulomb: Array
    viscous: Array
    stribeck: Array
    speed: Array
    bristle: Array
    lag: Array
    rate: Array
    saturation: Array
    load: Array
    times: Array
    rest: Array


class Motion(NamedTuple):
    """
    What changes, with shape (n,) each unless it says otherwise.

    Attributes
    ----------
    time : ndarray, shape (1,)
        [s].
    q, dq, ddq : ndarray
        True position, velocity and acceleration.
    torque : ndarray
        Of the drives.
    bend : ndarray
        Of the bristles [rad].
    queue : ndarray, shape (d + 1, n)
        Commands, the oldest first.
    resting, slips : ndarray
        1 for a joint that rested, and how often it has slipped within `Arm.rest`.

    """

    time: Array
    q: Array
    dq: Array
    ddq: Array
    torque: Array
    bend: Array
    queue: Array
    resting: Array
    slips: Array


def motion_from(q: Array, dq: Array, delay: int) -> Motion:
    """Return a motion that begins at a state with no torque."""
    n = len(q)
    zero = [np.zeros(n) for _ in range(5)]
    return Motion(np.zeros(1), q.astype(float), dq.astype(float), zero[0], zero[1], zero[2],
                  np.zeros((delay + 1, n)), zero[3], zero[4])


@compiled
def equations(arm: Arm, q: Array, dq: Array, mass: Array, bias: Array) -> None:
    """Write M and what else is on the left side without friction."""
    if len(arm.numbers) == 0:
        dynamics(arm.bodies, q, dq, mass, bias)
        return
    a, b, c, d, g1, g2, g = arm.numbers
    cosine, sine = np.cos(q[1]), np.sin(q[1])
    mass[0, 0], mass[1, 1] = a + 2.0 * b * cosine, d
    mass[0, 1] = mass[1, 0] = c + b * cosine
    # d/dt ∂L/∂dq - ∂L/∂q, with T = ½ M11 dq1² + M12 dq1 dq2 + ½ d dq2².
    second = g * g2 * np.sin(q[0] + q[1])
    bias[0] = -b * sine * dq[1] * (2.0 * dq[0] + dq[1]) + g * g1 * np.sin(q[0]) + second
    bias[1] = b * sine * dq[0] * dq[0] + second


@compiled
def driven(arm: Arm, now: Motion, h: float, mean: Array) -> None:
    """Let the torque follow the oldest command for h, and write its mean."""
    for i in range(len(mean)):
        limit, lag = arm.saturation[i], arm.lag[i]
        goal, before = min(max(now.queue[0, i], -limit), limit), now.torque[i]
        way = goal - before
        if lag > 0.0:
            way *= 1.0 - np.exp(-h / lag)
        most = arm.rate[i] * h
        now.torque[i] = before + min(max(way, -most), most)
        mean[i] = 0.5 * (before + now.torque[i])


@compiled
def count_slips(arm: Arm, now: Motion) -> None:
    """Count joints that begin to slip while the motion is to rest."""
    inside = False
    for k in range(len(arm.rest)):
        inside = inside or arm.rest[k, 0] <= now.time[0] <= arm.rest[k, 1]
    for i in range(len(now.q)):
        speed = abs(now.dq[i])
        if inside and now.resting[i] == 1.0 and speed > _SLIPS:
            now.slips[i] += 1.0
        if speed < _RESTS:
            now.resting[i] = 1.0
        elif speed > _SLIPS:
            now.resting[i] = 0.0


@compiled
def set_up(arm: Arm, now: Motion, h: float, w: Array, rhs: Array, most: Array) -> None:
    """Add inertia, bristles and viscous friction to w v = rhs, and write what friction holds."""
    n = len(now.q)
    for i in range(n):
        for j in range(n):
            rhs[i] += w[i, j] * now.dq[j]
    for i in range(n):
        speed = now.dq[i] + 0.5 * h * now.ddq[i]
        level = arm.coulomb[i] + arm.stribeck[i] * np.exp(-(speed / arm.speed[i]) ** 2)
        stiff, most[i] = arm.bristle[i], h * level
        if stiff > 0.0:
            keeps = 1.0 / (1.0 + h * stiff * abs(speed) / level)
            damps = np.sqrt(stiff * w[i, i])
            rhs[i] -= h * (stiff * keeps + damps * (keeps - 1.0) / h) * now.bend[i]
            w[i, i] += h * keeps * (h * stiff + damps)
            most[i] = 0.0
        w[i, i] += 0.5 * h * arm.viscous[i]
        rhs[i] -= 0.5 * h * arm.viscous[i] * now.dq[i]


@compiled
def go_on(arm: Arm, now: Motion, command: Array, steps: int, h: float) -> None:
    """Take a command, and go on by `steps` steps of h [s]."""
    n = len(now.q)
    for k in range(len(now.queue) - 1):
        now.queue[k] = now.queue[k + 1]
    now.queue[-1] = command
    w, bias, rhs, v, mean = (
        np.empty((n, n)), np.empty(n), np.empty(n), np.empty(n), np.empty(n))
    most, way = np.empty(n), np.empty(n)
    for _ in range(steps):
        driven(arm, now, h, mean)
        equations(arm, now.q + 0.5 * h * now.dq, now.dq + 0.5 * h * now.ddq, w, bias)
        loaded = 1.0 if arm.times[0] <= now.time[0] < arm.times[1] else 0.0
        for i in range(n):
            rhs[i] = h * (mean[i] - bias[i] - loaded * arm.load[i])
            way[i] = np.sign(now.dq[i])
        set_up(arm, now, h, w, rhs, most)
        with_friction(w, rhs, most, -most, way, v)
        for i in range(n):
            if arm.bristle[i] > 0.0:
                speed = abs(now.dq[i] + 0.5 * h * now.ddq[i])
                level = arm.coulomb[i] + arm.stribeck[i] * np.exp(-(speed / arm.speed[i]) ** 2)
                now.bend[i] = (now.bend[i] + h * v[i]) / (1.0 + h * arm.bristle[i] * speed / level)
            now.q[i] += 0.5 * h * (now.dq[i] + v[i])
            now.ddq[i] = (v[i] - now.dq[i]) / h
            now.dq[i] = v[i]
        now.time[0] += h
        count_slips(arm, now)

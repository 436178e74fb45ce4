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

"""Held-out conditions, drawn by a seed: robots, motions that they can do, what is told."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any, NamedTuple

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.control.recommended_gains import estimator_bandwidth, largest_pole, lateness
from independent_plant import ideal, Physics
import numpy as np
from rigid_bodies import Array, Bodies, dynamics, PAPER, planar
from robots import arm, DESCRIBED

#: What the controller may be told: the law's name alone; `ka` and the limits of the torque as
#: well, as docs/safety.md says of a robot of which nothing is known; the gains by the rule of
#: docs/theory.md as well, nothing of the drives; lag and rate limit roughly, and the delay.
TELLINGS = ('name', 'nothing', 'gains', 'rough')
#: Rivals that are told what `rough` is, and the friction to 10 %.
RIVALS = {'eso': 'extended_state_observer', 'integral': 'integral'}
#: Duration [s].
DURATION = 9.0
#: Of the paper's arm: centre of the motion [rad], largest torques [N·m] and velocities [rad/s].
_PAPER = (np.pi, np.pi / 2), (600.0, 120.0), (6.0, 6.0)
#: Span of a window in which a change of torque is counted as a rate [s].
_WINDOW = 0.05
#: Share of the robots that are two-link arms.
_TWO_LINK_SHARE = 0.4
#: Share of the draws of a quantity that are from its whole range. Others are ordinary.
_WIDE_SHARE = 0.45
_QUANTITIES = ('lag', 'rate', 'encoder', 'delay', 'period', 'friction', 'stribeck', 'model',
               'payload', 'start', 'load')


class Robot(NamedTuple):
    """A robot as its lab knows it. Tuples have a number for each joint."""

    name: str
    urdf: str
    joints: tuple[str, ...]
    centre: tuple[float, ...]
    effort: tuple[float, ...]
    speed: tuple[float, ...]

    @property
    def n(self) -> int:
        """Return the number of joints."""
        return len(self.joints)


@cache
def robot(name: str) -> Robot:
    """Return the paper's arm, or a robot by its name."""
    one = arm(name)
    if not one.urdf:
        return Robot(name, '', one.joints, *_PAPER)
    effort, speed = (tuple(x.tolist()) for x in one.limits())
    return Robot(name, one.urdf, one.joints, one.centre, effort, speed)


class Path3(NamedTuple):
    """A motion at its samples; q, dq and ddq have the shape (N, n)."""

    q: Array
    dq: Array
    ddq: Array


def sinusoid(t: Array, centre: Array, size: Array, frequency: Array, phase: Array) -> Path3:
    """Return sinusoids of each joint."""
    w = 2.0 * np.pi * frequency
    angle = np.outer(t, w) + phase
    return Path3(centre + size * np.sin(angle), size * w * np.cos(angle),
                 -size * w * w * np.sin(angle))


def trapezoids(t: Array, centre: Array, size: Array, move: float, stop: float) -> Path3:
    """Return moves to and fro of `move` [s], a third of it for each ramp, with stops between."""
    cycle = move + stop
    k = np.floor(t / cycle)
    s, ramp = np.minimum(t - k * cycle, move) / move, 1.0 / 3.0
    peak = 1.0 / (1.0 - ramp)
    early, late = s < ramp, s >= 1.0 - ramp
    way = np.where(early, 0.5 * peak / ramp * s * s, np.where(
        late, 1.0 - 0.5 * peak / ramp * (1.0 - s) ** 2, peak * (s - 0.5 * ramp)))
    speed = np.where(early, peak / ramp * s, np.where(late, peak / ramp * (1.0 - s), peak))
    moves = t - k * cycle < move
    push = np.where(moves, np.where(early, peak / ramp, np.where(late, -peak / ramp, 0.0)), 0.0)
    sign = np.where(k % 2 == 0, 1.0, -1.0)
    return Path3(
        centre + np.outer(sign * (2.0 * way - 1.0), size),
        np.outer(sign * np.where(moves, 2.0 * speed / move, 0.0), size),
        np.outer(sign * 2.0 * push / move ** 2, size))


def begun(path: Path3, t: Array, start: Array, duration: float) -> Path3:
    """Return a motion that begins smoothly at a position: q = (1 - σ) start + σ path."""
    s = np.minimum(t / duration, 1.0)[:, np.newaxis]
    a, da = s ** 3 * (10.0 - 15.0 * s + 6.0 * s * s), 30.0 * (s * (1.0 - s)) ** 2 / duration
    dda = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / duration ** 2
    gap = path.q - start
    return Path3(start + a * gap, da * gap + a * path.dq,
                 dda * gap + 2.0 * da * path.dq + a * path.ddq)


def needed(bodies: Bodies, t: Array, path: Path3) -> tuple[Array, Array]:
    """Return the largest torque without friction, and its largest rate over 50 ms."""
    n, every = path.q.shape[1], max(int(0.01 / (t[1] - t[0])), 1)
    mass, bias, torques = np.zeros((n, n)), np.zeros(n), []
    for k in range(0, len(t), every):
        dynamics(bodies, path.q[k], path.dq[k], mass, bias)
        torques.append(mass @ path.ddq[k] + bias)
    tau, span = np.array(torques), max(int(_WINDOW / (every * (t[1] - t[0]))), 1)
    change = np.abs(tau[span:] - tau[:-span]).max(axis=0) / _WINDOW
    return np.abs(tau).max(axis=0), change


@dataclasses.dataclass
class Condition:
    """A condition; vectors are lists with a number for each joint, in N·m, rad, s."""

    seed: int
    robot: str
    period: float
    delay: int
    lag: list[float]
    rate: list[float]
    encoder: float
    friction: float
    stribeck: float
    stribeck_speed: float
    bristles: bool
    model: float
    payload: float
    motion: str
    start: float
    load: float
    slowed: float
    #: What is told of the lag and the rate limit, relative to what they are.
    told_lag: float
    told_rate: float
    #: Whether `gains` is told the delay.
    told_delay: bool
    #: The Coulomb friction as it is known to 10 %.
    told_friction: list[float]
    #: Part of the states that is lost, and how far the others are from the grid at most [h].
    lost: float = 0.0
    jitter: float = 0.0

    def text(self) -> str:
        """Return it in a line."""
        lags = f'{1e3 * min(self.lag):.1f}-{1e3 * max(self.lag):.1f}'
        rates = f'{min(self.rate):.0f}-{max(self.rate):.0f}'
        slow = f' at {self.stribeck_speed:.4f} rad/s' if self.stribeck else ''
        return (f'{self.robot}, {1e-3 / self.period:g} kHz, delay {self.delay}, lag {lags} ms, '
                f'R {rates}, encoder {self.encoder:.1e}, friction {self.friction:.2f}'
                f'{" bristles" if self.bristles else ""}, Stribeck +{self.stribeck:.2f}{slow}, '
                f'model {100 * self.model:.0f} %, payload {self.payload:.2f}, {self.motion}, '
                f'start {self.start:+.2f}, load {self.load:.2f}, {100 * self.lost:.0f} % lost, '
                f'jitter {self.jitter:.2f}; told: lag x{self.told_lag:.2f}, '
                f'R x{self.told_rate:.2f}')


def drawn(seed: int, irregular: bool = False) -> tuple[Condition, Physics, Path3, Array]:
    """
    Return a condition, its robot and motion, and the position from which it starts.

    With `irregular`, states are lost and off the grid; the rest is the same.
    """
    rng = np.random.default_rng((seed, 24))
    name = 'two_link' if rng.random() < _TWO_LINK_SHARE else str(rng.choice(list(DESCRIBED)))
    known = robot(name)
    wide = dict(zip(_QUANTITIES, rng.random(len(_QUANTITIES)) < _WIDE_SHARE))
    c = quantities(seed, known, wide, rng)
    bodies = true_bodies(c, known, rng)
    path, first = motion_of(c, known, bodies, rng)
    torque, change = needed(bodies, times(c), path)
    weight = np.maximum(torque, 0.03 * np.array(known.effort))
    coulomb = c.friction * weight
    low, high = (150.0, 2e4) if wide['rate'] else (1e3, 8e3)
    rate = 10.0 ** rng.uniform(np.log10(low), np.log10(high), known.n)
    c.rate = np.maximum(rate, 1.5 * change).tolist()
    load, j = np.zeros(known.n), int(rng.integers(known.n))
    left = known.effort[j] - torque[j] - (1.0 + c.stribeck) * coulomb[j]
    load[j] = min(c.load * max(weight[j], 0.15 * known.effort[j]), 0.6 * left)
    begin = float(rng.uniform(3.0, 6.0))
    if irregular:
        c.lost, c.jitter = np.random.default_rng((seed, 26)).uniform(0.0, (0.1, 0.3)).tolist()
    c.told_friction = (coulomb * np.random.default_rng(seed).uniform(0.9, 1.1, known.n)).tolist()
    physics = ideal(bodies).changed(
        coulomb=coulomb, stribeck=c.stribeck * coulomb, stribeck_speed=c.stribeck_speed,
        viscous=rng.uniform(0.0, 0.3) * coulomb, bristle=2e3 * coulomb * c.bristles, lag=c.lag,
        rate=c.rate, saturation=known.effort, push=load,
        pushed=(begin, begin + rng.uniform(0.5, 2.0)))
    return c, physics, path, first


def quantities(seed: int, known: Robot, wide: dict[str, np.bool_], rng: np.random.Generator
               ) -> Condition:
    """Return a condition without rate limits; `wide` says what is drawn from all of its range."""
    period = float(rng.choice([5e-4, 1e-3, 2e-3, 4e-3])) if wide['period'] else 1e-3
    bits = rng.random() < 0.3
    c = Condition(
        seed, known.name, period, int(rng.integers(4)) if wide['delay'] else 1,
        (rng.uniform(0.0, 5e-3) * np.ones(known.n) if wide['lag'] else rng.uniform(
            1e-3, 2.5e-3, known.n)).tolist(), [],
        (2.0 * np.pi / 2 ** int(rng.integers(12, 21)) if bits else float(
            10.0 ** rng.uniform(-6, -3))) if wide['encoder'] else 1e-5,
        float(rng.uniform(0.0, 0.6) if wide['friction'] else rng.uniform(0.1, 0.3)),
        float(rng.uniform(0.2, 0.6)) if wide['stribeck'] else 0.0,
        float(10.0 ** rng.uniform(-3, -0.5)), bool(rng.random() < 0.2),
        0.2 if wide['model'] else 0.08, float(rng.uniform(0.0, 0.15)) if wide['payload'] else 0.0,
        str(rng.choice(['sinusoid', 'trapezoid'])),
        float(rng.uniform(-1.0, 1.0)) if wide['start'] else 0.0,
        float(rng.uniform(0.1, 0.5)) if wide['load'] else 0.0, 1.0,
        float(rng.uniform(0.5, 1.5)), float(3.0 ** rng.uniform(-1.0, 1.0)),
        bool(rng.random() < 0.5), [])
    c.delay = min(c.delay, int(6e-3 / period))
    return c


def times(c: Condition) -> Array:
    """Return the instants of the samples, and some more for the delay."""
    t: Array = (c.period * np.arange(int(DURATION / c.period) + 8)).astype(np.float64)
    return t


def true_bodies(c: Condition, known: Robot, rng: np.random.Generator) -> Bodies:
    """Return the bodies as they are."""
    n = known.n
    x = 1.0 + rng.uniform(-c.model, c.model, (3, max(n, 6)))
    if not known.urdf:
        numbers = np.array(PAPER) * x[0, :6]
        numbers[[3, 5]] += c.payload * np.array([0.62, 0.63])
        return planar(*numbers)
    bodies = arm(known.name).bodies()
    mass = bodies.mass * x[0, :n]
    mass[-1] += 10.0 * c.payload * bodies.mass.sum() / 25.0
    return bodies._replace(mass=mass, inertia=bodies.inertia * x[1, :n, None, None],
                           centre=bodies.centre * x[2, :n, None])


def motion_of(c: Condition, known: Robot, bodies: Bodies, rng: np.random.Generator
              ) -> tuple[Path3, Array]:
    """Return a motion, as slow as the robot needs it, and the position from which it starts."""
    n, t, centre = known.n, times(c), np.array(known.centre)
    size, frequency = rng.uniform(0.15, 0.45, n), rng.uniform(0.3, 1.0, n)
    phase, move, stop = rng.uniform(0.0, 6.0, n), rng.uniform(0.5, 1.2), rng.uniform(0.6, 1.2)
    for _ in range(12):
        path = sinusoid(t, centre, size, c.slowed * frequency, phase) if (
            c.motion == 'sinusoid') else trapezoids(t, centre, size, move / c.slowed, stop)
        torque, _ = needed(bodies, t, path)
        most = (1.2 + 1.1 * c.friction * (1.0 + c.stribeck)) * torque
        if (most < known.effort).all() and (np.abs(path.dq) < known.speed).all():
            break
        if c.slowed > 0.4:
            c.slowed *= 0.8
        else:  # The weight is too much, not the speed.
            c.friction *= 0.7
    if c.start:
        return path, path.q[0] + c.start * np.sign(rng.uniform(-1.0, 1.0, n))
    first = centre + rng.uniform(-0.3, 0.3, n)
    return begun(path, t, first, 2.0), first


def told(c: Condition, telling: str) -> dict[str, Any]:
    """Return the parameters that a controller has by what it is told."""
    known = robot(c.robot)
    values: dict[str, Any] = {'law': 'observer_feedback', 'control_period': c.period}
    if telling == 'compensation':
        return {**values, 'law': telling, 'input_delay': c.delay}
    if telling == 'name':
        return values
    values['ka'], values['effort_limit'] = [0.5 * x for x in known.effort], list(known.effort)
    if telling == 'nothing':
        return values
    rough = telling == 'rough' or telling in RIVALS
    # What the package assumes of a lag that it is not told; 0 where it assumes nothing.
    lag = max(getattr(ControllerConfig(), 'assumed_lag', (0.0,)))
    if rough:
        lag = c.told_lag * max(c.lag)
        values['actuator_lag'] = [c.told_lag * x for x in c.lag]
        values['torque_rate_limit'] = [c.told_rate * x for x in c.rate]
    if rough or c.told_delay:
        values['input_delay'] = c.delay
    pole = largest_pole(lateness(lag, c.period, values.get('input_delay', 0)))
    width = estimator_bandwidth(pole, c.encoder) if rough else pole
    values = {**values, 'kp': [pole ** 2] * known.n, 'kv': [2.0 * pole] * known.n,
              'estimator_bandwidth': width}
    return {**values, **rival(c, telling, lag)} if telling in RIVALS else values


def rival(c: Condition, telling: str, lag: float) -> dict[str, Any]:
    """Return what a rival has in place of that."""
    n, known = len(c.lag), {'law': RIVALS[telling], 'friction_level': c.told_friction}
    if telling != 'integral':
        return known
    late = max(f / (c.told_rate * r) for f, r in zip(c.told_friction, c.rate))
    p = 0.6 * largest_pole(late + lateness(lag, c.period, c.delay))  # docs/laws.md
    return {**known, 'kp': [3.0 * p ** 2] * n, 'kv': [3.0 * p] * n, 'ki': [p ** 3] * n}

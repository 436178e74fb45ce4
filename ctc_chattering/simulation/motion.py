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
Motion over one sample period under a held torque.

It is equation (1) with set-valued Coulomb friction. `plant_step.advance_plant` calls
`Mechanism.integrate`, which leads from one `Motion` to the next. With the command c, the torque τ
of the drives and the disturbance d::

    M(q) ddq + C(q, dq) dq + G(q) = c + (τ - c)(t) + d(t) - F                             (PM1)

F is set-valued: a joint sticks, or it slides with the mode m = ±1. With the breakaway torque F₀,
the Stribeck friction Fs that is part of it, and the asymmetry a of the Coulomb friction Fc::

    F = m F₀ + a Fc + [viscous dq - m Fs (1 - exp(-(dq / v_s)²)) + own(dq)]               (PM2)

The bracket is 0 at rest. Between changes of mode the motion is smooth, and a Runge-Kutta step of
fourth order follows it. A step h may be longer than the time constants of a damping D, as of
brakes on a light link. A method that is implicit in D then replaces it, that is, where ::

    M - h D is not positive definite                                                      (PM3)

A sliding joint may come to rest, and a stuck one may be overloaded. That instant is located within
the step, the modes are decided again there, and the remaining step follows.

The coordinates are the positions of the joints or, with elastic joints, of links and motors
(`coordinates.py`). Drives and friction act on the motors, the disturbance on the links.
"""

from __future__ import annotations

from math import inf
from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import (
    every,
    function,
    outweighs,
    record,
    solve_damped,
    solve_where,
    some,
    Truths,
)
from ctc_chattering.dynamics.drive_response import middle_error, response
from ctc_chattering.numerics.integration import (
    extrapolated_euler,
    first_negative,
    runge_kutta,
    simpson,
)
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.drive import Drives
from ctc_chattering.simulation.friction import Friction, modes, stick_margin
import numpy as np

#: Changes of mode in one step. Then the step ends in its present mode.
_MAX_EVENTS = 50
#: Width of the interval in which an event is located, relative to the step.
_EVENT_TOLERANCE = 1e-12
#: Rotation in one step [rad]. With half a turn, Coriolis forces would add energy.
_MAX_ROTATION = 0.5
#: Divisions of one step. A motion that needs more diverges.
_MAX_DIVISIONS = 1000
#: Change of velocity for the slope of an own friction, relative to 1 + |dq|.
_VELOCITY_STEP = 1e-6


@record
class Mechanics(NamedTuple):
    """Parameters of all that acts, over the coordinates."""

    #: h [ns] and [s].
    period_ns: int
    period: float
    #: Integration steps in a period.
    steps: int
    #: Disturbance d(t) = amplitude sin(frequency t) [N·m, rad/s].
    amplitude: Array
    frequency: Array
    #: A constant push [N·m], and the first sample after it.
    push: Array
    push_end: int
    #: Over the joints.
    drives: Drives
    friction: Friction
    has_own_friction: bool


@record
class Mechanism(NamedTuple):
    """A model with what acts on it."""

    #: M, C and G of the coordinates: a `Model`, or its compiled counterpart.
    model: Any
    #: A `NoFriction`, or a friction with the same methods.
    own_friction: Any
    mechanics: Mechanics
    #: A `RigidJoints` or `ElasticJoints`.
    joints: Any

    def integrate(self, load: PeriodLoad, motion: Motion) -> Motion:
        """Return the motion a sample period later."""
        mechanics = self.mechanics
        if not motion.decided or some(motion.stuck) or some(
                mechanics.friction.load_friction) or some(motion.dq == 0.0):
            motion = decide_modes(self, load, motion.q, motion.dq, load.start)
        h = mechanics.period / mechanics.steps
        for i in range(mechanics.steps):
            rotation = h * np.abs(motion.dq).max()
            divisions = 1 + int(min(rotation / _MAX_ROTATION, _MAX_DIVISIONS))
            for j in range(divisions):
                s = h / divisions
                motion = integrate_step(self, load, motion, load.start + i * h + j * s, s)
        return motion


@record
class Motion(NamedTuple):
    """State of the coordinates, with their modes."""

    #: Position [rad] and velocity [rad/s].
    q: Array
    dq: Array
    #: m of each joint that slides, else 0, as `modes` returns it.
    mode: Array
    #: 1.0 for a joint that sticks, else 0.0.
    stuck: Array
    #: m F₀ [N·m].
    friction: Array
    #: False until `decide_modes` has set the modes.
    decided: bool


@record
class PeriodLoad(NamedTuple):
    """Load over one period, over the coordinates."""

    #: Time of its start [s].
    start: float
    #: c - a Fc [N·m].
    commanded: Array
    #: F₀ [N·m].
    breakaway: Array
    #: c - τ of the drives at the start, over the joints [N·m].
    gap: Array
    #: Mean torque of the drives [N·m].
    mean: Array
    #: True while a push acts.
    pushed: bool


@record
class Onset(NamedTuple):
    """Start of a motion in which no mode changes."""

    #: c - a Fc - m F₀ [N·m].
    constant: Array
    #: Joints that do not stick.
    free: Truths
    #: Acceleration [rad/s²].
    ddq: Array
    #: True where (PM3) asks for the implicit method.
    stiff: bool


@record
class SmoothMotion(NamedTuple):
    """A motion in which no mode changes."""

    mechanism: Mechanism
    load: PeriodLoad
    start: Motion
    #: Time of its start [s].
    t: float
    onset: Onset


@function
def load_period(mechanism: Mechanism, command: Array, gap: Array, k: int) -> PeriodLoad:
    """
    Return the load over the period after sample `k`.

    Parameters
    ----------
    mechanism : Mechanism
        Robot.
    command, gap : array
        c, and c - τ at the start, over the joints [N·m].
    k : int
        Sample.

    """
    mechanics = mechanism.mechanics
    joints = mechanism.joints
    drives = mechanics.drives
    friction = mechanics.friction
    commanded = joints.on_motors(command)
    mean = commanded
    coulomb = friction.coulomb_friction
    if some(friction.load_friction):
        if not drives.ideal:
            area = response(
                gap, drives.actuator_lag, drives.torque_rate_limit, mechanics.period)[1]
            mean = commanded + joints.on_motors(area) / mechanics.period
        coulomb = coulomb + friction.load_friction * np.abs(mean)
    return PeriodLoad(
        k * mechanics.period_ns / 1e9, commanded - friction.friction_asymmetry * coulomb,
        coulomb + friction.stribeck_friction, gap, mean, k < mechanics.push_end)


@function
def add_disturbance(mechanics: Mechanics, load: PeriodLoad, u: Array, t: float) -> Array:
    """Return `u` plus d(t) and the push [N·m]."""
    if some(mechanics.amplitude):
        u = u + mechanics.amplitude * np.sin(mechanics.frequency * t)
    if load.pushed:
        u = u + mechanics.push
    return u


@function
def total(mechanism: Mechanism, load: PeriodLoad, u: Array, t: float) -> Array:
    """Return `u` plus d(t) and (τ - c)(t) [N·m]."""
    drives = mechanism.mechanics.drives
    u = add_disturbance(mechanism.mechanics, load, u, t)
    if not drives.ideal:
        error = response(
            load.gap, drives.actuator_lag, drives.torque_rate_limit, t - load.start)[0]
        u = u + mechanism.joints.on_motors(error)
    return u


@function
def total_at_middle(mechanism: Mechanism, load: PeriodLoad, u: Array, t: float, half: float
                    ) -> Array:
    """
    Return `total` for the middle `t` of a step.

    Its error of the drives gives Simpson's rule their exact impulse over the step, which is twice
    `half` [s] long.
    """
    drives = mechanism.mechanics.drives
    u = add_disturbance(mechanism.mechanics, load, u, t)
    if not drives.ideal:
        error = middle_error(
            load.gap, drives.actuator_lag, drives.torque_rate_limit, t - load.start, half)
        u = u + mechanism.joints.on_motors(error)
    return u


@function
def subtract_friction(mechanism: Mechanism, load: PeriodLoad, u: Array, dq: Array, mode: Array
                      ) -> Array:
    """Return `u` less the bracket of (PM2) [N·m]."""
    friction = mechanism.mechanics.friction
    u = u - friction.viscous_friction * dq
    if some(friction.stribeck_friction):
        r = dq / friction.stribeck_velocity
        u = u + friction.stribeck_friction * mode * (1.0 - np.exp(-r * r))
    if mechanism.mechanics.has_own_friction:
        u = u - mechanism.own_friction.resistance(dq, load.mean, mode)
    return u


@function
def net_torque(mechanism: Mechanism, load: PeriodLoad, u: Array, q: Array, dq: Array, mode: Array
               ) -> tuple[Array, Array]:
    """Return M, and `u` less the bracket and C dq + G."""
    M, bias = mechanism.model.mass_and_bias(q, dq)
    return M, subtract_friction(mechanism, load, u, dq, mode) - bias


@function
def damping(mechanism: Mechanism, load: PeriodLoad, dq: Array, mode: Array) -> Array:
    """Return D, the positive slope of friction [N·m·s/rad]."""
    slope = mechanism.mechanics.friction.viscous_friction
    if mechanism.mechanics.has_own_friction:
        friction = mechanism.own_friction
        step = _VELOCITY_STEP * (1.0 + np.abs(dq))
        change = (friction.resistance(dq + step, load.mean, mode)
                  - friction.resistance(dq, load.mean, mode))
        slope = slope + np.maximum(change / step, 0.0)
    return slope


@function
def begin_smooth(mechanism: Mechanism, load: PeriodLoad, start: Motion, t: float, h: float
                 ) -> Onset:
    """Return the start of a motion of `h` [s] in the present modes."""
    constant = load.commanded - start.friction
    free = start.stuck == 0.0
    u = total(mechanism, load, constant, t)
    M, torque = net_torque(mechanism, load, u, start.q, start.dq, start.mode)
    slope = damping(mechanism, load, start.dq, start.mode)
    stiff = some(slope) and not outweighs(free, M, h * slope)
    return Onset(constant, free, solve_where(free, M, torque), stiff)


@function
def damped_acceleration(motion: SmoothMotion, q: Array, dq: Array, u: Array, s: float) -> Array:
    """Return the mean ddq of an Euler step, implicit in D [rad/s²]."""
    mode = motion.start.mode
    M, torque = net_torque(motion.mechanism, motion.load, u, q, dq, mode)
    slope = damping(motion.mechanism, motion.load, dq, mode)
    return solve_damped(motion.onset.free, M, s * slope, torque)


@function
def acceleration(motion: SmoothMotion, q: Array, dq: Array, u: Array) -> Array:
    """Return ddq of (PM1), with m F₀ subtracted from `u` [rad/s²]."""
    M, torque = net_torque(motion.mechanism, motion.load, u, q, dq, motion.start.mode)
    return solve_where(motion.onset.free, M, torque)


@function
def advance(motion: SmoothMotion, h: float) -> tuple[Array, Array]:
    """Return q and dq after `h` [s] in the present modes."""
    mechanism = motion.mechanism
    load = motion.load
    u = motion.onset.constant
    q = motion.start.q
    dq = motion.start.dq
    middle = total_at_middle(mechanism, load, u, motion.t + 0.5 * h, 0.5 * h)
    end = total(mechanism, load, u, motion.t + h)
    if motion.onset.stiff:
        start = total(mechanism, load, u, motion.t)
        mean = simpson(0.0 * u, 1.0 / 6.0, start, middle, middle, end)
        return extrapolated_euler(damped_acceleration, motion, q, dq, mean, h)
    return runge_kutta(acceleration, motion, q, dq, motion.onset.ddq, (middle, end), h)


@function
def mode_margin(motion: SmoothMotion, h: float, q: Array, dq: Array) -> float:
    """Return the distance from the next change of mode."""
    mode = motion.start.mode
    sliding: float = np.where(mode != 0.0, dq * mode, inf).min()
    if every(motion.onset.free):
        return sliding
    u = total(motion.mechanism, motion.load, motion.onset.constant, motion.t + h)
    M, torque = net_torque(motion.mechanism, motion.load, u, q, dq, mode)
    return min(sliding, stick_margin(M, torque, motion.load.breakaway, ~motion.onset.free))


@function
def margin_after(motion: SmoothMotion, h: float) -> float:
    """Return `mode_margin` after `h` [s]."""
    q, dq = advance(motion, h)
    return mode_margin(motion, h, q, dq)


@function
def decide_modes(mechanism: Mechanism, load: PeriodLoad, q: Array, dq: Array, t: float) -> Motion:
    """Return the motion with modes from state and load."""
    u = total(mechanism, load, load.commanded, t)
    u = subtract_friction(mechanism, load, u, dq, np.sign(dq))
    mode, stuck = modes(mechanism.model, q, dq, u, load.breakaway)
    return Motion(q, dq, mode, np.where(stuck, 1.0, 0.0), load.breakaway * mode, True)


@function
def integrate_step(mechanism: Mechanism, load: PeriodLoad, start: Motion, t: float, h: float
                   ) -> Motion:
    """Return the motion after `h` [s], through any change of mode."""
    q = start.q
    dq = start.dq
    for event in range(_MAX_EVENTS + 1):
        onset = begin_smooth(mechanism, load, start, t, h)
        motion = SmoothMotion(mechanism, load, start, t, onset)
        q, dq = advance(motion, h)
        margin = mode_margin(motion, h, q, dq)
        if not margin < 0.0 or event == _MAX_EVENTS:  # Not a number: the motion has diverged.
            break
        s = first_negative(margin_after, motion, h, margin, _EVENT_TOLERANCE * h)
        q, dq = advance(motion, s)
        # The velocity of a joint that comes to rest is exactly 0.
        dq = np.where(dq * start.mode >= 0.0, dq, 0.0)
        t = t + s
        h = h - s
        start = decide_modes(mechanism, load, q, dq, t)
    return start._replace(q=q, dq=dq)

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
Equation (1) over one sample period, with set-valued Coulomb friction, under a held torque.

Between changes of stick and slide the motion is smooth and a Runge-Kutta step of fourth order
follows it. Where a sliding joint comes to rest, or a stuck one is overloaded, the instant is
located within the step, the modes are determined again there, and the rest of the step goes on.

The coordinates are the positions of the joints or, with elastic joints, of links and motors
(`dynamics/elastic_model.py`); drives and friction act on the motors, the disturbance on the links.
"""

from __future__ import annotations

from math import sin
import operator
from typing import Any, NamedTuple

from ctc_chattering.numerics import runge_kutta
from ctc_chattering.numerics.compilable import along, each, function, least, record, uniform
from ctc_chattering.numerics.event_location import first_negative
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.simulation.drive import (
    Driven,
    plus_error,
    plus_mean_error,
    plus_middle_error,
)
from ctc_chattering.simulation.friction import (
    direction,
    Friction,
    holding,
    less_asymmetry,
    less_velocity_friction,
    loaded,
    margin_of_sliding,
    modes,
)

#: Changes of mode that one step may hold; beyond it the step ends in the mode it is in.
_MAX_EVENTS = 50


@record
class Mechanics(NamedTuple):
    """What acts on the robot; vectors over the coordinates, truth values 1.0 and 0.0."""

    #: h [ns] and [s]; steps of the integrator in it, and their length [s].
    period_ns: int
    period: float
    steps: int
    step: float
    #: d(t) = amplitude sin(frequency t) [N·m, rad/s], and whether there is any.
    amplitude: Vector
    frequency: Vector
    disturbed: float
    #: A push [N·m], and the first sample after it.
    push: Vector
    push_end: int
    #: Lag [s] and rate limit [N·m/s] of the drives, and whether none has either.
    lag: Vector
    rate: Vector
    ideal: float
    friction: Friction


@record
class Mechanism(NamedTuple):
    """A model with what acts on it."""

    #: The arm, as `Model` is, and own friction, as `NoFriction` is.
    model: Any
    own: Any
    mechanics: Mechanics


@record
class Motion(NamedTuple):
    """Where the robot is and which joints stick; vectors over the coordinates."""

    #: Position [rad] and velocity [rad/s].
    q: Vector
    dq: Vector
    #: As `modes` returns them, friction of sliding near rest [N·m], and whether this is decided.
    mode: Vector
    fixed_joints: int
    friction: Vector
    decided: float


@record
class Acting(NamedTuple):
    """What acts over one period; vectors over the coordinates."""

    #: Time of its start [s].
    start: float
    #: Command less the constant part of uneven friction, friction at rest, command less torque
    #: of the drives at the start, and mean torque of the drives [N·m].
    commanded: Vector
    breakaway: Vector
    gap: Vector
    mean: Vector
    #: Whether the push is on.
    pushed: float


@record
class Smooth(NamedTuple):
    """A motion in which no mode changes."""

    mechanism: Mechanism
    forces: Acting
    start: Motion
    #: Time of its start [s], and command less the friction of sliding near rest [N·m].
    t: float
    load: Vector
    #: The arm, and whether friction depends on the velocity, as `mechanism` has them.
    model: Any
    rubbing: float


@function
def disturbed(load: float, amplitude: float, frequency: float, t: float) -> float:
    """Return a load with the disturbance d(t) of (1) [N·m]."""
    return load + amplitude * sin(frequency * t)


@function
def stopped(dq: float, mode: float) -> float:
    """Return the velocity of a joint where it may have come to rest."""
    return dq if dq * mode >= 0.0 else 0.0


@function
def acting(mechanics: Mechanics, drives: Driven, k: int) -> Acting:
    """Return what acts over the period after sample `k`, of drives as coordinates have them."""
    p, rubbing = mechanics, mechanics.friction
    command, breakaway, coulomb = drives.commanded, rubbing.breakaway, rubbing.coulomb
    mean = command
    if rubbing.loaded:
        if not p.ideal:
            mean = each(plus_mean_error, command, drives.gap, p.lag, p.rate, uniform(p.period))
        coulomb = each(loaded, coulomb, rubbing.share, mean)
        breakaway = each(operator.add, coulomb, rubbing.stribeck)
    if rubbing.uneven:
        command = each(less_asymmetry, command, rubbing.asymmetry, coulomb)
    return Acting(k * p.period_ns / 1e9, command, breakaway, drives.gap, mean,
                  1.0 if k < p.push_end else 0.0)


@function
def total(mechanics: Mechanics, now: Acting, load: Vector, t: float, half: float) -> Vector:
    """
    Return `load` plus disturbance and error of the drives at `t`, shape (n,) [N·m].

    Parameters
    ----------
    mechanics, now : Mechanics, Acting
        In force.
    load : sequence of float, shape (n,)
        Command, less what is subtracted of it [N·m].
    t : float
        Time [s].
    half : float
        If not 0, `t` is the middle of a step of twice this length [s], and Simpson's rule
        over it must have the impulse of the drives.

    """
    p = mechanics
    if p.disturbed:
        load = each(disturbed, load, p.amplitude, p.frequency, uniform(t))
    if now.pushed:
        load = along(load, 1.0, p.push)
    if not p.ideal:
        s = uniform(t - now.start)
        if half:
            load = each(plus_middle_error, load, now.gap, p.lag, p.rate, s, uniform(half))
        else:
            load = each(plus_error, load, now.gap, p.lag, p.rate, s)
    return load


@function
def in_motion(mechanism: Mechanism, now: Acting, load: Vector, dq: Vector, mode: Vector) -> Vector:
    """Return `load` less what friction at the velocity exceeds its value near rest by."""
    rubbing = mechanism.mechanics.friction
    if rubbing.by_velocity:
        load = each(less_velocity_friction, load, dq, mode, rubbing.viscous, rubbing.stribeck,
                    rubbing.stribeck_velocity)
    if rubbing.own:
        load = along(load, -1.0, mechanism.own.resistance(dq, now.mean, mode))
    return load


@function
def acceleration(at: Smooth, q: Vector, dq: Vector, u: Vector) -> Vector:
    """Return ddq of (1), shape (n,) [rad/s²]; `u` has the friction near rest subtracted."""
    if at.rubbing:
        u = in_motion(at.mechanism, at.forces, u, dq, at.start.mode)
    ddq: Vector = at.model.forward_dynamics(q, dq, u, at.start.fixed_joints)
    return ddq


@function
def after(at: Smooth, h: float) -> tuple[Vector, Vector]:
    """Return q and dq after `h` [s] in the present modes, to fourth order."""
    p, load = at.mechanism.mechanics, at.load
    loads = load, load, load
    if p.disturbed or not p.ideal or at.forces.pushed:
        loads = (total(p, at.forces, load, at.t, 0.0),
                 total(p, at.forces, load, at.t + 0.5 * h, 0.5 * h),
                 total(p, at.forces, load, at.t + h, 0.0))
    return runge_kutta.step(acceleration, at, at.start.q, at.start.dq, loads, h)


@function
def margin(at: Smooth, h: float, q: Vector, dq: Vector) -> float:
    """Return how far the joint nearest to it is from leaving its mode; negative if it has."""
    mode, fixed = at.start.mode, at.start.fixed_joints
    sliding = least(each(margin_of_sliding, dq, mode))
    if not fixed:
        return sliding
    u = total(at.mechanism.mechanics, at.forces, at.load, at.t + h, 0.0)
    u = in_motion(at.mechanism, at.forces, u, dq, mode)
    return min(sliding, holding(at.mechanism.model, q, dq, u, at.forces.breakaway, mode, fixed))


@function
def margin_after(at: Smooth, h: float) -> float:
    """Return the margin after `h` [s]."""
    q, dq = after(at, h)
    return margin(at, h, q, dq)


@function
def decided(mechanism: Mechanism, now: Acting, q: Vector, dq: Vector, t: float) -> Motion:
    """Return the motion with modes that are decided from the state and the load at `t` [s]."""
    u = total(mechanism.mechanics, now, now.commanded, t, 0.0)
    u = in_motion(mechanism, now, u, dq, each(direction, dq))
    mode, fixed = modes(mechanism.model, q, dq, u, now.breakaway)
    return Motion(q, dq, mode, fixed, each(operator.mul, now.breakaway, mode), 1.0)


@function
def integrated(mechanism: Mechanism, now: Acting, start: Motion, t: float, h: float) -> Motion:
    """Return the motion after `h` [s] from `t` [s], through any change of mode."""
    q, dq, friction = start.q, start.dq, mechanism.mechanics.friction
    rubbing = friction.by_velocity + friction.own
    for event in range(_MAX_EVENTS + 1):
        at = Smooth(mechanism, now, start, t, along(now.commanded, -1.0, start.friction),
                    mechanism.model, rubbing)
        q, dq = after(at, h)
        held = margin(at, h, q, dq)
        if held >= 0.0 or event == _MAX_EVENTS:
            break
        s = first_negative(margin_after, at, h, held, 1e-12 * h)
        q, dq = after(at, s)
        start = decided(mechanism, now, q, each(stopped, dq, start.mode), t + s)
        t, h = t + s, h - s
    return Motion(q, dq, start.mode, start.fixed_joints, start.friction, 1.0)


@function
def advanced(mechanism: Mechanism, now: Acting, motion: Motion) -> Motion:
    """Return the motion a sample period later."""
    p, t = mechanism.mechanics, now.start
    if not motion.decided or motion.fixed_joints or p.friction.loaded or 0.0 in motion.dq:
        motion = decided(mechanism, now, motion.q, motion.dq, t)
    for i in range(p.steps):
        motion = integrated(mechanism, now, motion, t + i * p.step, p.step)
    return motion

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
follows it. Where a step h is longer than the time constants of damping, as of brakes on a light
link, that is where M - h D is not positive definite, a method that is implicit in D replaces it.
Where a sliding joint comes to rest, or a stuck one is overloaded, the instant is
located within the step, the modes are determined again there, and the rest of the step goes on.

The coordinates are the positions of the joints or, with elastic joints, of links and motors
(`dynamics/elastic_model.py`); drives and friction act on the motors, the disturbance on the links.
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
from ctc_chattering.simulation.friction import Friction, margin_of_rest, modes
import numpy as np

#: Changes of mode that one step may hold; beyond it the step ends in the mode it is in.
_MAX_EVENTS = 50
#: Rotation in a step from which on it is divided [rad], and into how many parts at the most: with
#: half a turn in a step, Coriolis forces would add energy.
_MOST_TURN, _MOST_PARTS = 0.5, 1000
#: Change of velocity over which the slope of an own friction is taken, relative to 1 + |dq|.
_VELOCITY_STEP = 1e-6


@record
class Mechanics(NamedTuple):
    """What acts on the robot; vectors over the coordinates, truth values 1.0 and 0.0."""

    #: h [ns] and [s]; steps of the integrator in it.
    period_ns: int
    period: float
    steps: int
    #: d(t) = amplitude sin(frequency t) [N·m, rad/s].
    amplitude: Array
    frequency: Array
    #: A push [N·m], and the first sample after it.
    push: Array
    push_end: int
    #: Lag [s] and rate limit [N·m/s] of the drives, and whether none has either.
    lag: Array
    rate: Array
    ideal: float
    friction: Friction


@record
class Rigid(NamedTuple):
    """Joints that are the coordinates."""

    rigid: float = 1.0

    def on_motors(self, x: Array) -> Array:
        """Return values of the joints, shape (n,), as those of the coordinates of their motors."""
        return x

    def seen(self, x: Array) -> Array:
        """Return what the encoders see of values of the coordinates, shape (n,)."""
        return x


@record
class Mechanism(NamedTuple):
    """A model with what acts on it."""

    #: The arm, as `Model` is, and own friction, as `NoFriction` is.
    model: Any
    own: Any
    mechanics: Mechanics
    #: Between joints and coordinates, as `Rigid` is.
    joints: Any

    def integrate(self, now: Acting, motion: Motion) -> Motion:
        """Return the motion a sample period later."""
        p, t = self.mechanics, now.start
        if not motion.decided or some(motion.stuck) or some(p.friction.share) or some(
                motion.dq == 0.0):
            motion = decided(self, now, motion.q, motion.dq, t)
        h = p.period / p.steps
        for i in range(p.steps):
            fastest = np.abs(motion.dq).max()
            parts = 1 + int(min(h * fastest / _MOST_TURN, _MOST_PARTS))
            for j in range(parts):
                s = h / parts
                motion = integrated(self, now, motion, t + i * h + j * s, s)
        return motion


@record
class Motion(NamedTuple):
    """Where the robot is and which joints stick; vectors over the coordinates."""

    #: Position [rad] and velocity [rad/s].
    q: Array
    dq: Array
    #: As `modes` returns them, 1.0 for a joint that sticks; friction of sliding near rest [N·m];
    #: whether this is decided.
    mode: Array
    stuck: Array
    friction: Array
    decided: float


@record
class Acting(NamedTuple):
    """What acts over one period; vectors over the coordinates."""

    #: Time of its start [s].
    start: float
    #: Command less the constant part of uneven friction, friction at rest, command less torque
    #: of the drives at the start, and mean torque of the drives [N·m].
    commanded: Array
    breakaway: Array
    gap: Array
    mean: Array
    #: Whether the push is on.
    pushed: float


@record
class Onset(NamedTuple):
    """What a motion in which no mode changes begins with; vectors over the coordinates."""

    #: Command less the friction of sliding near rest [N·m].
    load: Array
    #: Which joints do not stick.
    free: Truths
    #: Acceleration [rad/s²].
    ddq: Array
    #: Whether a step is longer than a time constant of the damping.
    stiff: bool


@record
class Smooth(NamedTuple):
    """A motion in which no mode changes."""

    mechanism: Mechanism
    forces: Acting
    start: Motion
    #: Time of its start [s].
    t: float
    onset: Onset


@function
def acting(mechanics: Mechanics, commanded: Array, gap: Array, k: int) -> Acting:
    """
    Return what acts over the period after sample `k`.

    Parameters
    ----------
    mechanics : Mechanics
        In force.
    commanded, gap : array
        Of `Driven`, over the coordinates.
    k : int
        Sample.

    """
    p, rubbing = mechanics, mechanics.friction
    coulomb, mean = rubbing.coulomb, commanded
    if some(rubbing.share):
        if not p.ideal:
            mean = commanded + response(gap, p.lag, p.rate, p.period)[1] / p.period
        coulomb = coulomb + rubbing.share * np.abs(mean)
    return Acting(k * p.period_ns / 1e9, commanded - rubbing.asymmetry * coulomb,
                  coulomb + rubbing.stribeck, gap, mean, 1.0 if k < p.push_end else 0.0)


@function
def total(mechanics: Mechanics, now: Acting, load: Array, t: float, half: float) -> Array:
    """
    Return `load` plus disturbance and error of the drives at `t`, shape (n,) [N·m].

    Parameters
    ----------
    mechanics, now : Mechanics, Acting
        In force.
    load : array, shape (n,)
        Command, less what is subtracted of it [N·m].
    t : float
        Time [s].
    half : float
        If not 0, `t` is the middle of a step of twice this length [s], and Simpson's rule
        over it must have the impulse of the drives.

    """
    p = mechanics
    if some(p.amplitude):
        load = load + p.amplitude * np.sin(p.frequency * t)
    if now.pushed:
        load = load + p.push
    if not p.ideal:
        s = t - now.start
        if half:
            load = load + middle_error(now.gap, p.lag, p.rate, s, half)
        else:
            load = load + response(now.gap, p.lag, p.rate, s)[0]
    return load


@function
def in_motion(mechanism: Mechanism, now: Acting, load: Array, dq: Array, mode: Array) -> Array:
    """Return `load` less what friction at the velocity exceeds its value near rest by."""
    rubbing = mechanism.mechanics.friction
    load = load - rubbing.viscous * dq
    if some(rubbing.stribeck):
        r = dq / rubbing.stribeck_velocity
        load = load + rubbing.stribeck * mode * (1.0 - np.exp(-r * r))
    if rubbing.own:
        load = load - mechanism.own.resistance(dq, now.mean, mode)
    return load


@function
def damping(mechanism: Mechanism, now: Acting, dq: Array, mode: Array) -> Array:
    """Return the slope of friction over velocity, where it damps, shape (n,) [N·m·s/rad]."""
    slope = mechanism.mechanics.friction.viscous
    if mechanism.mechanics.friction.own:
        step = _VELOCITY_STEP * (1.0 + np.abs(dq))
        change = mechanism.own.resistance(dq + step, now.mean, mode) - mechanism.own.resistance(
            dq, now.mean, mode)
        slope = slope + np.maximum(change / step, 0.0)
    return slope


@function
def onset(mechanism: Mechanism, now: Acting, start: Motion, t: float, h: float) -> Onset:
    """Return what a motion of `h` [s] begins with at `t` [s]."""
    load, free = now.commanded - start.friction, start.stuck == 0.0
    u = in_motion(mechanism, now, total(mechanism.mechanics, now, load, t, 0.0), start.dq,
                  start.mode)
    slope = damping(mechanism, now, start.dq, start.mode)
    M, bias = mechanism.model.mass_and_bias(start.q, start.dq)
    ddq = solve_where(free, M, u - bias)
    stiff = some(slope) and not outweighs(free, M, h * slope)
    return Onset(load, free, ddq, stiff)


@function
def damped_acceleration(at: Smooth, q: Array, dq: Array, u: Array, s: float) -> Array:
    """Return the mean ddq of an Euler step `s`, implicit in the damping, shape (n,) [rad/s²]."""
    slope = damping(at.mechanism, at.forces, dq, at.start.mode)
    u = in_motion(at.mechanism, at.forces, u, dq, at.start.mode)
    M, bias = at.mechanism.model.mass_and_bias(q, dq)
    return solve_damped(at.onset.free, M, s * slope, u - bias)


@function
def acceleration(at: Smooth, q: Array, dq: Array, u: Array) -> Array:
    """Return ddq of (1), shape (n,) [rad/s²]; `u` has the friction near rest subtracted."""
    u = in_motion(at.mechanism, at.forces, u, dq, at.start.mode)
    M, bias = at.mechanism.model.mass_and_bias(q, dq)
    return solve_where(at.onset.free, M, u - bias)


@function
def after(at: Smooth, h: float) -> tuple[Array, Array]:
    """Return q and dq after `h` [s] in the present modes, to fourth order."""
    p, load, q, dq = at.mechanism.mechanics, at.onset.load, at.start.q, at.start.dq
    middle = total(p, at.forces, load, at.t + 0.5 * h, 0.5 * h)
    end = total(p, at.forces, load, at.t + h, 0.0)
    if at.onset.stiff:
        start = total(p, at.forces, load, at.t, 0.0)
        mean = simpson(0.0 * load, 1.0 / 6.0, start, middle, middle, end)
        return extrapolated_euler(damped_acceleration, at, q, dq, mean, h)
    return runge_kutta(acceleration, at, q, dq, at.onset.ddq, (middle, end), h)


@function
def margin(at: Smooth, h: float, q: Array, dq: Array) -> float:
    """Return how far the joint nearest to it is from leaving its mode; negative if it has."""
    mode = at.start.mode
    sliding: float = np.where(mode != 0.0, dq * mode, inf).min()
    if every(at.onset.free):
        return sliding
    u = total(at.mechanism.mechanics, at.forces, at.onset.load, at.t + h, 0.0)
    u = in_motion(at.mechanism, at.forces, u, dq, mode)
    M, bias = at.mechanism.model.mass_and_bias(q, dq)
    return min(sliding, margin_of_rest(M, bias, u, at.forces.breakaway, ~at.onset.free))


@function
def margin_after(at: Smooth, h: float) -> float:
    """Return the margin after `h` [s]."""
    q, dq = after(at, h)
    return margin(at, h, q, dq)


@function
def decided(mechanism: Mechanism, now: Acting, q: Array, dq: Array, t: float) -> Motion:
    """Return the motion with modes that are decided from the state and the load at `t` [s]."""
    u = total(mechanism.mechanics, now, now.commanded, t, 0.0)
    u = in_motion(mechanism, now, u, dq, np.sign(dq))
    mode, stuck = modes(mechanism.model, q, dq, u, now.breakaway)
    return Motion(q, dq, mode, np.where(stuck, 1.0, 0.0), now.breakaway * mode, 1.0)


@function
def integrated(mechanism: Mechanism, now: Acting, start: Motion, t: float, h: float) -> Motion:
    """Return the motion after `h` [s] from `t` [s], through any change of mode."""
    q, dq = start.q, start.dq
    for event in range(_MAX_EVENTS + 1):
        at = Smooth(mechanism, now, start, t, onset(mechanism, now, start, t, h))
        q, dq = after(at, h)
        held = margin(at, h, q, dq)
        if not held < 0.0 or event == _MAX_EVENTS:  # Not a number: the motion has diverged.
            break
        s = first_negative(margin_after, at, h, held, 1e-12 * h)
        q, dq = after(at, s)
        # A joint that may have come to rest has.
        start = decided(mechanism, now, q, np.where(dq * start.mode >= 0.0, dq, 0.0), t + s)
        t, h = t + s, h - s
    return start._replace(q=q, dq=dq)

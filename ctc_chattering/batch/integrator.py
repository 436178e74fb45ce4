"""
Equation (1) over one step of the integrator, through every change of stick and slide.

The method is that of `simulation/plant.py`: Runge-Kutta of fourth order between events
(`numerics/runge_kutta.py`), each of which is located (`numerics/event_location.py`).
"""

from __future__ import annotations

from math import exp, inf, sin
from typing import NamedTuple

from ctc_chattering.batch.arm import Arm, BodyScratch
from ctc_chattering.batch.compiler import compiled, inlined
from ctc_chattering.batch.drives import middle, response
from ctc_chattering.batch.dynamics import forward_dynamics, mass_and_bias
from ctc_chattering.batch.friction import decide, excess, FrictionScratch
from ctc_chattering.batch.plant_state import PlantScratch, PlantSettings, PlantState
from ctc_chattering.numerics.linear_algebra import Array

#: Changes of mode that one step may hold; beyond it the step ends in the mode it is in.
_MAX_EVENTS = 50
#: Steps of the location of an event, one in eight a bisection; its width as a part of the step.
_MAX_STEPS, _TOLERANCE = 330, 1e-12


class Plant(NamedTuple):
    """A plant with its scratch, each a record."""

    arm: Arm
    c: PlantSettings
    s: PlantState
    w: PlantScratch
    body: BodyScratch
    friction: FrictionScratch


@inlined
def torque(p: Plant, t: float, load: Array, half: float, out: Array) -> None:
    """Set `load` plus disturbance and error of the drives at `t` [s]; `half` as of `middle`."""
    c, s = p.c, p.s
    pushing = s.k < c.push_end
    after = t - float(s.k * c.period_ns) / 1e9
    for i in range(len(load)):
        out[i] = load[i]
        if c.disturbed:
            out[i] += c.amplitude[i] * sin(c.frequency[i] * t)
        if pushing:
            out[i] += c.push[i]
        if not c.ideal:
            if half:
                out[i] += middle(s.gap[i], c.lag[i], c.rate[i], after, half)
            else:
                out[i] += response(s.gap[i], c.lag[i], c.rate[i], after)[0]


@inlined
def minus_velocity_friction(p: Plant, dq: Array, u: Array, out: Array) -> None:
    """Set `u` less what friction at the velocity `dq` exceeds its value near rest by."""
    c, s = p.c, p.s
    for i in range(len(u)):
        out[i] = u[i] - c.viscous[i] * dq[i]
        if c.stribeck[i]:
            r = dq[i] / c.stribeck_velocity[i]
            out[i] += c.stribeck[i] * s.mode[i] * (1.0 - exp(-r * r))


@inlined
def acceleration(p: Plant, q: Array, dq: Array, u: Array, out: Array) -> None:
    """Set ddq in the present modes, under a torque `u` without the friction of the velocity."""
    load = u
    if p.c.varies_with_velocity:
        minus_velocity_friction(p, dq, u, p.w.u)
        load = p.w.u
    forward_dynamics(p.arm, q, dq, load, p.s.fixed, p.body, out)


@compiled
def runge_kutta(p: Plant, t: float, h: float) -> None:
    """Set the state after a step of `h` [s] from `t` [s] in the scratch, in the present modes."""
    s, w = p.s, p.w
    n, half, sixth = len(s.q), 0.5 * h, h / 6.0
    start, mid, end = w.load, w.load, w.load
    if p.c.disturbed or not p.c.ideal or s.k < p.c.push_end:
        torque(p, t, w.load, 0.0, w.start)
        torque(p, t + half, w.load, half, w.middle)
        torque(p, t + h, w.load, 0.0, w.end)
        start, mid, end = w.start, w.middle, w.end
    acceleration(p, s.q, s.dq, start, w.a1)
    for i in range(n):
        w.x[i], w.v2[i] = s.q[i] + half * s.dq[i], s.dq[i] + half * w.a1[i]
    acceleration(p, w.x, w.v2, mid, w.a2)
    for i in range(n):
        w.x[i], w.v3[i] = s.q[i] + half * w.v2[i], s.dq[i] + half * w.a2[i]
    acceleration(p, w.x, w.v3, mid, w.a3)
    for i in range(n):
        w.x[i], w.v4[i] = s.q[i] + h * w.v3[i], s.dq[i] + h * w.a3[i]
    acceleration(p, w.x, w.v4, end, w.a4)
    for i in range(n):
        w.q[i] = s.q[i] + sixth * (s.dq[i] + 2.0 * (w.v2[i] + w.v3[i]) + w.v4[i])
        w.dq[i] = s.dq[i] + sixth * (w.a1[i] + 2.0 * (w.a2[i] + w.a3[i]) + w.a4[i])


@inlined
def margin(p: Plant, t: float) -> float:
    """Return how far the joint nearest to it is from leaving its mode; negative if it has."""
    s, w = p.s, p.w
    least = inf
    for i in range(len(s.mode)):
        if s.mode[i]:
            least = min(least, w.dq[i] * s.mode[i])
    if s.sticking:
        torque(p, t, w.load, 0.0, w.start)
        if p.c.varies_with_velocity:
            minus_velocity_friction(p, w.dq, w.start, w.start)
        mass_and_bias(p.arm, w.q, w.dq, p.body)
        least = min(least, -excess(w.start, s.breakaway, s.fixed, w.u, p.body))
    return least


@compiled
def margin_after(p: Plant, t: float, h: float) -> float:
    """Return the margin after a step of `h` [s] from `t` [s]."""
    runge_kutta(p, t, h)
    return margin(p, t + h)


@compiled
def locate(p: Plant, t: float, h: float, f_high: float) -> float:
    """Return the instant after `t` at which a joint first leaves its mode, which at `h` it has."""
    tol, high = _TOLERANCE * h, h
    low, f_low = 0.5 * h, margin_after(p, t, 0.5 * h)
    while f_low < 0.0:
        high, f_high = low, f_low
        low *= 0.5
        if low < tol:
            return high
        f_low = margin_after(p, t, low)
    kept = 0
    for step in range(_MAX_STEPS):
        if high - low <= tol:
            break
        s = low + (high - low) * (0.5 if step % 8 == 7 else f_low / (f_low - f_high))
        if not low < s < high:
            s = 0.5 * (low + high)
        value = margin_after(p, t, s)
        if value < 0.0:
            high, f_high = s, value
            if kept < 0:
                f_low *= 0.5
            kept = -1
        else:
            low, f_low = s, value
            if kept > 0:
                f_high *= 0.5
            kept = 1
    return high


@compiled
def set_modes(p: Plant, t: float) -> None:
    """Decide the modes at `t` [s], and set the load without their friction."""
    s, w = p.s, p.w
    torque(p, t, s.command, 0.0, w.start)
    n = len(s.q)
    if p.c.varies_with_velocity:
        for i in range(n):
            s.mode[i] = int(s.dq[i] > 0.0) - int(s.dq[i] < 0.0)
        minus_velocity_friction(p, s.dq, w.start, w.start)
    mass_and_bias(p.arm, s.q, s.dq, p.body)
    decide(s.dq, w.start, s.breakaway, p.body, p.friction, s.mode, s.fixed)
    s.sticking = 0
    for i in range(n):
        s.sticking |= s.fixed[i]
        s.friction[i] = s.breakaway[i] * s.mode[i]
    s.decided = 1


@compiled
def integrate(p: Plant, t: float, h: float) -> None:
    """Go on by `h` [s] from `t` [s] under the command, through any change of mode."""
    s, w = p.s, p.w
    n = len(s.q)
    for event in range(_MAX_EVENTS + 1):
        for i in range(n):
            w.load[i] = s.command[i] - s.friction[i]
        held = margin_after(p, t, h)
        if held >= 0.0 or event == _MAX_EVENTS:
            break
        step = locate(p, t, h, held)
        runge_kutta(p, t, step)
        for i in range(n):
            s.q[i] = w.q[i]
            s.dq[i] = w.dq[i] if w.dq[i] * s.mode[i] >= 0.0 else 0.0
        t, h = t + step, h - step
        set_modes(p, t)
    for i in range(n):
        s.q[i], s.dq[i] = w.q[i], w.dq[i]

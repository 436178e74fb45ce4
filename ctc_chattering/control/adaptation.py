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
What `observer_feedback` has besides its observer: it adapts to drives, friction and rest.

Feasible reference
------------------
A reference that drives with a limited rate can follow, where friction changes its sign.

At a reversal the torque of a joint has to change by 2 K̂, for which a drive with the rate limit R
takes 2 T, T = K̂ / R. The feedforward of friction F is a ramp that begins before the reversal::

    F = K̂ φ((dq_d + 0.67 T ddq_d) / (|ddq_d| T))                                          (FR1)
    φ(s) = s for |s| <= 1 + β, from there back to sgn s at |s| = 1 + 2 β                   (FR2)

dq_d / |ddq_d| is the time to the reversal, so no point of the reference ahead is needed. With the
overshoot β = 0.35 the first moment of φ - sgn is 0::

    (1 + β)³ / 3 - (1 + β)² / 2 + β² / 2 + 2 β³ / 3 = 0

so that the ramp leaves no position error behind. During the ramp the joint cannot be on the
reference q_d. A feedback that insists on it makes the joint stick until the torque has changed by
2 K̂. So the feedback gets q_d + x; x is what the ramp does to the joint, and returns to 0::

    ddx = (F - f) / M_ii - 2 w dx - w² x,     f ∈ K̂ Sgn(dq_d + dx)⁺, implicit              (FR3)
    w = min(0.6 √Kp_ii, ½ / h, 0.55 / T, (J / |x|)^⅓, (J / |dx|)^½),     J = ½ R / M_ii    (FR4)

Where the reference stands, F - f is left out, or x would stick, and nothing would bring it back.
J is half of the jerk that the drive can give the joint. x begins at the distance of the robot from
q_d: the start is smooth from anywhere. Where the drives give less than what is asked for by more
than 10 ms R, the rest is taken from dx, which keeps the loop from winding up::

    dx -= M⁻¹ (rest) / (Kv_ii + T_a Kp_ii)                                                 (FR5)

T_a is the lag of the drive. What (OF4) asks for changes with dx by about the divisor, in the
metric of M; with less of it (FR5) would overshoot.

Level of friction
-----------------
The level of Coulomb's friction, learned from what an observer still has to add.

Where the level K̂ is too low by ΔK, the estimate P̂ jumps by 2 ΔK, delayed by the observer, when
the velocity changes its sign. K̂ follows the correlation of P̂ with the sign of the velocity,
delayed alike (three lags of the observer's bandwidth ω), both above the frequency w₀::

    dK̂/dt = γ y φ,     y = HP(P̂),     φ = HP(LP³(sgn dq̂)),     0 <= K̂ <= Ka             (FL1)

The high-pass keeps slow errors of the model out, and a friction that grows with the velocity. A
joint at rest, or one that does not turn back, teaches nothing.

Rest
----
Rest: at a joint that stands where the reference stands, the perturbation is kept.

A joint that sticks shows nothing of the perturbation, so that an estimate, and its slope even
more, drifts until the joint breaks loose, slips and sticks again: without end where friction at
rest exceeds that of sliding. So P̂ is kept, with the slope 0, once::

    s t >= W²,     s >= 2 / ω,     W = 6 / ω + Ka / R                                      (SS1)
    K̂ s² >= 4 δ M_ii                                                                       (SS2)

s is the time for which the measured position has been within δ = 1e-4 rad (or m), t that for
which dq_d and ddq_d are 0; W is what observer and drives need to free a joint. A constant torque
beyond 4 δ M_ii / s² moves a joint by 2 δ within s: by (SS2) the learned friction K̂ can hold the
one that acts, and a joint without friction is never held. P̂ is estimated again when the measured
position leaves ±δ or the reference moves; t then begins again. Position and velocity are observed
all the time, so that nothing jumps, and a joint that does move under a kept P̂ is under the
feedback of a stable loop.

A joint that sticks under a constant torque goes on sticking until its load has changed by what
static friction has in reserve. Where every stop takes s₁ >= 2 / ω, slips end by t = W² / s₁, at
most W² ω / 2. What is left is the error at that stop.

Bandwidth
---------
How much of its bandwidth a loop may use: less while its feedback oscillates.

Drives that are slower than their model (rate limit, lag, delay) make a fast loop oscillate: what
the drives lack goes into the estimate, which asks for more. The same loop with a part of its
bandwidth is stable. The torque f of the feedback shows it in two ways. Drives of a lower rate
than the law believes make f large, beyond Ka and what the drives follow, while the law believes
that they give it. Drives that are late make f oscillate on, while of a load, a reversal of
friction or a motion that is too hard each half-wave is smaller than the one before::

    r = max(|f_b - f_s| / (Ka + B + |f_s|),  min(|f|, f₁, f₂) / min(Ka, B)),    B = R / √Kp
    d(ln s)/dt = -w max(r - 1/2, 0) - ln(s) / t                                            (OG1)

with w = 80 rad/s, t = 2 seconds, 0.1 <= s <= 1. Drives with the rate limit R follow B at the pole
of the feedback; where R is not known, B counts for nothing. f_b is f less what the law knows that
the drives do not give; f_s is its slow part, below 30 s rad/s, which is there where Ka is too
small or the motion smooth; f₁ and f₂ are the sizes of the last half-wave and the one before, which
fade with 10 rad/s. The largest ratio of all joints counts, and s is one number, since joints are
coupled. Where less bandwidth does not help, f exceeds 3 Ka with s < 0.2; a start far from the
reference does so, too, and has 2 seconds.

Elastic joints, or an inertia that is far from the model's, keep the loop oscillating at any s: f
stays within 3 Ka, and s low. L is how long such a limit cycle lasts::

    dL/dt = 1 where s < 0.7 and m has exceeded 1/4 within 0.2 s, else 0 where s < 0.3, else -1
    m = min(|f|, f₁, f₂) / min(Ka, B), the largest of all joints                           (OG2)

with L >= 0. An oscillation that comes back as soon as s recovers counts as one. Drives that are
slower or later than configured oscillate for half a second, until s is low enough. The joint of
the largest half-waves and the frequency of its f say what oscillates.
"""

from __future__ import annotations

from math import exp, log
from typing import NamedTuple

from ctc_chattering.compiled.compilable import every, function, record, solve, some, Truths
from ctc_chattering.control.observer import Observed
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: β of (FR2); the lead of (FR1), in T; of (FR4), the factors of √Kp, 1 / T, R / M_ii and 1 / h.
OVERSHOOT, _LEAD = 0.35, 0.67
_RETURN, _RAMP_RETURN, _PART, _STEP = 0.6, 0.55, 0.5, 0.5
#: How far the drives may be behind before (FR5) acts [s].
_BEHIND = 10e-3
#: Up to this velocity [rad/s] and acceleration [rad/s²] the reference stands.
_STANDS = 1e-9
#: The shortest ramp [s], and what keeps a quotient finite.
_LEAST, _TINY = 1e-6, 1e-12


@record
class Desired(NamedTuple):
    """A point of the reference; arrays of shape (n,) [rad, rad/s, rad/s²]."""

    q: Array
    dq: Array
    ddq: Array


@record
class Deviation(NamedTuple):
    """x and dx of the module; arrays of shape (n,) [rad, rad/s]."""

    x: Array
    dx: Array


@record
class FeasibleReference(NamedTuple):
    """Adds to a reference the deviation that the drives need; made by `feasible_reference`."""

    #: h [s].
    period: float
    #: R, inf for none [N·m/s]; fastest return [1/s]; Kv_ii + T_a Kp_ii [1/s]. Shape (n,).
    rate: Array
    fastest: Array
    relief: Array

    def slowed(self, part: float) -> FeasibleReference:
        """Return what a deviation returns with a part of the fastest w by."""
        return self._replace(fastest=part * self.fastest)

    def feedforward(self, at: Desired, level: Array, ahead: float = 0.0) -> Array:
        """Return F of (FR1), shape (n,) [N·m], at `ahead` [s] after the point `at`."""
        T = np.maximum(level / self.rate, _LEAST)
        dq = at.dq + (_LEAD * T + ahead) * at.ddq
        return level * ramp(dq / np.maximum(np.abs(at.ddq) * T, _TINY))

    def shifted(self, at: Desired, by: Deviation, back: Array) -> Desired:
        """Return `at` with the deviation and `returning`; without the ramp's acceleration."""
        return Desired(at.q + by.x, at.dq + by.dx, at.ddq + back)

    def following(self, at: Desired, by: Deviation, back: Array, inertia: Array, level: Array
                  ) -> Deviation:
        """
        Return the deviation a period after the point `at`, by (FR3).

        Parameters
        ----------
        at, by : Desired, Deviation
            The point, and its deviation.
        back : array, shape (n,)
            `returning` [rad/s²].
        inertia : array, shape (n,)
            M_ii [kg·m²].
        level : array, shape (n,)
            K̂ [N·m].

        """
        h = self.period
        F = self.feedforward(at, level, 0.5 * h)
        holding = inertia * ((at.dq + by.dx) / h + at.ddq + back) + F
        f = np.minimum(np.maximum(holding, -level), level)
        ddx = np.where(stands(at), 0.0, (F - f) / inertia) + back
        return Deviation(by.x + h * (by.dx + 0.5 * h * ddx), by.dx + h * ddx)

    def relieved(self, by: Deviation, missing: Array, mass: Array) -> Deviation:
        """Return the deviation after (FR5), for a torque that falls short by `missing` [N·m]."""
        slack = _BEHIND * self.rate
        rest = missing - np.minimum(np.maximum(missing, -slack), slack)
        if not some(rest):
            return by
        return by._replace(dx=by.dx - solve(mass, rest) / self.relief)

    def returning(self, by: Deviation, inertia: Array, level: Array) -> Array:
        """Return -2 w dx - w² x of (FR3), shape (n,) [rad/s²]."""
        jerk = _PART * self.rate / inertia
        w = np.minimum(
            np.minimum(self.fastest, _RAMP_RETURN * self.rate / np.maximum(level, _TINY)),
            np.minimum(np.cbrt(jerk / np.maximum(np.abs(by.x), _TINY)),
                       np.sqrt(jerk / np.maximum(np.abs(by.dx), _TINY))))
        return -w * (2.0 * by.dx + w * by.x)


@function
def feasible_reference(kp: Array, kv: Array, rate: Array, lag: Array, period: float
                       ) -> FeasibleReference:
    """
    Return what shifts a reference.

    Parameters
    ----------
    kp, kv : array, shape (n,)
        Diagonals of Kp [1/s²] and Kv [1/s].
    rate : array, shape (n,)
        R [N·m/s]; inf for none.
    lag : array, shape (n,)
        T_a [s].
    period : float
        h [s].

    """
    fastest = np.minimum(_RETURN * np.sqrt(kp), _STEP / period)
    return FeasibleReference(period, rate, fastest, kv + lag * kp)


@function
def next_point(at: Desired, step: Array, h: float) -> Desired:
    """Return the point a period h [s] after `at`, ddq_d changing by `step` [rad/s²] until then."""
    return Desired(at.q + h * (at.dq + h * (0.5 * at.ddq + step / 6.0)),
                   at.dq + h * (at.ddq + 0.5 * step), at.ddq + step)


@function
def stands(at: Desired) -> Truths:
    """Return of which joints the reference stands, shape (n,)."""
    return (np.abs(at.dq) <= _STANDS) & (np.abs(at.ddq) <= _STANDS)


@function
def ramp(s: Array) -> Array:
    """Return φ of (FR2)."""
    size, top = np.abs(s), 1.0 + OVERSHOOT
    if every(size >= 1.0 + 2.0 * OVERSHOOT):
        return np.sign(s)
    phi: Array = np.sign(s) * np.where(size <= top, size, np.maximum(2.0 * top - size, 1.0))
    return phi


#: w₀ [rad/s].
_SLOW = 60.0
#: Velocity that counts as motion [rad/s].
_MOVING = 2e-3


@record
class Learned(NamedTuple):
    """What has been learned of the friction of every joint; arrays of shape (n,)."""

    #: K̂ [N·m].
    level: Array
    #: Of the sign of the velocity: outputs of the three lags, and the slow part of the last.
    lag1: Array
    lag2: Array
    lag3: Array
    slow_sign: Array
    #: Slow part of the estimate [N·m].
    slow_estimate: Array


@record
class FrictionLevel(NamedTuple):
    """Learns the level of friction of every joint; made by `friction_level`."""

    #: γ h, 1 - exp(-ω h) and 1 - exp(-w₀ h).
    gain: float
    follow: float
    forget: float
    #: Ka [N·m], shape (n,).
    bound: Array

    def slowed(self, part: float) -> FrictionLevel:
        """Return what learns from an estimate that follows with a part of ω."""
        return self._replace(follow=part * self.follow)

    def learn(self, last: Learned, dq: Array, perturbation: Array) -> Learned:
        """Return K̂ improved by dq̂ [rad/s] and P̂ [N·m], shape (n,), of one sample."""
        if self.gain == 0.0:
            return last
        sign = np.where(np.abs(dq) > _MOVING, np.sign(dq), 0.0)
        lag1 = last.lag1 + self.follow * (sign - last.lag1)
        lag2 = last.lag2 + self.follow * (lag1 - last.lag2)
        lag3 = last.lag3 + self.follow * (lag2 - last.lag3)
        slow_sign = last.slow_sign + self.forget * (lag3 - last.slow_sign)
        slow = last.slow_estimate + self.forget * (perturbation - last.slow_estimate)
        level = last.level + self.gain * (lag3 - slow_sign) * (perturbation - slow)
        return Learned(np.minimum(np.maximum(level, 0.0), self.bound), lag1, lag2, lag3,
                       slow_sign, slow)


def friction_level(gain: float, bandwidth: float, period: float, bound: Array) -> FrictionLevel:
    """Return what learns with γ [1/s], ω [rad/s], h [s] and Ka, shape (n,) [N·m]."""
    return FrictionLevel(gain * period, 1.0 - exp(-bandwidth * period),
                         1.0 - exp(-_SLOW * period), bound)


#: δ [rad]; with more noise of the position no joint is held.
TOLERANCE = 1e-4
#: W, and the shortest stop, in 1 / ω.
_PATIENCE, _SHORTEST = 6.0, 2.0


@record
class Rest(NamedTuple):
    """How each joint rests; arrays of shape (n,)."""

    #: The measured position at which the joint came to stand [rad].
    place: Array
    #: s and t of (SS1) [s].
    joint: Array
    reference: Array
    #: Whether it is held, 1.0 or 0.0.
    held: Array


@record
class Standstill(NamedTuple):
    """Decides which joints are held; made by `standstill`."""

    #: h [s], ω [rad/s], and W [s], shape (n,).
    period: float
    bandwidth: float
    patience: Array

    def placed_at(self, rest: Rest, q: Array) -> Rest:
        """Return the rest after a measured position, shape (n,) [rad]."""
        moved = np.abs(q - rest.place) > TOLERANCE
        return Rest(np.where(moved, q, rest.place),
                    np.where(moved, 0.0, rest.joint + self.period),
                    np.where(moved & (rest.held != 0.0), 0.0, rest.reference),
                    np.where(moved, 0.0, rest.held))

    def judged(self, rest: Rest, at: Desired, inertia: Array, level: Array) -> Rest:
        """
        Return the rest with the joints that (SS1) and (SS2) hold; arrays of shape (n,).

        Parameters
        ----------
        rest : Rest
            After `placed_at`.
        at : Desired
            Point of the reference at the arrival of the torque.
        inertia : array, shape (n,)
            M_ii [kg·m²].
        level : array, shape (n,)
            K̂ [N·m].

        """
        still, s = stands(at), rest.joint
        t = np.where(still, rest.reference + self.period, 0.0)
        long = (s >= _SHORTEST / self.bandwidth) & (s * t >= self.patience * self.patience)
        sticks = level * s * s >= 4.0 * TOLERANCE * inertia
        return rest._replace(reference=t, held=np.where(still & long & sticks, 1.0, 0.0))


@function
def kept(rest: Rest, before: Observed, after: Observed) -> Observed:
    """Return `after` with the perturbation of joints that are held as it is in `before`."""
    if not some(rest.held):
        return after
    held = rest.held != 0.0
    return after._replace(perturbation=np.where(held, before.perturbation, after.perturbation),
                          slope=np.where(held, 0.0, after.slope))


@function
def standstill(bandwidth: float, bound: Array, rate: Array, period: float) -> Standstill:
    """
    Return what holds joints.

    Parameters
    ----------
    bandwidth : float
        ω [rad/s].
    bound, rate : array, shape (n,)
        Ka [N·m], and R, inf for none [N·m/s].
    period : float
        h [s].

    """
    return Standstill(period, bandwidth, _PATIENCE / bandwidth + bound / rate)


#: Least s.
LEAST = 0.1
_LN_LEAST = log(LEAST)
#: Below which the feedback is slow, at s = 1, and how fast a half-wave fades [rad/s].
_SLOW_PART, _FADING = 30.0, 10.0
#: The ratio r that is normal; w [rad/s]; t [s].
_NORMAL, _RETREAT, _RECOVERY = 0.5, 80.0, 2.0
#: Feedback in Ka, and s, beyond and below which the loop may be out of control.
_STRONG, _LN_LOW = 3.0, log(0.2)
#: How much later that counts after a start that is strong from the first sample on [s].
GRACE = 2.0
#: ln s below which a loop that goes on oscillating has a limit cycle.
_LN_CYCLE = log(0.7)
#: The least of its half-waves, in min(Ka, B): half of those at which the bandwidth retreats.
_CYCLE = 0.25
#: Longest time that it may be calm between two of them [s].
_CALM = 0.2
#: ln s below which a calm may be that between two oscillations.
_LN_CAUGHT = log(0.3)
#: Time over which waves are counted [s].
_COUNTED = 0.25
#: In the place of a bound of 0 [N·m].
_LEAST_BOUND = 1e-9


@record
class Oscillation(NamedTuple):
    """What is remembered of the feedback."""

    #: f_s [N·m], shape (n,).
    slow: Array
    #: Extreme of this half-wave of f, with its sign; f₁ and f₂; shape (n,) [N·m].
    extreme: Array
    last: Array
    second_last: Array
    #: ln s.
    retreat: float
    #: How long f has exceeded 3 Ka with s < 0.2, from -2 at the start on [s].
    strained: float
    #: Waves of f a second, shape (n,) [Hz].
    frequency: Array
    #: How long ago a half-wave was that of a limit cycle, and L of (OG2) [s].
    calm: float
    cycling: float


@record
class OscillationGuard(NamedTuple):
    """Says how much bandwidth a loop may use; made by `oscillation_guard`."""

    #: Ka, Ka + B and the lesser of Ka and B [N·m], shape (n,).
    bound: Array
    believed: Array
    sustained: Array
    #: 1 - exp(-30 h) and exp(-10 h).
    renewed: float
    fading: float
    #: exp(-h / 2 s), exp(-h / 0.25 s), and h [s].
    kept: float
    counted: float
    period: float

    def noticed(self, last: Oscillation, feedback: Array, missing: Array) -> Oscillation:
        """
        Return what follows a sample, by (OG1); arrays of shape (n,) [N·m].

        Parameters
        ----------
        last : Oscillation
            After the sample before.
        feedback, missing : array, shape (n,)
            f, and what the law knows that the drives do not give.

        """
        size, largest = np.abs(feedback), self.fading * np.abs(last.extreme)
        turned = np.sign(feedback) * last.extreme < 0.0
        extreme = np.where(turned | (size > largest), feedback, self.fading * last.extreme)
        f1 = np.where(turned, largest, self.fading * last.last)
        f2 = self.fading * np.where(turned, last.last, last.second_last)
        believed = np.sign(feedback) * np.maximum(size - np.abs(missing), 0.0)
        slow = last.slow + exp(last.retreat) * self.renewed * (believed - last.slow)
        waves = np.minimum(size, np.minimum(f1, f2)) / self.sustained
        ratio = np.maximum(
            np.abs(believed - slow) / (self.believed + np.abs(slow)), waves).max()
        retreat = (self.kept * last.retreat
                   - _RETREAT * self.period * max(ratio - _NORMAL, 0.0))
        strained = last.strained + self.period
        if (size / self.bound).max() < _STRONG or retreat > _LN_LOW:
            strained = 0.0
        calm = 0.0 if waves.max() > _CYCLE else last.calm + self.period
        lasts = retreat < _LN_CYCLE and calm < _CALM
        rate = 1.0 if lasts else 0.0 if retreat < _LN_CAUGHT else -1.0
        cycling = max(last.cycling + rate * self.period, 0.0)
        turns = np.where(turned, 0.5 / self.period, 0.0)
        frequency = turns + self.counted * (last.frequency - turns)
        return Oscillation(slow, extreme, f1, f2, max(retreat, _LN_LEAST), strained, frequency,
                           calm, cycling)

    def cycling_joint(self, state: Oscillation) -> int:
        """Return the joint with the largest half-waves."""
        return int(np.argmax(np.minimum(state.last, state.second_last) / self.sustained))


@function
def oscillation_guard(bound: Array, rate: Array, pole: Array, period: float) -> OscillationGuard:
    """Return a guard for Ka [N·m], R [N·m/s] and √Kp_ii [rad/s], shape (n,), and h [s]."""
    bound, followed = np.maximum(bound, _LEAST_BOUND), rate / pole
    return OscillationGuard(
        bound, bound + np.where(followed < np.inf, followed, 0.0), np.minimum(bound, followed),
        1.0 - exp(-_SLOW_PART * period), exp(-_FADING * period), exp(-period / _RECOVERY),
        exp(-period / _COUNTED), period)

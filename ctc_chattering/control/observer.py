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
What the controller knows of drives and state: a model of the drives, and an observer.

Drives
------
The drives as the controller knows them: a lag of first order with a limited rate.

While a command c is held, the torque τ of a drive with the lag T and the rate limit R follows::

    dτ/dt = (c - τ) / T, within ±R                                                        (DM1)

It moves at the rate R until |c - τ| = R T, then exponentially. What a period h of that does to a
mass has a closed form; with x = τ - c, s the time since the command, r the end of the first part::

    x(h),     1/h ∫ x ds,     2/h² ∫ (h - s) x ds

the last two being the means that the velocity and the position at the end of the period see.

State
-----
An observer of position, velocity and perturbation that is driven by position and torque.

Its model has the drives (`drive_model`), so that it knows the torque that acts, and Coulomb's
friction f of the level K̂, implicit as in docs/theory.md. Over a period::

    f ∈ K̂ Sgn(dq⁺),   a = M⁻¹ (τ - C dq - G - f - P̂),   dq⁺ = dq + h a,   P̂⁺ = P̂ + h Ṗ̂   (SO1)

and q⁺ likewise, each with its own mean of τ and P̂ over the period. The measured position
corrects this; the velocity is not measured. With ε = q - q̂ and θ = exp(-ω h)::

    q̂  += (1 - θ⁴) ε
    dq̂ += (1 - θ)² (11 + 14 θ + 11 θ²) ε / (6 h)
    P̂  -= M 2 (1 - θ)³ (1 + θ) ε / h²
    Ṗ̂  -= M (1 - θ)⁴ ε / h³                                                           (SO2)

which puts the four poles of the error at θ: the cubic fading-memory filter (Morrison 1969).
The slope Ṗ̂ leaves of a perturbation of the frequency w, for w « ω, 6 (w / ω)². P̂ is within ±Ka
in the metric of M⁻¹; at a bound, Ṗ̂ does not lead out.

Without the slope the observer has three poles, by the quadratic filter of the same book::

    q̂  += (1 - θ³) ε
    dq̂ += 3 (1 - θ)² (1 + θ) ε / (2 h)
    P̂  -= M (1 - θ)³ ε / h²,     Ṗ̂ = 0                                                  (SO3)

It leaves 3 w / ω of the same perturbation, and tolerates a larger error of the inertia: with
M̂ = c M under computed torque with the double pole p, without lag and delay and for h → 0, the
characteristic polynomial of a joint is::

    (s + p)² (s + ω)³ + (c - 1) ω ((ω² + 6 p ω + 3 p²) s² + p ω (2 ω + 3 p) s + p² ω²)    (SO4)

which is stable for 0.20 < c < 4.7 with ω = 4 p.
"""

from __future__ import annotations

from math import exp
from typing import NamedTuple

from ctc_chattering.compiled.compilable import dot, every, record, solve, some
from ctc_chattering.numerics.box_qp import nearest, nearest_and_motion
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import LARGEST
import numpy as np

#: In the place of a lag of 0 [s]: shorter than any period.
_NO_LAG = 1e-15


@record
class DriveModel(NamedTuple):
    """Drives with a known lag and rate limit, as `drive_model` makes them; arrays (n,)."""

    #: h [s].
    period: float
    #: T, at least 1e-15 s; R [N·m/s], inf for none; the same with 0 for none; exp(-h / T).
    lag: Array
    rate: Array
    slope: Array
    decay: Array
    #: R (T + h): a command farther than this from the torque moves it no faster [N·m].
    reach: Array
    #: R T: up to this difference the torque is within the rate [N·m]; and what is left of it at
    #: the end, in the mean and in the weighted mean of the period, `decay` being the first.
    linear: Array
    mean: Array
    weighted: Array

    def response(self, torque: Array, command: Array) -> tuple[Array, Array, Array]:
        """
        Return what `torque` does over a period in which `command` is held, all (n,) [N·m].

        That is the torque at the end; its mean, which changes the velocity; and its mean weighted
        by the time that is left, which changes the position.
        """
        h, T, x0 = self.period, self.lag, torque - command
        if every(np.abs(x0) <= self.linear):
            return (command + self.decay * x0, command + self.mean * x0,
                    command + self.weighted * x0)
        r = np.minimum(np.maximum(np.abs(x0) / self.rate - T, 0.0), h)
        slope, rest = -np.sign(x0) * self.slope, h - r
        x1 = x0 + slope * r
        decay = np.exp(-rest / T)
        ramp, tail = r * (x0 + 0.5 * slope * r), T * x1 * (1.0 - decay)
        weighted = h * ramp - r * r * (0.5 * x0 + slope * r / 3.0) + T * (x1 * rest - tail)
        return (command + x1 * decay, command + (ramp + tail) / h,
                command + 2.0 / (h * h) * weighted)

    def command(self, now: Array, after: Array) -> Array:
        """
        Return the command by which the drives give a wanted torque, shape (n,) [N·m].

        Where the torque of a drive with a lag differs from what is wanted, that decays with T::

            c = (after - E now) / (1 - E),     E = exp(-h / T)

        which for small h is wanted + T d(wanted)/dt. A drive without a lag gets `now`.

        Parameters
        ----------
        now, after : array, shape (n,)
            Wanted at the start and at the end of the period [N·m].

        """
        E = self.decay
        return np.where(self.lag > _NO_LAG, (after - E * now) / (1.0 - E), now)


def drive_model(lag: Array, rate: Array, period: float) -> DriveModel:
    """
    Return drives.

    Parameters
    ----------
    lag : array, shape (n,)
        T [s]; 0 for none.
    rate : array, shape (n,)
        R [N·m/s]; inf for none.
    period : float
        h [s].

    """
    floor, decay = np.maximum(lag, _NO_LAG), np.exp(-period / np.maximum(lag, _NO_LAG))
    mean = floor * (1.0 - decay) / period
    return DriveModel(period, floor, rate, np.where(rate < np.inf, rate, 0.0), decay,
                      np.minimum(rate * (lag + period), LARGEST), rate * floor, mean,
                      2.0 * floor / period * (1.0 - mean))


@record
class Observed(NamedTuple):
    """A state of robot and drives; arrays of shape (n,)."""

    #: Position [rad] and velocity [rad/s].
    q: Array
    dq: Array
    #: Torque of the drives [N·m].
    torque: Array
    #: P̂ [N·m] and its slope [N·m/s].
    perturbation: Array
    slope: Array


@record
class StateObserver(NamedTuple):
    """Estimates the state, sample by sample; made by `state_observer`."""

    #: Between command and torque.
    drives: DriveModel
    #: Ka [N·m], shape (n,).
    bound: Array
    #: Gains of (SO2), those of P̂ and its slope without M.
    position: float
    velocity: float
    force: float
    jerk: float

    def slowed(self, part: float) -> StateObserver:
        """Return the observer with a part of the bandwidth of P̂, and of its bound."""
        return self._replace(bound=np.sqrt(part) * self.bound, force=part * self.force,
                             jerk=part * part * self.jerk)

    def predict(self, at: Observed, mass: Array, bias: Array, level: Array, command: Array
                ) -> Observed:
        """
        Return the state a period later, by (SO1).

        Parameters
        ----------
        at : Observed
            The state now.
        mass, bias : array, shape (n, n) and (n,)
            M [kg·m²] and C dq + G [N·m] there.
        level : array, shape (n,)
            K̂ [N·m].
        command : array, shape (n,)
            Torque commanded for the period [N·m].

        """
        h = self.drives.period
        end, mean, weighted = self.drives.response(at.torque, command)
        load = mean - (bias + at.perturbation + 0.5 * h * at.slope)
        _, rest = nearest_and_motion(mass, dot(mass, at.dq) / h + load, level)
        dq = h * rest
        other = weighted - mean + h / 6.0 * at.slope
        q = at.q + 0.5 * h * (at.dq + dq)
        if some(other):
            q = q + 0.5 * h * h * solve(mass, other)
        return Observed(q, dq, end, at.perturbation + h * at.slope, at.slope)

    def correct(self, at: Observed, mass: Array, q: Array) -> Observed:
        """Return the state with what the measured position `q`, (n,) [rad], says, by (SO2)."""
        error = q - at.q
        load = dot(mass, error)
        P, slope = at.perturbation - self.force * load, at.slope - self.jerk * load
        bounded = nearest(mass, P, self.bound)
        at_bound = np.abs(bounded) >= self.bound
        if some(at_bound):
            slope = np.where(at_bound & (slope * bounded > 0.0), 0.0, slope)
        return at._replace(q=at.q + self.position * error, dq=at.dq + self.velocity * error,
                           perturbation=bounded, slope=slope)


def state_observer(drives: DriveModel, bandwidth: float, bound: Array, slope: bool = True
                   ) -> StateObserver:
    """
    Return an observer.

    Parameters
    ----------
    drives : DriveModel
        Between command and torque, with the period h.
    bandwidth : float
        ω [rad/s].
    bound : array, shape (n,)
        Ka [N·m].
    slope : bool
        Whether Ṗ̂ is a state, by (SO2), or 0, by (SO3).

    """
    h, pole = drives.period, exp(-bandwidth * drives.period)
    rest = 1.0 - pole
    if not slope:
        return StateObserver(drives, bound, 1.0 - pole ** 3,
                             1.5 * rest ** 2 * (1.0 + pole) / h, rest ** 3 / h ** 2, 0.0)
    return StateObserver(
        drives, bound, 1.0 - pole ** 4,
        rest ** 2 * (11.0 + 14.0 * pole + 11.0 * pole ** 2) / (6.0 * h),
        2.0 * rest ** 3 * (1.0 + pole) / h ** 2, rest ** 4 / h ** 3)

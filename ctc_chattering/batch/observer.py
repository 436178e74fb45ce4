"""
The observer of position, velocity and perturbation, and the level of friction.

As `control/state_observer.py`, `control/drive_model.py` and `control/friction_level.py` have them.
An observed state is an array of five rows: position, velocity, torque of the drives, perturbation
and its slope.
"""

from __future__ import annotations

import dataclasses
from math import exp

import numpy as np

from ctc_chattering.batch.box_qp import BoxScratch, nearest
from ctc_chattering.batch.compiler import compiled, inlined
from ctc_chattering.batch.linear_algebra import factor, substitute
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import period_ns, seconds
from ctc_chattering.parameters import LARGEST

#: Rows of an observed state.
Q, DQ, TORQUE, P, SLOPE = range(5)
#: In the place of a lag of 0 [s].
_NO_LAG = 1e-12
#: w₀ of the level of friction [rad/s], and velocity that counts as motion [rad/s].
_SLOW, _MOVING = 60.0, 2e-3


@dataclasses.dataclass
class ObserverSettings:
    """Parameters; arrays of shape (n,)."""

    period: float
    bound: Array
    #: Gains of (2) of `state_observer`, without M.
    position: float
    velocity: float
    acceleration: float
    jerk: float
    #: Of the drives: T, at least 1e-12 s; R, and 0 for none; exp(-h / T); whether there is a lag.
    lag: Array
    rate: Array
    slope: Array
    decay: Array
    lagging: Array
    #: R (T + h) [N·m].
    reach: Array
    #: Of the level of friction: γ h, 1 - exp(-ω h), 1 - exp(-w₀ h).
    learning: float
    follow: float
    forget: float


@dataclasses.dataclass
class ObserverScratch:
    """Scratch; arrays of shape (n,) and (n, n)."""

    mean: Array
    weighted: Array
    x: Array
    friction: Array
    lower: Array


def observer_settings(config: ControllerConfig) -> ObserverSettings:
    """Return the numbers of a configuration."""
    h, rate = seconds(period_ns(config.control_period)), np.array(config.torque_rate_limit)
    pole = exp(-config.estimator_bandwidth * h)
    rest, lag = 1.0 - pole, np.array(config.actuator_lag)
    floor = np.maximum(lag, _NO_LAG)
    return ObserverSettings(
        h, np.array(config.ka), 1.0 - pole ** 4,
        rest ** 2 * (11.0 + 14.0 * pole + 11.0 * pole ** 2) / (6.0 * h),
        2.0 * rest ** 3 * (1.0 + pole) / h ** 2, rest ** 4 / h ** 3, floor, rate,
        np.where(rate < np.inf, rate, 0.0), np.exp(-h / floor), (lag > 0.0).astype(float),
        np.minimum(rate * (lag + h), LARGEST), config.friction_learning * h,
        1.0 - exp(-config.estimator_bandwidth * h), 1.0 - exp(-_SLOW * h))


def observer_scratch(n: int) -> ObserverScratch:
    """Return scratch for `n` joints."""
    zero = np.zeros(n)
    return ObserverScratch(zero, zero, zero, zero, np.zeros((n, n)))


@inlined
def respond(c: ObserverSettings, i: int, torque: float, command: float) -> tuple[
        float, float, float]:
    """Return torque of drive `i` at the end of a period, its mean, and its weighted mean [N·m]."""
    h, T, x0 = c.period, c.lag[i], torque - command
    r = min(max(abs(x0) / c.rate[i] - T, 0.0), h)
    slope, rest = -np.sign(x0) * c.slope[i], h - r
    x1 = x0 + slope * r
    decay = exp(-rest / T)
    area = r * (x0 + 0.5 * slope * r) + T * x1 * (1.0 - decay)
    weighted = (h * r * (x0 + 0.5 * slope * r) - r * r * (0.5 * x0 + slope * r / 3.0)
                + x1 * T * (rest - T * (1.0 - decay)))
    return command + x1 * decay, command + area / h, command + 2.0 / (h * h) * weighted


@compiled
def predict(c: ObserverSettings, w: ObserverScratch, box: BoxScratch, at: Array, mass: Array,
            bias: Array, level: Array, command: Array, out: Array) -> None:
    """Set the state a period after `at`, by (1) of `state_observer`; `out` may be `at`."""
    n, h = len(bias), c.period
    for i in range(n):
        end, mean, weighted = respond(c, i, at[TORQUE, i], command[i])
        load = bias[i] + at[P, i]
        w.mean[i] = mean - (load + 0.5 * h * at[SLOPE, i])
        w.weighted[i] = weighted - (load + h / 3.0 * at[SLOPE, i])
        w.x[i] = w.mean[i]
        for j in range(n):
            w.x[i] += mass[i, j] * at[DQ, j] / h
        out[TORQUE, i] = end
    nearest(mass, w.x, level, n, box, w.friction)
    for i in range(n):
        w.mean[i] -= w.friction[i]
        w.weighted[i] -= w.friction[i]
    factor(mass, n, w.lower)
    substitute(w.lower, n, w.mean)
    substitute(w.lower, n, w.weighted)
    for i in range(n):
        out[Q, i] = at[Q, i] + h * at[DQ, i] + 0.5 * h * h * w.weighted[i]
        out[DQ, i] = at[DQ, i] + h * w.mean[i]
        out[P, i] = at[P, i] + h * at[SLOPE, i]
        out[SLOPE, i] = at[SLOPE, i]


@inlined
def correct(c: ObserverSettings, w: ObserverScratch, box: BoxScratch, at: Array, mass: Array,
            q: Array) -> None:
    """Correct the state `at` by the measured position, by (2) of `state_observer`."""
    n = len(q)
    for i in range(n):
        force = 0.0
        for j in range(n):
            force += mass[i, j] * (q[j] - at[Q, j])
        w.x[i] = at[P, i] - c.acceleration * force
        at[SLOPE, i] -= c.jerk * force
    for i in range(n):
        error = q[i] - at[Q, i]
        at[Q, i] += c.position * error
        at[DQ, i] += c.velocity * error
    nearest(mass, w.x, c.bound, n, box, w.x)
    for i in range(n):
        at[P, i] = w.x[i]
        if abs(w.x[i]) >= c.bound[i] and at[SLOPE, i] * w.x[i] > 0.0:
            at[SLOPE, i] = 0.0


@inlined
def learn(c: ObserverSettings, dq: Array, perturbation: Array, lags: Array, slow: Array,
          level: Array) -> None:
    """Improve the level of friction, shape (n,) [N·m], by one sample; see `friction_level`."""
    for i in range(len(level)):
        x = np.sign(dq[i]) if abs(dq[i]) > _MOVING else 0.0
        for k in range(3):
            lags[k, i] += c.follow * (x - lags[k, i])
            x = lags[k, i]
        slow[0, i] += c.forget * (x - slow[0, i])
        slow[1, i] += c.forget * (perturbation[i] - slow[1, i])
        change = c.learning * (x - slow[0, i]) * (perturbation[i] - slow[1, i])
        level[i] = min(max(level[i] + change, 0.0), c.bound[i])

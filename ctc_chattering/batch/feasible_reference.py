"""
The reference that slow drives can follow, as `control/feasible_reference.py` has it.

Its parameters are those of the law `observer_feedback`.
"""

from __future__ import annotations

import dataclasses
from math import sqrt

import numpy as np

from ctc_chattering.batch.compiler import inlined
from ctc_chattering.batch.linear_algebra import solve
from ctc_chattering.control import feasible_reference as feasible
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import period_ns, seconds
from ctc_chattering.parameters import matrix

_TOP = 1.0 + feasible.OVERSHOOT
_LEAD, _PART, _RAMP_RETURN, _BEHIND, _LEAST, _TINY = (
    feasible._LEAD, feasible._PART, feasible._RAMP_RETURN, feasible._BEHIND, feasible._LEAST,
    feasible._TINY)


@dataclasses.dataclass
class FeedbackSettings:
    """Parameters; arrays of shape (n,) or (n, n)."""

    kp: Array
    kv: Array
    any_lag: bool
    #: Of the reference: fastest return [1/s], Kv + T_a Kp [1/s], R [N·m/s].
    fastest: Array
    relief: Array
    rate: Array


def feedback_settings(config: ControllerConfig) -> FeedbackSettings:
    """Return the numbers of a configuration."""
    n, h = len(config.joint_names), seconds(period_ns(config.control_period))
    kp, kv = (np.array(matrix(x, n)) for x in (config.kp, config.kv))
    lag = np.array(config.actuator_lag)
    return FeedbackSettings(
        kp, kv, any(config.actuator_lag),
        np.minimum(feasible._RETURN * np.sqrt(kp.diagonal()), feasible._STEP / h),
        kv.diagonal() + lag * kp.diagonal(), np.array(config.torque_rate_limit))


@inlined
def friction(c: FeedbackSettings, level: Array, dq: float, ddq: float, ahead: float, i: int
             ) -> float:
    """Return F of (1) of `feasible_reference`, joint `i` [N·m], `ahead` [s] after a point."""
    T = max(level[i] / c.rate[i], _LEAST)
    s = (dq + (_LEAD * T + ahead) * ddq) / max(abs(ddq) * T, _TINY)
    size = abs(s)
    return float(level[i] * np.sign(s) * (size if size <= _TOP else max(2.0 * _TOP - size, 1.0)))


@inlined
def back(c: FeedbackSettings, inertia: float, level: float, x: float, dx: float, i: int) -> float:
    """Return -2 w dx - w² x of (3) of `feasible_reference` [rad/s²]."""
    jerk = _PART * c.rate[i] / inertia
    w = min(c.fastest[i], _RAMP_RETURN * c.rate[i] / max(level, _TINY),
            np.cbrt(jerk / max(abs(x), _TINY)), sqrt(jerk / max(abs(dx), _TINY)))
    return float(-w * (2.0 * dx + w * x))


@inlined
def relieve(c: FeedbackSettings, missing: Array, mass: Array, lower: Array, dx: Array) -> None:
    """Take from dx what the drives do not give, by (5) of `feasible_reference`."""
    n, any_rest = len(dx), False
    for i in range(n):
        slack = _BEHIND * c.rate[i]
        missing[i] -= min(max(missing[i], -slack), slack)
        any_rest |= missing[i] != 0.0
    if any_rest:
        solve(mass, missing, lower)
        for i in range(n):
            dx[i] -= missing[i] / c.relief[i]

"""Parameters and state of the compiled control step."""

from __future__ import annotations

import dataclasses
from math import exp, expm1, inf

from ctc_chattering.control.controller import LAWS
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.switching import SWITCHINGS
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import period_ns, seconds
from ctc_chattering.parameters import matrix
import numpy as np

#: Torques in transit that there is room for: `input_delay` is at most 100.
LONGEST_DELAY = 100


@dataclasses.dataclass
class ControlSettings:
    """Parameters of laws, filter and limits; arrays of shape (n,) or (n, n)."""

    #: Index in `LAWS` and in `SWITCHINGS`.
    law: int
    switching: int
    period: float
    delay: int
    kp: Array
    kv: Array
    ka: Array
    #: Of the filter (3): λ, b, exp(-λ h), c = b (1 - exp(-λ h)) / λ, b h, b h - c.
    lambda_: float
    b: float
    decay: float
    gain: float
    scale: float
    rest: float
    #: Half width of the boundary layer; gain of the perturbation observer.
    width: float
    follow: float
    #: Largest torque [N·m] and change of the torque in a period, and whether there are any.
    effort: Array
    change: Array
    limited: bool
    anti_windup: bool
    error_limit: Array
    #: Of `integral`: h Ki and 1 - exp(-h Ki / Kp).
    ki: Array
    tracking: Array
    #: Of `momentum_observer`: 1 - exp(-K h).
    momentum: float
    #: Of `super_twisting`: k1 and h k2.
    k1: Array
    k2: Array
    #: Of `slotine_li` and `friction_feedforward`: Kv⁻¹ Kp, h Γ, level, ε.
    slope: Array
    adaptation: Array
    level: Array
    friction_velocity: float


@dataclasses.dataclass
class ControlState:
    """What the control step remembers; arrays of shape (n,) unless they say otherwise."""

    #: ξ of the filter, and torque sent last.
    xi: Array
    held: Array
    #: Control steps taken; lost samples are none.
    steps: int
    #: Torques in transit with what the limits and ±Ka have taken of each, (101, n) [N·m].
    sent: Array
    excess: Array
    clipped: Array
    #: Estimate P̂ of an observer, and whether it has a last sample.
    estimate: Array
    observed: int
    #: Of the perturbation observer: M (n, n), y, N - τ. Of the momentum observer: p, β, τ.
    mass: Array
    nominal: Array
    residual: Array
    third: Array
    #: Integral x, or w of super-twisting and w of the next sample.
    integral: Array
    next: Array  # noqa: A003
    #: Level of friction of `slotine_li`.
    level: Array


@dataclasses.dataclass
class Evaluated:
    """A state and a reference with what the laws need of them, as `control.laws.base.State`."""

    q: Array
    dq: Array
    q_d: Array
    dq_d: Array
    ddq_d: Array
    e: Array
    de: Array
    u: Array
    v: Array
    M: Array
    C: Array
    G: Array
    N: Array
    #: ξ of the filter at this state.
    xi: Array


@dataclasses.dataclass
class ControlScratch:
    """Scratch of the control step; arrays of shape (n,) and (n, n)."""

    compensation: Array
    robust: Array
    nominal: Array
    clipped: Array
    x: Array
    y: Array
    z: Array
    lower: Array
    inverse: Array


def control_settings(config: ControllerConfig, model: Model) -> ControlSettings:
    """Return the numbers of a configuration, with the effort limits of its model."""
    n, h = len(config.joint_names), seconds(period_ns(config.control_period))
    kp, kv = (np.array(matrix(x, n)) for x in (config.kp, config.kv))
    effort = np.array(config.largest_torque(model.effort_limits))
    change = h * np.array(config.effort_rate_limit)
    decay, gain = (exp(-config.lambda_ * h),
                   -config.b * expm1(-config.lambda_ * h) / config.lambda_)
    ki = np.array(config.ki)
    return ControlSettings(
        LAWS.index(config.law), SWITCHINGS.index(config.switching), h, config.input_delay, kp, kv,
        np.array(config.ka), config.lambda_, config.b, decay, gain, config.b * h,
        config.b * h - gain, config.boundary_layer, 1.0 - exp(-config.observer_bandwidth * h),
        effort, change, bool(min(effort.min(), change.min()) < inf), config.anti_windup,
        np.array(config.error_limit), h * ki, -np.expm1(-h * ki / kp.diagonal()),
        1.0 - exp(-config.momentum_gain * h), np.array(config.super_twisting_k1),
        h * np.array(config.super_twisting_k2), np.linalg.pinv(kv).dot(kp),
        h * np.array(config.adaptation_gain), np.array(config.friction_level),
        config.friction_velocity)


def control_state(config: ControllerConfig) -> ControlState:
    """Return the state at the start."""
    n = len(config.joint_names)
    zero, transit = np.zeros(n), np.zeros((LONGEST_DELAY + 1, n))
    return ControlState(zero, zero, 0, transit, transit, transit, zero, 0, np.zeros((n, n)), zero,
                        zero, zero, zero, zero, np.array(config.friction_level))


def evaluated(n: int) -> Evaluated:
    """Return room for a state of `n` joints."""
    return Evaluated(*(np.zeros((n, n) if field.name in 'MC' else n)
                       for field in dataclasses.fields(Evaluated)))


def control_scratch(n: int) -> ControlScratch:
    """Return scratch for `n` joints."""
    return ControlScratch(*[np.zeros(n)] * 7, *[np.zeros((n, n))] * 2)

"""
Law `observer_feedback`: computed torque on an observed state, for drives and encoders as they are.

An observer that has the perturbation as a state (Han, *From PID to active disturbance rejection
control*, IEEE TIE 56, 2009), with the bound Ka of the paper's law (6). At every sample, with what
`state_observer`, `feasible_reference`, `friction_level` and `drive_model` define::

    q̂, dq̂, P̂, Ṗ̂:  corrected by the measured q, then predicted until the torque arrives     (1)
    τ* = M (ddq_r + Kv (dq_r - dq̂) + Kp (q_r - q̂)) + C dq̂ + G - z                         (2)
    z  = -(P̂ + F), the nearest within ±Ka in the metric of M⁻¹                             (3)
    τ  = the command by which the drives give τ* at arrival and a period later             (4)

q_r is the reference with the deviation that the drives need, F the friction it makes. τ is within
R (T + h) of the torque of the drives, in the metric of M⁻¹: beyond it they are no faster. The
measured velocity is not used after the first sample.

With M̂ = c M, drives without lag and limits, and no friction, (1) to (3) are linear. Their poles
are within the unit circle, for Kp = p², Kv = 2 p, p = 100 rad/s, ω = 100 rad/s, h = 1 ms, if::

    0.47 < c < 3.1                                                                         (5)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.drive_model import DriveModel
from ctc_chattering.control.error_filter import ErrorFilter
from ctc_chattering.control.feasible_reference import Desired, Deviation, FeasibleReference
from ctc_chattering.control.friction_level import FrictionLevel
from ctc_chattering.control.laws.base import Law, State, Terms, Torque
from ctc_chattering.control.state_observer import Observed, StateObserver
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import matrix


class ObserverFeedback(Law):
    """
    Computed torque on an observed state.

    Attributes
    ----------
    friction : FrictionLevel
        K̂ as learned so far.

    """

    symbol = '-(P̂ + F)'
    foresees = True
    _model: Model

    def __init__(self, filter_: ErrorFilter) -> None:
        super().__init__(filter_)
        self._given = self.zero
        self._mass: Array | None = None
        self.friction = FrictionLevel(self.zero)
        self.reset()

    def configure(self, config: ControllerConfig, period: float) -> None:
        """Use other gains; the observed state, K̂ and the deviation are preserved."""
        n, bandwidth = len(self.zero), config.estimator_bandwidth
        rate, self._ka = np.array(config.torque_rate_limit), np.array(config.ka)
        self._kp, self._kv = np.array(matrix(config.kp, n)), np.array(matrix(config.kv, n))
        self._period, self._given = period, np.array(config.friction_level)
        self._lagging = any(config.actuator_lag)
        lag = np.array(config.actuator_lag)
        self._drives = DriveModel(lag, rate, period)
        self._observer = StateObserver(self._drives, bandwidth, period, self._ka)
        self._reference = FeasibleReference(
            self._kp.diagonal(), self._kv.diagonal(), rate, lag, period)
        self.friction.configure(config.friction_learning, bandwidth, period, self._ka)

    def reset(self) -> None:
        """Forget state, deviation and what was learned."""
        self.friction.reset(self._given)
        self._observed = Observed(*[self.zero] * 5)
        self._mass = None
        self._forget_reference()

    def _forget_reference(self) -> None:
        self._deviation: Deviation | None = None
        self._last: Desired | None = None

    def initialize(self, now: State, estimate: Array | None) -> None:
        """Begin with the estimate of the other law."""
        if estimate is not None:
            P = nearest(now.M, estimate - self.friction.level * np.sign(now.dq), self._ka)
            self._observed = self._observed._replace(perturbation=P)
        self._forget_reference()

    def suspend(self) -> None:
        """Have the state observed again from the measured one, once this law comes back."""
        self._mass = None

    def observe(self, q: Array, dq: Array, held: Array) -> tuple[Array, Array]:
        """Return q̂ and dq̂, corrected by the measured position; see `Law.observe`."""
        if self._mass is None:
            self._observed = Observed(q, dq, held, self.zero, self.zero)
        else:
            self._observed = self._observer.correct(self._observed, self._mass, q)
        self._mass = None
        return self._observed.q, self._observed.dq

    def foresee(self, now: State, coming: Sequence[Array], points: Sequence[Desired],
                model: Model) -> None:
        """Predict the state in which the torque arrives; see `Law.foresee`."""
        at, terms = self._observed, (now.M, now.C.dot(now.dq) + now.G)
        for command in coming:
            at = self._observer.predict(at, *terms, self.friction.level, command)
            terms = _dynamics(model, at)
        self._arriving, self._terms, self._point, self._model = at, terms, points[-1], model

    def terms(self, at: State) -> Terms:
        """Return the terms of (4)."""
        arriving, point, (M, bias) = self._arriving, self._point, self._terms
        inertia, level, reference = M.diagonal(), self.friction.level, self._reference
        by = self._deviation or Deviation(arriving.q - point.q, arriving.dq - point.dq)
        tau, z = self._wanted(arriving, M, bias, point, by)
        by = reference.following(point, by, inertia, level)
        if self._lagging:
            half = 0.5 * (arriving.torque + tau)
            after = self._observer.predict(
                arriving._replace(torque=half), M, bias, level, half)
            wanted, _ = self._wanted(
                after, *_dynamics(self._model, after), self._next(point), by)
            tau = self._drives.command(tau, wanted)
        sent = arriving.torque + nearest(M, tau - arriving.torque, self._drives.reach)
        self._deviation, self._last = reference.relieved(by, tau - sent, M), point
        return Terms(sent + z, self.zero, z)

    def _wanted(self, at: Observed, M: Array, bias: Array, point: Desired, by: Deviation
                ) -> tuple[Array, Array]:
        """Return τ* of (2) and z of (3)."""
        level = self.friction.level
        q_r, dq_r, ddq_r = self._reference.shifted(point, by, M.diagonal(), level)
        z = -nearest(M, at.perturbation + self._reference.friction(point, level), self._ka)
        u = self._kv.dot(dq_r - at.dq) + self._kp.dot(q_r - at.q)
        return M.dot(ddq_r + u) + bias - z, z

    def _next(self, point: Desired) -> Desired:
        """Return the point of the reference a period after `point`, with the last jerk."""
        h, (q, dq, ddq) = self._period, point
        step = self.zero if self._last is None else ddq - self._last.ddq
        return Desired(q + h * (dq + h * (0.5 * ddq + step / 6.0)),
                       dq + h * (ddq + 0.5 * step), ddq + step)

    def advance(self, now: State, applied: Torque, correction: Array | None) -> None:
        """Learn the level of friction, and go on to the next sample."""
        observed = self._observed
        self.friction.learn(observed.dq, observed.perturbation)
        if applied.saturation_error is not None and self._deviation is not None:
            self._deviation = self._reference.relieved(
                self._deviation, applied.saturation_error, now.M)
        self._observed = self._observer.predict(
            observed, now.M, now.C.dot(now.dq) + now.G, self.friction.level, applied.tau)
        self._mass = now.M

    def estimate(self, now: State) -> Array:
        """Return P̂ with the friction of sliding."""
        friction: Array = self.friction.level * np.sign(now.dq)
        return self._observed.perturbation + friction


def _dynamics(model: Model, at: Observed) -> tuple[Array, Array]:
    """Return M and C dq + G, shapes (n, n) and (n,)."""
    M, C, G = model.evaluate(at.q, at.dq)
    return M, C.dot(at.dq) + G


#: What the name of this module stands for.
LAW = ObserverFeedback

"""The controller: one call of `step` per sample, by the law that its parameters name."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import NamedTuple

from ctc_chattering.arguments import checked, vector
from ctc_chattering.control.control_step import ControlStep
from ctc_chattering.control.controller_config import ControllerConfig, LAWS
from ctc_chattering.control.delay_prediction import DelayPrediction
from ctc_chattering.control.error_filter import ErrorFilter
from ctc_chattering.control.laws.registry import make_laws
from ctc_chattering.control.limiter import Limiter
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.dynamics.scaled_model import Scaled
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import period_ns, seconds
from ctc_chattering.parameters import matrix
from ctc_chattering.trajectory.buffer import Point
import numpy as np

__all__ = ['LAWS', 'Controller', 'ControllerConfig', 'Sample']


class Sample(NamedTuple):
    """
    What one control step computed; every vector is a list of n floats.

    e, de and v belong to the state; what follows to the torque, which under an input delay is for
    the state predicted over it.
    """

    #: Torque to send, within the limits [N·m].
    tau: Vector
    #: Position error e = q_d - q [rad].
    e: Vector
    #: Velocity error de = dq_d - dq [rad/s].
    de: Vector
    #: Filtered error [rad/s].
    v: Vector
    #: What model and feedback ask for: M [ddq_d + Kv de + Kp e] + C dq + G under most laws [N·m].
    nominal: Vector
    #: C v, which the laws (2) and (6) subtract; 0 under the others [N·m].
    compensation: Vector
    #: What is subtracted against the perturbation: Ka sgn(v) under (6), however switched [N·m].
    robust: Vector
    #: What the limits have taken from the torque [N·m]; None for nothing.
    saturation_error: Vector | None


class Controller:
    """
    The sampled controller: one call of `step` per state.

    Contract: `step` takes the state and the reference at sample k and returns the torque to hold
    until sample k + 1. It reads no clock; the filter advances by exactly one period per call.

    Parameters
    ----------
    config : ControllerConfig
        Law and gains.
    model : Model, optional
        In place of the one that the configuration names.

    Attributes
    ----------
    config : ControllerConfig
        In force.
    model : Model
        With `inertia_scale` and `gravity_scale`.
    filter : ErrorFilter
        The filter (3).
    laws : dict of str to Law
        Every law by name; one of them is in force.

    """

    @checked(config=ControllerConfig, model=(Model, type(None)))
    def __init__(self, config: ControllerConfig, model: Model | None = None) -> None:
        n = len(config.joint_names)
        self.model = model or model_of(config)
        if self.model.n != n:
            raise CtcError(f'joint_names: {list(config.joint_names)} are not allowed with a model '
                           f'of {self.model.n} joints')
        if (config.inertia_scale, config.gravity_scale) != (1.0, 1.0):
            self.model = Scaled(self.model, config.inertia_scale, config.gravity_scale)
        self.filter, self._limiter = ErrorFilter(n), Limiter(n)
        self.laws = make_laws(self.filter)
        self._control = ControlStep(self.model, self.filter, self._limiter)
        self._loop = DelayPrediction(self._control, config.input_delay, n)
        self.configure(config)
        self.reset()

    @checked(config=ControllerConfig)
    def configure(self, config: ControllerConfig) -> None:
        """
        Use other gains or another law from the next step on.

        The filter state ξ is preserved, so that v has no step (unless b itself changes), and
        so are integrals and estimates. `Handover` says how another law takes over.
        """
        self.config = config
        n, period = len(config.joint_names), seconds(period_ns(config.control_period))
        effort = config.largest_torque(self.model.effort_limits)
        self.filter.configure(config.lambda_, config.b, period)
        self._limiter.configure(np.array(effort), period * np.array(config.effort_rate_limit),
                                self.filter.scale if config.anti_windup else 0.0)
        control = self._control
        control.period = period
        control.kp, control.kv = np.array(matrix(config.kp, n)), np.array(matrix(config.kv, n))
        for law in self.laws.values():
            law.configure(config, period)
        control.law = self.laws[config.law]

    def reset(self, bumpless: bool = False, held: Vector | None = None) -> None:
        """
        Start again: no estimate, no torque in transit, and ξ = 0.

        Parameters
        ----------
        bumpless : bool
            Start with v = 0 instead, so that the first torque is the inverse dynamics alone.
        held : sequence of float, shape (n,), optional
            Torque that is still held, from which `effort_rate_limit` goes on; 0 if left out.

        """
        rest = np.zeros(self.model.n) if held is None else vector('held', held, self.model.n)
        self.filter.reset()
        for law in self.laws.values():
            law.reset()
        self._control.reset()
        self._bumpless = bumpless
        self._limiter.reset(rest)
        self._loop.reset()

    def step(self, q: Vector, dq: Vector, q_d: Vector, dq_d: Vector, ddq_d: Vector,
             ahead: Sequence[Point] = ()) -> Sample:
        """
        Return the torque for this sample, and what it is made of.

        Parameters
        ----------
        q, dq : sequence of float, shape (n,)
            Position [rad] and velocity [rad/s].
        q_d, dq_d, ddq_d : sequence of float, shape (n,)
            Desired position [rad], velocity [rad/s] and acceleration [rad/s²].
        ahead : sequence of (q_d, dq_d, ddq_d)
            The same for the next samples, as many as `input_delay` says.

        """
        try:
            rows = np.array((q, dq, q_d, dq_d, ddq_d), float)
            wrong = rows.shape != (5, self.model.n)
        except (TypeError, ValueError, OverflowError):
            wrong = True
        if wrong:
            raise CtcError(str(ParameterError('q, dq, q_d, dq_d, ddq_d', (q, dq, q_d, dq_d, ddq_d),
                                              f'{self.model.n} numbers each')))
        x, dx, x_d, dx_d, ddx_d = rows
        if self._bumpless:
            self.filter.initialize_bumpless(dx_d - dx)
            self._bumpless = False
        now, sent = self._loop.step(x, dx, x_d, dx_d, ddx_d, ahead)
        terms, error = sent.terms, sent.saturation_error
        return Sample(
            sent.tau.tolist(), now.e.tolist(), now.de.tolist(), now.v.tolist(),
            terms.nominal.tolist(), terms.compensation.tolist(), terms.robust.tolist(),
            None if error is None else error.tolist())

    def try_step(self, q: Vector, dq: Vector, q_d: Vector, dq_d: Vector, ddq_d: Vector,
                 ahead: Sequence[Point] = ()) -> Sample | None:
        """
        Return what `step` does; None where that leaves the range of numbers.

        The law must then be `reset`.
        """
        try:
            sample = self.step(q, dq, q_d, dq_d, ddq_d, ahead)
        except (ArithmeticError, ValueError, np.linalg.LinAlgError):  # 1 / 0, sin(inf)
            return None
        return sample if isfinite(sum(sample.tau) + sum(sample.v)) else None

    def lyapunov(self, q: Vector, v: Vector) -> float:
        """Return V = ½ vᵀ M(q) v of equation (9) [J]."""
        at, x = (vector(name, values, self.model.n) for name, values in (('q', q), ('v', v)))
        return 0.5 * float(x @ np.array(self.model.mass_matrix(at.tolist())) @ x)

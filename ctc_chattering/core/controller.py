"""The laws: computed torque plus compensation (2), and plus chattering (6)."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
import dataclasses
from math import isfinite
from typing import ClassVar

from ctc_chattering.core.array_model import ArrayModel
from ctc_chattering.core.array_step import (
    ArrayStep,
    boundary_layer_term,
    Limits,
    no_term,
    sign_term,
    Term,
)
from ctc_chattering.core.filter import ErrorFilter
from ctc_chattering.core.grid import period_ns, seconds
from ctc_chattering.core.model import dot, Model, times, Vector
from ctc_chattering.core.models import check_model, locked_positions, model_of
from ctc_chattering.core.observer import PerturbationObserver
from ctc_chattering.core.parameters import Config, matrix, parameter
from ctc_chattering.core.predictor import predict
from ctc_chattering.core.sample import ListSample, Sample
from ctc_chattering.core.scaled import Scaled
from ctc_chattering.core.switching import boundary_layer, implicit_term, sign, SWITCHINGS
from ctc_chattering.core.trajectory import Point

__all__ = ['LAWS', 'Controller', 'ControllerConfig', 'Sample']

#: Values of the parameter ``law``: equation (2), equation (6).
LAWS = ('compensation', 'chattering')


@dataclasses.dataclass(frozen=True)
class ControllerConfig(Config):
    """Parameters of the laws (2) and (6) and of the filter (3)."""

    title: ClassVar[str] = 'controller'

    joint_names: tuple[str, ...] = parameter(
        'joint_names', 'str[]', ('joint1', 'joint2'),
        'Joints in the order of the model, of the gains and of the torques.', read_only=True)
    model: str = parameter(
        'model', 'str', 'two_link',
        'Robot model: M, C and G; two_link, urdf, or package.module:Class.', read_only=True)
    description: str = parameter(
        'description', 'str', '',
        "Model urdf: the robot's file, a path or package://NAME/PATH; empty for the topic "
        'robot_description.', read_only=True)
    locked: tuple[str, ...] = parameter(
        'locked', 'str[]', ('',),
        'Positions of its joints that are not in joint_names, each "name position"; 0 for those '
        'left out.', shape='any', read_only=True)
    gravity: float = parameter(
        'gravity', 'float', 9.81, 'Acceleration of gravity in G.', unit='m/s^2', minimum=0.0,
        read_only=True)
    law: str = parameter(
        'law', 'str', 'chattering',
        'Control law: equation (2), or (6) which adds the chattering term.', choices=LAWS)
    kp: tuple[float, ...] = parameter(
        'kp', 'float[]', 100.0, 'Position gain Kp.', unit='1/s^2', minimum=0.0, exclusive=True,
        shape='nn')
    kv: tuple[float, ...] = parameter(
        'kv', 'float[]', 50.0, 'Velocity gain Kv.', unit='1/s', minimum=0.0, exclusive=True,
        shape='nn')
    ka: tuple[float, ...] = parameter(
        'ka', 'float[]', 10.0, 'Chattering gain Ka; must exceed friction plus disturbance.',
        unit='N*m', minimum=0.0, shape='n')
    lambda_: float = parameter(
        'lambda', 'float', 10.0, 'Pole of the filter (3).', unit='1/s', minimum=0.0,
        exclusive=True)
    b: float = parameter(
        'b', 'float', 1.0, 'Gain of the filter (3); the paper has 1.', minimum=1e-3,
        maximum=1e3)
    switching: str = parameter(
        'switching', 'str', 'sign', 'How the chattering term is evaluated.', choices=SWITCHINGS)
    boundary_layer: float = parameter(
        'boundary_layer', 'float', 0.05, 'Switching boundary_layer: half its width.',
        unit='rad/s', minimum=0.0, exclusive=True)
    observer_bandwidth: float = parameter(
        'observer_bandwidth', 'float', 1200.0,
        'Switching implicit_observer: how fast the estimate of the perturbation follows; .inf '
        'for within one sample.', unit='rad/s', minimum=0.0, exclusive=True, infinite=True)
    input_delay: int = parameter(
        'input_delay', 'int', 0,
        'Known delay of the torque, in samples; the law predicts the state over it.', minimum=0,
        maximum=100, read_only=True)
    inertia_scale: float = parameter(
        'inertia_scale', 'float', 1.0, 'Factor on M and C, to study model errors.', minimum=0.0,
        exclusive=True, read_only=True)
    gravity_scale: float = parameter(
        'gravity_scale', 'float', 1.0, 'Factor on G, to study model errors.', minimum=0.0,
        read_only=True)
    effort_limit: tuple[float, ...] = parameter(
        'effort_limit', 'float[]', float('inf'),
        'Largest torque sent; .inf for what the description says, or unlimited.',
        unit='N*m', minimum=0.0, exclusive=True, infinite=True, shape='n')
    effort_rate_limit: tuple[float, ...] = parameter(
        'effort_rate_limit', 'float[]', float('inf'),
        'Fastest change of the torque sent, from 0 at the start; .inf for unlimited.',
        unit='N*m/s', minimum=0.0, exclusive=True, infinite=True, shape='n')
    anti_windup: bool = parameter(
        'anti_windup', 'bool', True,
        'Keep what the effort limits cut off the torque out of the filter (3).')
    error_limit: tuple[float, ...] = parameter(
        'error_limit', 'float[]', float('inf'),
        'Position error beyond which no torque is sent any more until ~/reset; .inf for never.',
        unit='rad', minimum=0.0, exclusive=True, infinite=True, shape='n')
    control_period: float = parameter(
        'control_period', 'float', 1e-3, 'Sample period h.', unit='s', minimum=0.0,
        exclusive=True, maximum=10.0, read_only=True)

    def validate(self) -> None:
        """Check the model's number of joints and the period."""
        check_model(self.model, self.joint_names)
        locked_positions(self.locked)
        period_ns(self.control_period)

    @property
    def described(self) -> bool:
        """Whether a description of the robot is needed."""
        return self.model == 'urdf'


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

    """

    def __init__(self, config: ControllerConfig, model: Model | None = None) -> None:
        self.model = model or model_of(config)
        own = self.model.effort_limits or (float('inf'),) * len(config.joint_names)
        self._own_limits = own
        if (config.inertia_scale, config.gravity_scale) != (1.0, 1.0):
            self.model = Scaled(self.model, config.inertia_scale, config.gravity_scale)
        n = len(config.joint_names)
        self.filter = ErrorFilter(n)
        self.observer = PerturbationObserver(n)
        self._none: Vector = (0.0,) * n
        self._drift: Vector = self._none
        #: Torques on their way, each with what the bound has cut off its chattering term, and
        #: what the effort limits have cut off the torque.
        self._sent: deque[tuple[Vector, Vector | None, Vector | None]] = deque()
        self._bumpless = self._limited = False
        #: Torque sent last.
        self._previous: Vector = self._none
        self._arrays = None
        if isinstance(self.model, ArrayModel) and not config.input_delay:
            self._arrays = ArrayStep(self.model, self.filter, self.observer)
            # In the place of the method: a call through would cost as much as an array product.
            self.step = self._arrays.step  # type: ignore[method-assign]
        self.configure(config)
        self.reset()

    def configure(self, config: ControllerConfig) -> None:
        """
        Use other gains or another law from the next step on.

        The filter state ξ lives on, so that v has no step (unless b itself changes) and only the
        chattering term comes or goes. The estimate of the perturbation lives on as well.
        """
        n = len(config.joint_names)
        self.config = config
        self._kp, self._kv = matrix(config.kp, n), matrix(config.kv, n)
        self._diagonal = None
        if all(not m[i][j] for m in (self._kp, self._kv)
               for i in range(n) for j in range(n) if i != j):
            self._diagonal = [(self._kp[i][i], self._kv[i][i]) for i in range(n)]
        self._effort_limit = [
            a if a < float('inf') else b for a, b in zip(config.effort_limit, self._own_limits)]
        self._limited = min((*self._effort_limit, *config.effort_rate_limit)) < float('inf')
        self._chattering = config.law == 'chattering'
        self._observing = self._chattering and config.switching == 'implicit_observer'
        self._cut: Vector | None = None
        self._period = seconds(period_ns(config.control_period))
        self._step_limit = [x * self._period for x in config.effort_rate_limit]
        self.filter.configure(config.lambda_, config.b, self._period)
        self.observer.configure(
            config.observer_bandwidth, self._period, config.b, config.ka)
        if self._arrays:
            self._arrays.configure(
                self._errors, self._explicit(), self._observing, config.ka, self._limits())

    def reset(self, bumpless: bool = False, held: Vector | None = None) -> None:
        """
        Begin anew: no estimate, no torque on its way, and ξ = 0.

        Parameters
        ----------
        bumpless : bool
            Begin with v = 0 instead, so that the first torque is the inverse dynamics alone.
        held : sequence of float, shape (n,), optional
            Torque that is still held, from which `effort_rate_limit` goes on; 0 if left out.

        """
        self.filter.reset()
        self.observer.reset()
        self._bumpless = bumpless
        self._previous = self._none if held is None else held
        self._sent = deque([(self._none, None, None)] * self.config.input_delay)
        if self._arrays:
            self._arrays.forget(bumpless, self._previous)

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
        model = self.model
        e, de, feedback = self._errors(q, dq, q_d, dq_d)
        if self._bumpless:
            self.filter.settle(de)
            self._bumpless = False
        v = self.filter.output(de)
        if self._observing:
            self.observer.learn(model, v)
        seen = (q, dq, ddq_d, feedback, v)
        if self._sent:
            q, dq, feedback, v = self._predict(q, dq, de, feedback, ahead)
            ddq_d = ahead[-1][2]
        inverse = model.inverse_dynamics(q, dq, [a + f for a, f in zip(ddq_d, feedback)])
        coriolis = model.coriolis_times(q, dq, v)
        if self._chattering:
            term = self._term(q, v, feedback, coriolis)
            tau: Vector = [i - c - s for i, c, s in zip(inverse, coriolis, term)]
        else:
            term = self._none
            tau = [i - c for i, c in zip(inverse, coriolis)]
        excess = None
        if self._limited:
            wanted, tau = tau, self._within_limits(tau, self._previous)
            if tau != wanted:
                excess = [w - t for w, t in zip(wanted, tau)]
        self._previous = tau
        if self._sent:
            self._sent.append((tau, self._cut, excess))
        self.filter.update(de, seen[3])
        lost = None
        applied = self._sent[0][2] if self._sent else excess
        if applied is not None and self.config.anti_windup:
            lost = self._lost(seen[0], seen[1], applied)
            self.filter.state = [x + y for x, y in zip(self.filter.state, lost)]
        if self._observing:
            self._expect(*seen, inverse if not self._sent else None, tau, lost)
        if self._sent:
            self._sent.popleft()
        return ListSample(tau, e, de, seen[4], inverse, coriolis, term, excess)

    def try_step(self, q: Vector, dq: Vector, q_d: Vector, dq_d: Vector, ddq_d: Vector,
                 ahead: Sequence[Point] = ()) -> Sample | None:
        """
        Return what `step` does; None where that leaves the range of numbers.

        The law must then be `reset`.
        """
        try:
            sample = self.step(q, dq, q_d, dq_d, ddq_d, ahead)
        except (ArithmeticError, ValueError):  # 1 / 0, sin(inf), a matrix with inf.
            return None
        return sample if isfinite(sum(sample.tau) + sum(sample.v)) else None

    def _within_limits(self, tau: Vector, previous: Vector) -> Vector:
        """Return what the limits leave of `tau` after the torque `previous`, (n,) [N·m]."""
        return [min(max(min(max(x, p - step), p + step), -limit), limit)
                for x, p, step, limit in zip(
                    tau, previous, self._step_limit, self._effort_limit)]

    def _lost(self, q: Vector, dq: Vector, excess: Vector) -> Vector:
        """
        Return what the torque that was cut off takes from v over a period, shape (n,) [rad/s].

        In the closed loop (8) it would act like a perturbation, b h M⁻¹ `excess`. Added to ξ, it
        leaves v as it would be without limits.
        """
        forward = self.model.forward_dynamics
        return self.filter.shift([
            a - b for a, b in zip(forward(q, dq, excess), forward(q, dq, self._none))])

    def _expect(self, q: Vector, dq: Vector, ddq_d: Vector, feedback: Vector, v: Vector,
                inverse: Vector | None, tau: Vector, lost: Vector | None) -> None:
        """Tell the observer what is applied from this sample on, and so what it should see."""
        cut, drift = self._cut, self._drift
        if inverse is None:  # The torque applied now is one sent earlier, for this state.
            inverse = self.model.inverse_dynamics(
                q, dq, [a + f for a, f in zip(ddq_d, feedback)])
            tau, cut, _ = self._sent[0]
            drift = self.filter.drift(v, feedback)
        if lost is not None:
            drift = [y + x for y, x in zip(drift, lost)]
        self.observer.expect(q, drift, [x - t for x, t in zip(inverse, tau)], cut)

    def _errors(self, q: Vector, dq: Vector, q_d: Vector, dq_d: Vector
                ) -> tuple[Vector, Vector, Vector]:
        """Return e, de and Kv de + Kp e, each of shape (n,)."""
        e = [a - b for a, b in zip(q_d, q)]
        de = [a - b for a, b in zip(dq_d, dq)]
        if self._diagonal:
            return e, de, [kv * d + kp * x for (kp, kv), x, d in zip(self._diagonal, e, de)]
        return e, de, [a + b for a, b in zip(times(self._kv, de), times(self._kp, e))]

    def _predict(self, q: Vector, dq: Vector, de: Vector, feedback: Vector,
                 ahead: Sequence[Point]) -> tuple[Vector, Vector, Vector, Vector]:
        """Return q, dq, Kv de + Kp e and v when the torque of this step arrives."""
        state = self.filter.state
        estimate = self.observer.estimate if self._observing else self._none
        for (tau, _, excess), (q_d, dq_d, _) in zip(self._sent, ahead):
            state = self.filter.advance(state, de, feedback)
            if excess is not None and self.config.anti_windup:
                state = [x + y for x, y in zip(state, self._lost(q, dq, excess))]
            q, dq = predict(
                self.model, q, dq, [t - p for t, p in zip(tau, estimate)], self._period)
            _, de, feedback = self._errors(q, dq, q_d, dq_d)
        return q, dq, feedback, self.filter.output(de, state)

    def _limits(self) -> Limits | None:
        """Return the limits of the torque; None without any."""
        if not self._limited:
            return None
        config = self.config
        within = self._effort_limit
        if min(config.effort_rate_limit) < float('inf'):
            within = [0.0] * len(within)  # What may be sent depends on what was sent last.
        return Limits(within, self._within_limits, config.anti_windup)

    def _explicit(self) -> Term | None:
        """Return what writes the chattering term as a function of v; None where it is implicit."""
        config = self.config
        if not self._chattering:
            return no_term
        if config.switching == 'sign':
            return sign_term(config.ka)
        if config.switching == 'boundary_layer':
            return boundary_layer_term(config.ka, config.boundary_layer)
        return None

    def _term(self, q: Vector, v: Vector, feedback: Vector, coriolis: Vector) -> Vector:
        """Return the chattering term, shape (n,) [N·m], within ±Ka."""
        config = self.config
        if config.switching == 'sign':
            return sign(v, config.ka)
        if config.switching == 'boundary_layer':
            return boundary_layer(v, config.ka, config.boundary_layer)
        scale = self.filter.scale
        self._drift = self.filter.drift(v, feedback)
        push = self.model.inertia_times(q, [y / scale for y in self._drift])
        if not self._observing:
            return implicit_term(
                self.model, q, [m - c for m, c in zip(push, coriolis)], config.ka)
        wanted = [m - c - p for m, c, p in zip(push, coriolis, self.observer.estimate)]
        term = implicit_term(self.model, q, wanted, config.ka)
        self._cut = None if term is wanted else [w - z for w, z in zip(wanted, term)]
        return term

    def lyapunov(self, q: Vector, v: Vector) -> float:
        """Return V = ½ vᵀ M(q) v of equation (9) [J]."""
        return 0.5 * dot(v, self.model.inertia_times(q, v))

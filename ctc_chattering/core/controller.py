"""The laws: computed torque plus compensation (2), and plus chattering (6)."""

from __future__ import annotations

import dataclasses
from typing import ClassVar, NamedTuple

from ctc_chattering.core.filter import ErrorFilter
from ctc_chattering.core.grid import period_ns, seconds
from ctc_chattering.core.model import dot, Model, times, Vector
from ctc_chattering.core.models import check_model, make_model, MODELS
from ctc_chattering.core.parameters import Config, matrix, parameter
from ctc_chattering.core.switching import sign, SWITCHINGS

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
        'model', 'str', 'two_link', 'Robot model: M, C and G.', choices=MODELS, read_only=True)
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
        'b', 'float', 1.0, 'Gain of the filter (3); the paper has 1.', minimum=0.0,
        exclusive=True)
    switching: str = parameter(
        'switching', 'str', 'sign', 'How the chattering term is evaluated.', choices=SWITCHINGS)
    effort_limit: tuple[float, ...] = parameter(
        'effort_limit', 'float[]', float('inf'), 'Largest torque sent; .inf for unlimited.',
        unit='N*m', minimum=0.0, exclusive=True, infinite=True, shape='n')
    control_period: float = parameter(
        'control_period', 'float', 1e-3, 'Sample period h.', unit='s', minimum=0.0,
        exclusive=True, read_only=True)

    def validate(self) -> None:
        """Check the model's number of joints and the period."""
        check_model(self.model, self.joint_names)
        period_ns(self.control_period)


class Sample(NamedTuple):
    """What one control step computed; every vector has shape (n,)."""

    #: Torque to send, within the effort limit [N·m].
    tau: Vector
    #: Position error e = q_d - q [rad].
    e: Vector
    #: Velocity error de = dq_d - dq [rad/s].
    de: Vector
    #: Filtered error [rad/s].
    v: Vector
    #: M [ddq_d + Kv de + Kp e] + C dq + G [N·m].
    inverse_dynamics: Vector
    #: C v, which both laws subtract [N·m].
    compensation: Vector
    #: Ka sgn(v), which law (6) subtracts; 0 under law (2) [N·m].
    chattering: Vector


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
        self.model = model or make_model(config.model, config.gravity)
        self.filter = ErrorFilter(len(config.joint_names))
        self.configure(config)

    def configure(self, config: ControllerConfig) -> None:
        """
        Use other gains or another law from the next step on.

        The filter state ξ lives on, so that v has no step (unless b itself changes) and only the
        chattering term comes or goes.
        """
        n = len(config.joint_names)
        self.config = config
        self._kp, self._kv = matrix(config.kp, n), matrix(config.kv, n)
        self._diagonal = None
        if all(not m[i][j] for m in (self._kp, self._kv)
               for i in range(n) for j in range(n) if i != j):
            self._diagonal = [(self._kp[i][i], self._kv[i][i]) for i in range(n)]
        self._limited = min(config.effort_limit) < float('inf')
        self._chattering = config.law == 'chattering'
        self._none = (0.0,) * n
        period = seconds(period_ns(config.control_period))
        self.filter.configure(config.lambda_, config.b, period)

    def step(self, q: Vector, dq: Vector, q_d: Vector, dq_d: Vector, ddq_d: Vector) -> Sample:
        """
        Return the torque for this sample, and what it is made of.

        Parameters
        ----------
        q, dq : sequence of float, shape (n,)
            Position [rad] and velocity [rad/s].
        q_d, dq_d, ddq_d : sequence of float, shape (n,)
            Desired position [rad], velocity [rad/s] and acceleration [rad/s²].

        """
        model = self.model
        e = [a - b for a, b in zip(q_d, q)]
        de = [a - b for a, b in zip(dq_d, dq)]
        if self._diagonal:
            feedback = [kv * d + kp * x for (kp, kv), x, d in zip(self._diagonal, e, de)]
        else:
            feedback = [a + b for a, b in zip(times(self._kv, de), times(self._kp, e))]
        v = self.filter.output(de)
        inverse = model.inverse_dynamics(q, dq, [a + f for a, f in zip(ddq_d, feedback)])
        coriolis = model.coriolis_times(q, dq, v)
        if self._chattering:
            chattering: Vector = sign(v, self.config.ka)
            tau = [i - c - s for i, c, s in zip(inverse, coriolis, chattering)]
        else:
            chattering = self._none
            tau = [i - c for i, c in zip(inverse, coriolis)]
        self.filter.update(de, feedback)
        if self._limited:
            tau = [min(max(x, -limit), limit) for x, limit in zip(tau, self.config.effort_limit)]
        return Sample(tau, e, de, v, inverse, coriolis, chattering)

    def lyapunov(self, q: Vector, v: Vector) -> float:
        """Return V = ½ vᵀ M(q) v of equation (9) [J]."""
        return 0.5 * dot(v, self.model.inertia_times(q, v))

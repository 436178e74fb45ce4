"""The controller: parameters of the laws (2) and (6), and one call of `step` per sample."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from math import inf, isfinite
from typing import ClassVar, NamedTuple

import numpy as np

from ctc_chattering.control.computed_torque import ComputedTorque
from ctc_chattering.control.delay_prediction import DelayPrediction
from ctc_chattering.control.error_filter import ErrorFilter
from ctc_chattering.control.limiter import Limiter
from ctc_chattering.control.perturbation_observer import PerturbationObserver
from ctc_chattering.control.switching import make_switching, Sign, SWITCHINGS
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import check_model, locked_positions, model_of
from ctc_chattering.dynamics.scaled_model import Scaled
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.time_grid import period_ns, seconds
from ctc_chattering.parameters import Config, matrix, parameter
from ctc_chattering.trajectory.buffer import Point

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
    #: M [ddq_d + Kv de + Kp e] + C dq + G [N·m].
    inverse_dynamics: Vector
    #: C v, which both laws subtract [N·m].
    compensation: Vector
    #: Ka sgn(v), however switched, which law (6) subtracts; 0 under law (2) [N·m].
    chattering: Vector
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
    observer : PerturbationObserver
        Of switching implicit_observer.

    """

    def __init__(self, config: ControllerConfig, model: Model | None = None) -> None:
        n = len(config.joint_names)
        self.model = model or model_of(config)
        self._model_limits = self.model.effort_limits or (inf,) * n
        if (config.inertia_scale, config.gravity_scale) != (1.0, 1.0):
            self.model = Scaled(self.model, config.inertia_scale, config.gravity_scale)
        self.filter, self.observer, self._limiter = (
            ErrorFilter(n), PerturbationObserver(n), Limiter(n))
        self._law = ComputedTorque(self.model, self.filter, self._limiter)
        self._loop = DelayPrediction(self._law, config.input_delay, n)
        self.configure(config)
        self.reset()

    def configure(self, config: ControllerConfig) -> None:
        """
        Use other gains or another law from the next step on.

        The filter state ξ is preserved, so that v has no step (unless b itself changes) and only
        the chattering term comes or goes. The estimate of the perturbation is preserved as well.
        """
        self.config = config
        n, period = len(config.joint_names), seconds(period_ns(config.control_period))
        ka, rate = np.array(config.ka), np.array(config.effort_rate_limit)
        effort = [a if a < inf else b for a, b in zip(config.effort_limit, self._model_limits)]
        self.filter.configure(config.lambda_, config.b, period)
        self.observer.configure(config.observer_bandwidth, period, config.b, ka)
        self._limiter.configure(np.array(effort), rate * period,
                                self.filter.scale if config.anti_windup else 0.0)
        self._loop.period = period
        self._law.kp, self._law.kv = np.array(matrix(config.kp, n)), np.array(matrix(config.kv, n))
        self._law.switching = make_switching(
            config.switching, ka, config.boundary_layer, self.filter, self.observer)
        if config.law == 'compensation':
            self._law.switching = Sign(np.zeros(n))  # Law (2) is law (6) with Ka = 0.

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
        self.filter.reset()
        self.observer.reset()
        self._bumpless = bumpless
        self._limiter.reset(np.zeros(self.model.n) if held is None else np.array(held))
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
        x, dx, x_d, dx_d, ddx_d = np.array((q, dq, q_d, dq_d, ddq_d), float)
        if self._bumpless:
            self.filter.initialize_bumpless(dx_d - dx)
            self._bumpless = False
        now, arrival, sent = self._loop.step(x, dx, x_d, dx_d, ddx_d, ahead)
        error = sent.saturation_error
        return Sample(
            sent.tau.tolist(), now.e.tolist(), now.de.tolist(), now.v.tolist(),
            arrival.inverse_dynamics.tolist(), arrival.compensation.tolist(),
            sent.chattering.tolist(), None if error is None else error.tolist())

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
        return 0.5 * float(np.array(v) @ np.array(self.model.mass_matrix(q)) @ np.array(v))

"""
The contract of a law: a torque for an evaluated state, and what the law remembers.

At every sample the control step calls `update` with the measured state, `terms` with the state in
which the torque will be applied (the same one without an input delay), and `advance` with the
measured state and the torque that is applied in it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, NamedTuple

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.error_filter import ErrorFilter
from ctc_chattering.control.feasible_reference import Desired
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class State(NamedTuple):
    """A state and a reference, with all that the laws need to know of them."""

    #: Position [rad] and velocity [rad/s].
    q: Array
    dq: Array
    #: Desired velocity [rad/s] and acceleration [rad/s²].
    dq_d: Array
    ddq_d: Array
    #: Errors [rad, rad/s].
    e: Array
    de: Array
    #: Kv de + Kp e [rad/s²].
    u: Array
    #: Filtered error [rad/s].
    v: Array
    #: M [kg·m²], C [kg·m²/s] and G [N·m].
    M: Array
    C: Array
    G: Array
    #: M (ddq_d + u) + C dq + G [N·m].
    N: Array


class Terms(NamedTuple):
    """What a torque is made of: nominal - compensation - robust, each of shape (n,) [N·m]."""

    #: What the model and the feedback ask for.
    nominal: Array
    #: C v of the paper's laws.
    compensation: Array
    #: What acts against the perturbation: chattering, integral, estimate.
    robust: Array
    #: What ±Ka has taken from the chattering term; None for nothing.
    clipping_error: Array | None = None


class Torque(NamedTuple):
    """A torque, and what is to be remembered of it until it is applied [N·m]."""

    #: Within the limits.
    tau: Array
    terms: Terms
    #: What the limits have taken from the torque; None for nothing.
    saturation_error: Array | None
    #: Torque of the law alone less `tau`, which the filter does not see; None for nothing.
    excess: Array | None


class Law(ABC):
    """
    A control law with its integrators and estimates.

    Parameters
    ----------
    filter_ : ErrorFilter
        The filter (3) of the control step, which advances it.

    """

    #: The robust term in symbols, for figures; empty for a law without one.
    symbol: ClassVar[str] = ''
    #: Whether it is law (2) or (6), and whether the filtered error v acts in it.
    of_the_paper: ClassVar[bool] = False
    acts_on_v: ClassVar[bool] = False
    #: Whether the delay prediction takes its estimate for what acts until the torque arrives.
    predicts: ClassVar[bool] = True
    #: Whether it predicts the state in which a torque arrives by itself, in `foresee`.
    foresees: ClassVar[bool] = False

    def __init__(self, filter_: ErrorFilter) -> None:
        self.filter = filter_
        #: For terms that a law does not have.
        self.zero: Array = np.zeros_like(filter_.state)

    @abstractmethod
    def configure(self, config: ControllerConfig, period: float) -> None:
        """Use other gains, with the sample period [s]; integrators and estimates are preserved."""

    def reset(self) -> None:  # noqa: B027 - for laws that remember something
        """Forget integrators and estimates."""

    def initialize(self, now: State, estimate: Array | None) -> None:  # noqa: B027
        """
        Take over from another law, before the first sample.

        Parameters
        ----------
        now : State
            The measured state.
        estimate : array, shape (n,), or None
            Perturbation as the other law estimates it [N·m].

        """

    def suspend(self) -> None:  # noqa: B027
        """Note that another law has taken over."""

    def observe(self, q: Array, dq: Array, held: Array) -> tuple[Array, Array]:
        """
        Return position and velocity as the law takes them, before all else of a sample.

        Parameters
        ----------
        q, dq : array, shape (n,)
            Measured [rad, rad/s].
        held : array, shape (n,)
            Torque that was sent last [N·m].

        """
        del held
        return q, dq

    def foresee(self, now: State, coming: Sequence[Array], points: Sequence[Desired],
                model: Model) -> None:
        """
        Predict the state in which the torque of this sample arrives, if the law does so itself.

        Parameters
        ----------
        now : State
            As observed.
        coming : sequence of array, shape (n,)
            Torques in transit, the next one first [N·m].
        points : sequence of Desired
            The reference now and when each of the torques after the first one arrives.
        model : Model
            M, C and G.

        """
        raise NotImplementedError

    def update(self, now: State) -> None:  # noqa: B027
        """Improve the estimate by what the measured state has become."""

    @abstractmethod
    def terms(self, at: State) -> Terms:
        """Return the terms of the torque for a state; called once a sample."""

    def advance(self, now: State, applied: Torque, correction: Array | None) -> None:  # noqa: B027
        """
        Advance integrators and observers by a period.

        Parameters
        ----------
        now : State
            The measured state.
        applied : Torque
            Held over the period that begins.
        correction : array, shape (n,), or None
            What anti-windup adds to v: b h M⁻¹ times the excess [rad/s].

        """

    def estimate(self, now: State) -> Array | None:
        """Return the estimate of the perturbation P, shape (n,) [N·m]; None without one."""
        del now
        return None


def free_inertia(mass: Array) -> Array:
    """Return D = 1 / (M⁻¹)_ii, what each joint has of inertia while the others are free, (n,)."""
    inertia: Array = 1.0 / np.asarray(np.linalg.inv(mass), float).diagonal()
    return inertia

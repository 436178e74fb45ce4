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
The interface of a control law, and the decorator that marks one.

A law is a NamedTuple of its gains. What it remembers from sample to sample is another one, its
memory. Its methods are pure: a memory goes in, and comes out as it is afterwards. `Controller`
builds the law from a configuration, and `control/step.py` calls it at every sample::

    memory, measured = corrected(memory, q, dq, held)    the state as the law takes it
    memory = updated(memory, now)                        the estimate, from the evaluated state
    terms, memory = answer(memory, now, context)         the terms of the torque
    memory = advanced(memory, now, applied)              the prediction of the next sample

Only `terms` has no default. Numbers are floats, truth values 1.0 and 0.0, and no method has the
name of a field, so that both can be compiled.
"""

from __future__ import annotations

from collections.abc import Callable
import inspect
from math import inf
from typing import Any, NamedTuple, TypeVar

from ctc_chattering.compiled.compilable import function, record
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.delay import predict_arrival
from ctc_chattering.control.laws.registry import COMMON_GAINS, LAWS
from ctc_chattering.control.recommended_gains import GainRule
from ctc_chattering.control.sample import (
    Applied,
    Context,
    evaluate_state,
    LastSample,
    MeasuredState,
    predict_state,
    State,
    Terms,
)
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import accept_old_name, Parameter
import numpy as np

T = TypeVar('T')


@record
class Nothing(NamedTuple):
    """
    Memory of a law that remembers nothing.

    A record needs a field.
    """

    nothing: float = 0.0


class Estimator:
    """
    Interface of a perturbation estimator. The default estimates nothing.

    Laws and the switchings of law (6) have it.
    """

    #: Whether `estimate` is one. It is set where a class defines `estimate`.
    estimates = False

    def with_gains(self, kp: Array, kv: Array, ka: Array) -> Any:
        """
        Return a copy with other gains.

        The default depends on none of them.

        Parameters
        ----------
        kp, kv : array, shape (n, n)
            Kp [1/s²] and Kv [1/s].
        ka : array, shape (n,)
            Ka [N·m].

        """
        return self

    def updated(self, memory: T, now: State) -> T:
        """Return the memory, corrected with the measured state."""
        return memory

    def advanced(self, memory: T, now: State, applied: Applied) -> T:
        """
        Return the memory a period later.

        Parameters
        ----------
        memory
            After `answer`.
        now : State
            Measured at the sample.
        applied : Applied
            Torque that is held over the period.

        """
        return memory

    def estimate(self, memory: Any, now: State) -> Array:
        """Return the estimate of P, shape (n,) [N·m]."""
        return now.zero


class Stability(NamedTuple):
    """
    A law's report on its own loop.

    By default nothing is wrong.
    """

    #: Fraction of the configured bandwidth in use, s of (OG1).
    bandwidth: float = 1.0
    #: Time for which the feedback oscillated at the least bandwidth [s].
    strained: float = 0.0
    #: Duration of a limit cycle [s], its joint and its frequency [Hz].
    cycling: float = 0.0
    joint: int = 0
    frequency: float = 0.0


class Law(Estimator):
    """
    Base class of control laws, with defaults.

    A NamedTuple has no base class, so `law` copies what a law does not define. The attributes are
    its traits, which the rest of the package asks for. `law` sets them.
    """

    #: Robust term in symbols, for figures; empty for a law without one.
    symbol = ''
    #: Whether it is law (2) or (6).
    of_the_paper = False
    #: Whether the filtered error v acts in it.
    acts_on_v = False
    #: Parameters of `ControllerConfig` that it takes, besides those of all laws; None for all.
    parameters: tuple[str, ...] | None = None
    #: Whether an error that grows ends the torques where `error_limit` is not set, (TR1).
    is_watched = False
    #: Whether its estimate has a bound. Without one it grows where drives lose torque.
    is_bounded = True
    #: Rule of its recommended gains; None for a law without one.
    gain_rule: GainRule | None = None

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> Law:
        """Return the law of a configuration and period [s]."""
        return cls()

    @classmethod
    def largest_ki(cls, config: ControllerConfig) -> Array:
        """
        Return Ki at which the loop becomes unstable.

        Its shape is (n,) [1/s³].
        """
        return np.full(len(config.joint_names), inf)

    def initial(self) -> Any:
        """Return the memory at the start."""
        return Nothing()

    def reconfigured(self, memory: T) -> T:
        """Return the memory after a change of gains."""
        return memory

    def initialized(self, now: State, estimate: Array) -> Any:
        """
        Return the memory that takes over from another law.

        This is before the first sample.

        After a law that estimates nothing, `initial` is used instead.

        Parameters
        ----------
        now : State
            Measured.
        estimate : array, shape (n,)
            Perturbation as the other law estimates it [N·m].

        """
        return self.initial()

    def predicted_state(self, memory: Any, last: LastSample, context: Context
                        ) -> tuple[Array, Array]:
        """
        Return the next q and dq [rad, rad/s].

        Parameters
        ----------
        memory
            After the last sample.
        last : LastSample
            That sample.
        context : Context
            Of the sample to come.

        """
        return next_state(self, memory, last, context)

    def corrected(self, memory: T, q: Array, dq: Array, held: Array) -> tuple[T, MeasuredState]:
        """
        Return the memory, and the law's own state.

        Parameters
        ----------
        memory
            After the last sample.
        q, dq : array, shape (n,)
            Measured [rad, rad/s].
        held : array, shape (n,)
            Torque that was sent last [N·m].

        """
        return memory, MeasuredState(q, dq)

    def answer(self, memory: T, now: State, context: Context) -> tuple[Terms, T]:
        """
        Return the terms of a sample's torque, and the memory.

        Parameters
        ----------
        memory
            After `updated`.
        now : State
            Measured.
        context : Context
            Of the sample.

        """
        return self.terms(memory, predict_arrival(self, memory, now, context))

    def terms(self, memory: T, state: State) -> tuple[Terms, T]:
        """
        Return the terms for a state, and the memory.

        In this state the torque arrives.
        """
        raise NotImplementedError

    def acting(self, memory: Any, now: State) -> Array:
        """Return P for the delay prediction [N·m]."""
        return self.estimate(memory, now)

    def stability(self, memory: Any) -> Stability:
        """Return the report on the loop."""
        return Stability()


@function
def next_state(law: Any, memory: Any, last: LastSample, context: Context) -> tuple[Array, Array]:
    """
    Return the next q and dq by the model.

    The torque and P are those of the last sample.
    """
    settings = context.settings
    model = context.models.now
    desired = context.reference_at(0)
    state = evaluate_state(settings, model, last.q, last.dq, desired, context.memory.xi)
    torque = last.applied - law.acting(memory, state)
    return predict_state(model, state, torque, settings.period)


@function
def observed_state(law: Any, memory: Any, last: LastSample, context: Context, q: Array, dq: Array
                   ) -> tuple[Array, Array]:
    """
    Return q and dq as an observer predicted them.

    At the first sample it is `next_state`.
    """
    if memory.has_sample == 0.0:
        return next_state(law, memory, last, context)
    return q, dq


def law(symbol: str = '', of_the_paper: bool = False, acts_on_v: bool = False, *,
        parameters: tuple[str, ...] | None = None, is_watched: bool = False,
        is_bounded: bool = True, gain_rule: GainRule | None = None
        ) -> Callable[[type[T]], type[T]]:
    """
    Mark a law of your own.

    A law is a NamedTuple of its gains. This is a decorator with arguments.

    It returns the class with the methods of `Law` that it lacks. The parameter ``law`` takes the
    class itself, or its name ``package.module:Name``, which nodes need. The arguments are the
    traits of `Law`; a law that declares them is treated as those of the package.

    Parameters
    ----------
    symbol : str
        The robust term in symbols, for figures; empty for a law without one.
    of_the_paper, acts_on_v : bool
        Whether it is law (2) or (6), and whether the filtered error v acts in it.
    parameters : tuple of str, optional
        Names of the parameters of `ControllerConfig` that it takes, besides those that all laws
        take, such as kp and kv. These alone are shown, and searched by `tune`. By default it
        takes all, and `tune` searches kp and kv.
    is_watched : bool
        Whether a position error that has grown by 1 rad ends the torques where ``error_limit`` is
        not set.
    is_bounded : bool
        Whether its estimate of the perturbation has a bound. If not, a warning says so where
        drives may lose torque.
    gain_rule : GainRule, optional
        Rule by which gains are recommended for it.

    Examples
    --------
    >>> from typing import NamedTuple
    >>> from ctc_chattering import Controller, ControllerConfig, law, record, State, Terms
    >>> @law(parameters=())
    ... class Pd(NamedTuple):
    ...     nothing: float = 0.0
    ...     def terms(self, memory, state):
    ...         return Terms(state.u + state.G, state.zero, state.zero, state.zero), memory
    >>> config = ControllerConfig().changed({'law': Pd})
    >>> config.law.endswith(':Pd')
    True

    """
    def mark(unmarked: type[T]) -> type[T]:
        marked: Any = with_defaults(unmarked, Law)
        marked.symbol = symbol
        marked.of_the_paper = of_the_paper
        marked.acts_on_v = acts_on_v
        marked.parameters = parameters
        marked.is_watched = is_watched
        marked.is_bounded = is_bounded
        marked.gain_rule = gain_rule
        return unmarked
    return mark


def with_defaults(marked: type[T], defaults: type) -> type[T]:
    """
    Return a class as a record, with defaults.

    It gets the attributes of `defaults` that it lacks.
    """
    accept_old_name(marked, 'made', 'from_config')
    if 'estimate' in vars(marked) and 'estimates' not in vars(marked):
        setattr(marked, 'estimates', True)  # noqa: B010
    for name in dir(defaults):
        if not name.startswith('__') and name not in vars(marked):
            setattr(marked, name, inspect.getattr_static(defaults, name))
    return record(marked)


def laws() -> dict[str, tuple[Parameter, ...]]:
    """
    Return the laws by name, with their parameters.

    They are those of `ControllerConfig`.

    Returns
    -------
    dict of str to tuple of Parameter
        Each with ``name``, ``default``, ``unit``, ``description`` and ``allowed``. A law of your
        own (`law`) takes those that it declares, or all.

    Examples
    --------
    >>> from ctc_chattering import laws
    >>> for x in laws()['super_twisting']:
    ...     print(f'{x.name} {x.default} {x.unit}'.strip())
    kp 100.0 1/s^2
    kv 50.0 1/s
    lambda 10.0 1/s
    b 1.0
    super_twisting_k1 60.0 sqrt(rad/s^3)
    super_twisting_k2 2000.0 rad/s^3
    anti_windup True

    """
    parameters_by_law = {}
    for law in LAWS:
        parameters_by_law[law] = tuple(
            spec for spec in ControllerConfig.parameters().values()
            if spec.name in COMMON_GAINS or law in spec.laws)
    return parameters_by_law

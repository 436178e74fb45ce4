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
The contract of a law: a torque for an evaluated state, and what the law remembers.

A law is a NamedTuple of its gains, marked by `law`; what it remembers is another one. Its methods
are pure: a memory goes in, and comes out as it is afterwards. At every sample the control step
calls `corrected`, `updated`, `answer` and `advanced`, in this order. `terms` is all that a law
must have; the rest is as in `Law` unless it says otherwise. Numbers are floats, 1.0 and 0.0 for
truth, and no method has the name of a field: both can then be compiled.
"""

from __future__ import annotations

from collections.abc import Callable
import inspect
from typing import Any, cast, NamedTuple, TypeVar

from ctc_chattering.compiled.compilable import function, record, RECORDS
from ctc_chattering.control.controller_config import ControllerConfig, LAWS
from ctc_chattering.control.delay import predict_arrival
from ctc_chattering.control.sample import (
    Applied,
    Context,
    evaluate_state,
    LastSample,
    predict_state,
    State,
    Terms,
)
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import accept_old_name, named_class, Parameter

T = TypeVar('T')


@record
class Nothing(NamedTuple):
    """The memory of a law without one; a record has a field."""

    nothing: float = 0.0


class Estimator:
    """What law and switching have for an estimate of the perturbation; by default, none."""

    #: Whether there is one.
    estimates = False

    def with_gains(self, kp: Array, kv: Array, ka: Array) -> Any:
        """
        Return the same with other gains; by default none of its numbers depends on them.

        Parameters
        ----------
        kp, kv : array, shape (n, n)
            Kp [1/s²] and Kv [1/s].
        ka : array, shape (n,)
            Ka [N·m].

        """
        return self

    def updated(self, memory: T, now: State) -> T:
        """Return the memory improved by what the measured state has become."""
        return memory

    def advanced(self, memory: T, now: State, applied: Applied) -> T:
        """
        Return the memory a period later.

        Parameters
        ----------
        memory
            After `answer`.
        now : State
            The measured state.
        applied : Applied
            Held over the period that begins.

        """
        return memory

    def estimate(self, memory: Any, now: State) -> Array:
        """Return the estimate of the perturbation P, shape (n,) [N·m]; 0 for none."""
        return now.zero


class Stability(NamedTuple):
    """What a law says of its own loop; by default, that nothing is wrong."""

    #: The part of its bandwidth in use, and for how long its feedback was too strong with it [s].
    bandwidth: float = 1.0
    strained: float = 0.0
    #: How long there has been a limit cycle [s], of which joint, and its frequency [Hz].
    cycling: float = 0.0
    joint: int = 0
    frequency: float = 0.0


class Law(Estimator):
    """
    What a law has, and what it is where a law does not say.

    A law is no subclass, since a NamedTuple has no base: `law` gives it what it lacks.
    """

    #: The robust term in symbols, for figures; empty for a law without one.
    symbol = ''
    #: Whether it is law (2) or (6), and whether the filtered error v acts in it.
    of_the_paper = False
    acts_on_v = False

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> Law:
        """Return the law of a configuration, with the sample period [s]; by default no gains."""
        return cls()

    def initial(self) -> Any:
        """Return the memory at the start."""
        return Nothing()

    def reconfigured(self, memory: T) -> T:
        """Return the memory that goes on after the same law with other gains."""
        return memory

    def initialized(self, now: State, estimate: Array) -> Any:
        """
        Return the memory that takes over from another law, before the first sample.

        Parameters
        ----------
        now : State
            The measured state.
        estimate : array, shape (n,)
            Perturbation as the other law estimates it [N·m]. After one that estimates none, the
            memory is `initial`.

        """
        return self.initial()

    def predicted_state(self, memory: Any, last: LastSample, context: Context
                        ) -> tuple[Array, Array]:
        """
        Return the q and dq to be measured next, shape (n,) [rad, rad/s].

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

    def corrected(self, memory: T, q: Array, dq: Array, held: Array) -> tuple[T, Array, Array]:
        """
        Return memory, position and velocity as the law takes them.

        Parameters
        ----------
        memory
            After the last sample.
        q, dq : array, shape (n,)
            Measured [rad, rad/s].
        held : array, shape (n,)
            Torque that was sent last [N·m].

        """
        return memory, q, dq

    def answer(self, memory: T, now: State, context: Context) -> tuple[Terms, T]:
        """
        Return the terms of the torque of a sample, and the memory: `terms` at `predict_arrival`.

        Parameters
        ----------
        memory
            After `updated`.
        now : State
            The measured state.
        context : Context
            Of the sample.

        """
        return self.terms(memory, predict_arrival(self, memory, now, context))

    def terms(self, memory: T, at: State) -> tuple[Terms, T]:
        """Return the terms of the torque for a state, and the memory; every law has its own."""
        raise NotImplementedError

    def acting(self, memory: Any, now: State) -> Array:
        """Return what the delay prediction takes for P."""
        return self.estimate(memory, now)

    def stability(self, memory: Any) -> Stability:
        """Return how the loop is doing."""
        return Stability()


@function
def next_state(law: Any, memory: Any, last: LastSample, context: Context) -> tuple[Array, Array]:
    """Return `Law.predicted_state` by the model, with the torque and P of the last sample."""
    settings, model = context.settings, context.models.now
    at = evaluate_state(settings, model, last.q, last.dq, context.points, 0, context.memory.xi)
    return predict_state(model, at, last.applied - law.acting(memory, at), settings.period)


@function
def observed_state(law: Any, memory: Any, last: LastSample, context: Context, q: Array, dq: Array
                   ) -> tuple[Array, Array]:
    """Return q and dq as an observer has predicted them; at first, `next_state`."""
    if memory.known == 0.0:
        return next_state(law, memory, last, context)
    return q, dq


def law(symbol: str = '', of_the_paper: bool = False, acts_on_v: bool = False
        ) -> Callable[[type[T]], type[T]]:
    """
    Mark a law of your own, a NamedTuple of its gains; a decorator with arguments.

    It returns the class with the methods of `Law` that it lacks. The parameter ``law`` takes the
    class itself, or its name ``package.module:Name``, which nodes need.

    Parameters
    ----------
    symbol : str
        The robust term in symbols, for figures; empty for a law without one.
    of_the_paper, acts_on_v : bool
        Whether it is law (2) or (6), and whether the filtered error v acts in it.

    Examples
    --------
    >>> from typing import NamedTuple
    >>> from ctc_chattering import Controller, ControllerConfig, law, record, State, Terms
    >>> @law()
    ... class Pd(NamedTuple):
    ...     nothing: float = 0.0
    ...     def terms(self, memory, at):
    ...         return Terms(at.u + at.G, at.zero, at.zero, at.zero), memory
    >>> config = ControllerConfig().changed({'law': Pd})
    >>> config.law.endswith(':Pd')
    True

    """
    def marked(kind: type[T]) -> type[T]:
        made: Any = with_defaults(kind, Law)
        made.symbol, made.of_the_paper, made.acts_on_v = symbol, of_the_paper, acts_on_v
        return kind
    return marked


def with_defaults(kind: type[T], defaults: type) -> type[T]:
    """Return a class, marked as a record, with what it lacks of a class of defaults."""
    accept_old_name(kind, 'made', 'from_config')
    if 'estimate' in vars(kind) and 'estimates' not in vars(kind):
        setattr(kind, 'estimates', True)  # noqa: B010
    for name in dir(defaults):
        if not name.startswith('__') and name not in vars(kind):
            setattr(kind, name, inspect.getattr_static(defaults, name))
    return record(kind)


def class_name(name: str) -> str:
    """Return the name of the class that a name in a parameter file stands for."""
    return name.title().replace('_', '')


def law_class(name: str) -> type[Law]:
    """Return the class of a law: one of `LAWS`, or ``package.module:Name``."""
    own = name if ':' in name else f'ctc_chattering.control.laws.{name}:{class_name(name)}'
    return cast('type[Law]', named_class(
        'law', own, lambda x: x in RECORDS and hasattr(x, 'answer'), 'class marked by @law'))


def laws() -> dict[str, tuple[Parameter, ...]]:
    """
    Return the laws by name, with the parameters of `ControllerConfig` that are theirs.

    Returns
    -------
    dict of str to tuple of Parameter
        Each with ``name``, ``default``, ``unit``, ``description`` and ``allowed``. A law of your
        own (`law`) takes them all.

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
    known = ControllerConfig.parameters().values()
    return {name: tuple(x for x in known if x.name in ('kp', 'kv') or name in x.laws)
            for name in LAWS}

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
The contract of a switching: a way to evaluate the chattering term z of law (6).

A switching is a NamedTuple of its gains, marked by `switching`, as a law is (`laws.base`). Its
one method is `term`. Those that estimate the perturbation have `updated`, `advanced` and
`estimate` as well; the memory of law (6) is theirs.
"""

from __future__ import annotations

from typing import cast, Protocol, TypeVar

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.evaluation import State
from ctc_chattering.control.laws.base import Applied, with_defaults
from ctc_chattering.control.perturbation_observer import Perturbation
from ctc_chattering.numerics.compilable import RECORDS
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import named_class

T = TypeVar('T')


class Switching(Protocol):
    """What a switching has; all but `made` and `term` as `laws.base.Law` has it."""

    estimates: bool

    @classmethod
    def made(cls, config: ControllerConfig, period: float) -> Switching:
        """Return the switching of a configuration, with the sample period [s]."""

    def term(self, memory: Perturbation, at: State, compensation: Array) -> tuple[Array, Array]:
        """
        Return z, and what ±Ka has taken from it, each of shape (n,) [N·m]; |z| is within Ka.

        Parameters
        ----------
        memory : Perturbation
            With the estimate P̂.
        at : State
            In which the torque is applied.
        compensation : array, shape (n,)
            C v [N·m].

        """

    def updated(self, memory: Perturbation, now: State) -> Perturbation:
        """Return the memory improved by what the measured state has become."""

    def advanced(self, memory: Perturbation, now: State, applied: Applied, correction: Array
                 ) -> Perturbation:
        """Return the memory a period later."""

    def estimate(self, memory: Perturbation, now: State) -> Array:
        """Return P̂; 0 for none."""


def switching(kind: type[T]) -> type[T]:
    """
    Mark a switching of your own for law (6), a NamedTuple of its gains.

    It returns the class with the methods of `Switching` that it lacks; all that it must have are
    ``made`` and ``term``. The parameter ``switching`` takes the class itself, or its name
    ``package.module:Name``.

    Parameters
    ----------
    kind : type
        The class.

    """
    return with_defaults(kind, {})


def switching_class(name: str) -> type[Switching]:
    """Return the class of a switching: one of `SWITCHINGS`, or ``package.module:Name``."""
    own = name if ':' in name else f'ctc_chattering.control.switching.{name}:SWITCHING'
    return cast('type[Switching]', named_class(
        'switching', own, lambda x: x in RECORDS and hasattr(x, 'term'),
        'class marked by @switching'))

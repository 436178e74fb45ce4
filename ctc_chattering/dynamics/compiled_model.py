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
Compiled counterpart of Model: M, C and G.

`CompiledArm` holds the numbers and machine code of one arm, a tree of bodies or the two-link arm.
Compiled control steps and plants call it through `EvaluatedModel` and `CompiledModel`. The numbers
come from `arm_of`.
"""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import function, record, solve
from ctc_chattering.compiled.machine_code import argument_addresses, Callee, Code, invoke
from ctc_chattering.compiled.records import packed, record_of, value, write
from ctc_chattering.dynamics import tree, two_link
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.tree import Arm
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@dataclasses.dataclass
class TwoLinkArm:
    """Numbers of the two-link arm, which is in closed form."""

    #: Acceleration of gravity, downwards [m/s²].
    gravity: float
    #: Factor of M, C and G.
    scale: float


#: Numbers of a model that can be machine code.
ArmNumbers = Arm | TwoLinkArm


def arm_of(model: Model, inertia_scale: float = 1.0, gravity_scale: float = 1.0
           ) -> ArmNumbers | None:
    """
    Return the numbers of a `TwoLink` or `UrdfModel`, or None.

    Parameters
    ----------
    model : Model
        Model of the arm.
    inertia_scale : float
        Factor of M and C.
    gravity_scale : float
        Factor of G.

    """
    gravity_ratio = gravity_scale / inertia_scale
    if type(model) is TwoLink:
        return TwoLinkArm(gravity_ratio * model.gravity, inertia_scale)
    if type(model) is not UrdfModel:
        return None
    arm = model.bodies
    return dataclasses.replace(
        arm,
        gravity=gravity_ratio * model.gravity,
        mass=inertia_scale * arm.mass,
        inertia=inertia_scale * arm.inertia,
        rotor=inertia_scale * arm.rotor,
    )


@record
class StateTerms(NamedTuple):
    """M, C and G at a state, with their call."""

    #: Address of `set_terms`, and that of the addresses of its arguments.
    function: int  # noqa: A003
    arguments: int
    #: Arrays of shape (n,) and (n, n).
    q: Array
    dq: Array
    M: Array
    C: Array
    G: Array


@record
class CompiledModel(NamedTuple):
    """The model of the plant: `set_mass_and_bias` and its scratch."""

    call: Any
    body: Any

    def mass_and_bias(self, q: Any, dq: Any) -> Any:
        """Return M and C dq + G. The next call changes M."""
        body = self.body
        write(body.q, q)
        write(body.dq, dq)
        invoke(self.call.function, self.call.arguments)
        return value(body.M), value(body.bias)


@record
class EvaluatedModel(NamedTuple):
    """The model of the control step, with its own terms."""

    model: CompiledModel
    state_terms: Any

    def evaluate(self, q: Any, dq: Any) -> Any:
        """Return M, C and G. The next call changes them."""
        terms = self.state_terms
        write(terms.q, q)
        write(terms.dq, dq)
        invoke(terms.function, terms.arguments)
        return value(terms.M), value(terms.C), value(terms.G)

    def forward(self, q: Any, dq: Any, u: Any) -> Any:
        """Return ddq, as `Model.forward`."""
        M, bias = self.model.mass_and_bias(q, dq)
        return solve(M, u - bias)


def _empty_terms(n: int) -> Any:
    """Return a `StateTerms` for `n` joints."""
    zero = np.zeros(n)
    square = np.zeros((n, n))
    return packed(StateTerms(0, 0, zero, zero, square, square, zero))


class Call(NamedTuple):
    """A function that compiled code calls by its address."""

    #: NumPy record with the addresses.
    record: Any
    code: Code
    arguments: tuple[Any, ...]
    #: Addresses of the arguments.
    addresses: Any


class CompiledArm:
    """
    Machine code of an arm, for all laws and the plant.

    Parameters
    ----------
    arm : ArmNumbers
        Numbers of the model.
    n : int
        Number of joints.

    Attributes
    ----------
    codes : tuple of Code
        Functions that must be compiled.
    model : CompiledModel
        The model in compiled functions.
    calls : list of Call
        Calls of the functions so far.

    """

    def __init__(self, arm: ArmNumbers, n: int) -> None:
        self._n = n
        self._arm = record_of(arm)
        body = record_of(tree.BodyScratch(n))
        call = packed(Callee(0, 0))
        self.model = CompiledModel(call, body)
        set_terms, set_mass_and_bias = ARM_FUNCTIONS[type(arm)]
        self._set_terms = Code(set_terms, (self._arm, body, _empty_terms(n)), f'dynamics-{n}')
        set_mass = Code(set_mass_and_bias, (self._arm, body), f'mass-{n}')
        self.codes = self._set_terms, set_mass
        self.calls: list[Call] = []
        self._add_call(call, set_mass, (self._arm, body))

    def fill(self, arm: ArmNumbers) -> None:
        """Take the numbers of another arm."""
        self._arm.base[0] = tuple(vars(arm).values())

    def _add_call(self, addresses: Any, code: Code, arguments: tuple[Any, ...]) -> None:
        """Set the addresses by which compiled code calls a function."""
        call = Call(addresses, code, arguments, argument_addresses(arguments))
        self.calls.append(call)
        if code.compiled:
            addresses['function'] = code.address()
            addresses['arguments'] = call.addresses.ctypes.data

    def add_terms(self) -> Any:
        """Return a `StateTerms` whose call is set."""
        terms = _empty_terms(self._n)
        self._add_call(terms, self._set_terms, (self._arm, self.model.body, terms))
        return terms


@function
def set_two_link_terms(arm: Any, _body: Any, terms: Any) -> int:
    """Set M, C and G of a `StateTerms`."""
    evaluate_two_link(arm, terms.q, terms.dq, terms.M, terms.C, terms.G)
    return 0


@function
def set_two_link_mass_and_bias(arm: Any, s: Any) -> int:
    """Set M and C dq + G of a scratch."""
    evaluate_two_link(arm, s.q, s.dq, s.M, s.C, s.bias)
    C = s.C
    v1 = s.dq[0]
    v2 = s.dq[1]
    for i in range(2):
        torque = C[i, 0] * v1 + C[i, 1] * v2
        s.bias[i] += torque
    return 0


@function
def evaluate_two_link(arm: Any, q: Any, dq: Any, M: Any, C: Any, G: Any) -> None:
    """Set M, C and G of the two-link arm at a state."""
    t = two_link.terms(arm.gravity, q)
    scale = arm.scale
    M[0, 0] = scale * t.m11
    M[0, 1] = M[1, 0] = scale * t.m12
    M[1, 1] = scale * t.m22
    k = scale * t.coupling
    C[0, 0] = -k * dq[1]
    C[0, 1] = -k * (dq[0] + dq[1])
    C[1, 0] = k * dq[0]
    C[1, 1] = 0.0
    G[0] = scale * t.g1
    G[1] = scale * t.g2


#: Functions of a `CompiledArm` by its numbers: terms for the control step, and for the plant.
ARM_FUNCTIONS: dict[type, tuple[Callable[..., int], Callable[..., int]]] = {
    Arm: (tree.set_terms, tree.set_mass_and_bias),
    TwoLinkArm: (set_two_link_terms, set_two_link_mass_and_bias),
}

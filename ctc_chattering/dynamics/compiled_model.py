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

"""What compiled code has in the place of a `Model`: the terms of (1) of either kind of arm."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import function, record, solve
from ctc_chattering.compiled.machine_code import argument_addresses, Code, invoke
from ctc_chattering.compiled.records import numpy_record, packed, record_of, value, write
from ctc_chattering.dynamics import tree, two_link
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import Arm as Arm
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


def arm_of(model: Model, inertia_scale: float = 1.0, gravity_scale: float = 1.0) -> Arm | None:
    """
    Return the numbers of a `TwoLink` or `UrdfModel`; None for another model.

    Parameters
    ----------
    model : Model
        Whose numbers they are.
    inertia_scale, gravity_scale : float
        Factors of M and C, and of G.

    """
    c, ratio = inertia_scale, gravity_scale / inertia_scale
    if type(model) is UrdfModel:
        arm = model.bodies
        return dataclasses.replace(
            arm, gravity=ratio * model.gravity, mass=c * arm.mass, inertia=c * arm.inertia,
            rotor=c * arm.rotor)
    if type(model) is not TwoLink:
        return None
    none, row, square = np.zeros(model.n), np.zeros((model.n, 3)), np.zeros((model.n, 3, 3))
    return Arm(True, ratio * model.gravity, c, none.astype(np.int64), none.astype(np.bool_),
               none.astype(np.int64), square, row, none, row, square, none)


@record
class KeptTerms(NamedTuple):
    """Where the terms of a state are computed and kept; arrays of shape (n,) and (n, n)."""

    #: Address of `set_terms`, and that of the places of its arguments.
    function: int  # noqa: A003
    places: int
    q: Array
    dq: Array
    M: Array
    C: Array
    G: Array


@record
class CompiledModel(NamedTuple):
    """A model as the plant takes it: addresses of `set_mass_and_bias`, and the `BodyScratch`."""

    call: Any
    body: Any

    def mass_and_bias(self, q: Any, dq: Any) -> Any:
        """Return M and C dq + G; see `Model.mass_and_bias`. The next call changes M."""
        s = self.body
        write(s.q, q)
        write(s.dq, dq)
        invoke(self.call.function, self.call.places)
        return value(s.M), value(s.bias)


@record
class EvaluatedModel(NamedTuple):
    """A model as the control step takes it: of the plant's form, with a `KeptTerms`."""

    model: CompiledModel
    place: Any

    def evaluate(self, q: Any, dq: Any) -> Any:
        """Return M, C and G, as `Model.evaluate` does. The next call changes M and C."""
        place = self.place
        write(place.q, q)
        write(place.dq, dq)
        invoke(place.function, place.places)
        return value(place.M), value(place.C), value(place.G)

    def forward(self, q: Any, dq: Any, u: Any) -> Any:
        """Return ddq, as `Model.forward` does."""
        M, bias = self.model.mass_and_bias(q, dq)
        return solve(M, u - bias)


def _room(n: int) -> Any:
    """Return a `KeptTerms` for `n` joints."""
    zero, square = np.zeros(n), np.zeros((n, n))
    return packed(KeptTerms(0, 0, zero, zero, square, square, zero))


class Call(NamedTuple):
    """A call by its addresses: NumPy record with them, function, arguments and their places."""

    record: Any
    code: Code
    arguments: tuple[Any, ...]
    places: Any


class CompiledArm:
    """
    The dynamics of an arm as machine code, compiled once for all laws and the plant.

    Parameters
    ----------
    arm : Arm
        Numbers of the model.
    n : int
        Number of joints.

    Attributes
    ----------
    codes : tuple of Code
        What must be compiled.
    model : CompiledModel
        As compiled functions take it.
    calls : list of Call
        Of compiled functions.

    """

    def __init__(self, arm: Arm, n: int) -> None:
        self._n, self._bodies = n, (record_of(arm), record_of(tree.body_scratch(n)))
        call = numpy_record(dict.fromkeys(('function', 'places'), np.array(0)))
        self.model = CompiledModel(call, self._bodies[1])
        self._terms = Code(set_terms, (*self._bodies, _room(n)), f'dynamics-{n}')
        self._mass = Code(set_mass_and_bias, self._bodies, f'mass-{n}')
        self.codes = self._terms, self._mass
        self.calls: list[Call] = []
        self._call(call, self._mass, self._bodies)

    def fill(self, arm: Arm) -> None:
        """Take the numbers of another arm of as many joints."""
        self._bodies[0].base[0] = tuple(vars(arm).values())

    def _call(self, called: Any, code: Code, arguments: tuple[Any, ...]) -> None:
        """Set the addresses by which compiled code calls another one, with these arguments."""
        made = Call(called, code, arguments, argument_addresses(arguments))
        self.calls.append(made)
        if code.compiled:
            called['function'], called['places'] = code.address(), made.places.ctypes.data

    def place(self) -> Any:
        """Return a place for the terms of a state."""
        place = _room(self._n)
        self._call(place, self._terms, (*self._bodies, place))
        return place


@function
def set_terms(arm: Any, body: Any, place: Any) -> int:
    """Set M, C and G of a `KeptTerms` for its q and dq."""
    terms(arm, place.q, place.dq, body, place.M, place.C, place.G)
    return 0


@function
def set_mass_and_bias(arm: Any, s: Any) -> int:
    """Set M and C dq + G of a `BodyScratch` for its q and dq."""
    if arm.closed:
        terms(arm, s.q, s.dq, s, s.M, s.C, s.bias)
        for i in range(2):
            s.bias[i] += s.C[i, 0] * s.dq[0] + s.C[i, 1] * s.dq[1]
    else:
        tree.place(arm, s.q, s)
        tree.weigh(arm, s)
        tree.move(arm, s.dq, s)
        tree.bias(arm, s, s.dq, s.bias)
        tree.mass_matrix(arm, s, s.M)
    return 0


@function
def terms(arm: Any, q: Any, dq: Any, s: Any, M: Any, C: Any, G: Any) -> None:
    """Set M(q), C(q, dq) and G(q), shapes (n, n), (n, n) and (n,), of an `Arm`."""
    if arm.closed:
        m11, m12, m22, k, g1, g2 = two_link.terms(arm.gravity, q)
        c, k = arm.scale, arm.scale * k
        M[0, 0], M[0, 1], M[1, 0], M[1, 1] = c * m11, c * m12, c * m12, c * m22
        C[0, 0], C[0, 1], C[1, 0], C[1, 1] = -k * dq[1], -k * (dq[0] + dq[1]), k * dq[0], 0.0
        G[0], G[1] = c * g1, c * g2
    else:
        tree.evaluate(arm, q, dq, s, M, C, G)

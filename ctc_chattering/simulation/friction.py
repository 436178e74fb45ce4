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
Coulomb friction as a set: F(dq) = Kf sgn(dq), and at dq = 0 any value in [-Kf, Kf].

A joint is in one of three modes: sliding forwards (+1), sliding backwards (-1), or at rest (0).
At rest it sticks until the load exceeds Kf; which joints stick and which break away is one
problem for all joints at rest together, because M couples them.

What friction is, at a velocity, beyond its value near rest is a function of velocity, load and
mode; `friction_model` adds one of your own.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import (
    dot,
    function,
    record,
    RECORDS,
    solve_where,
    some,
    Truths,
)
from ctc_chattering.errors import as_ctc_error, CtcError
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import accept_old_name, named_class
import numpy as np

#: A load that rounding alone lifts above Kf breaks no joint away.
_HOLD = 1.0 + 1e-12


@record
class Friction(NamedTuple):
    """Parameters of friction; vectors of shape (n,)."""

    #: Kf [N·m], part of the load that adds to it, asymmetry.
    coulomb: Array
    share: Array
    asymmetry: Array
    #: Viscous [N·m·s/rad], Stribeck [N·m] and its velocity [rad/s].
    viscous: Array
    stribeck: Array
    stribeck_velocity: Array
    #: 1.0 with an own friction, else 0.0.
    own: float


@record
class NoFriction(NamedTuple):
    """In the place of an own friction; what it has, an own one must have."""

    none: float = 0.0

    @classmethod
    def for_joints(cls, _joint_names: Sequence[str]) -> NoFriction:
        """Return the friction of a robot with these joints."""
        return cls()

    def resistance(self, velocity: Array, _load: Array, _mode: Array) -> Array:
        """
        Return what friction at the velocity is beyond that of the parameters, (n,) [N·m].

        Parameters
        ----------
        velocity : array, shape (n,)
            dq [rad/s].
        _load : array, shape (n,)
            Mean torque of the drives over the period [N·m].
        _mode : array, shape (n,)
            +1 or -1 of a joint that slides, else 0.

        Returns
        -------
        array, shape (n,)
            Against the velocity; 0 where that is 0, since the parameters have what holds a joint.

        """
        return 0.0 * velocity


def own_friction(name: str, joint_names: Sequence[str]) -> Any:
    """
    Return what the class `name`, ``package.module:Name``, makes of the names of the joints.

    Raises
    ------
    CtcError
        If it cannot be made, or does not return a number for each joint.

    """
    if not name:
        return NoFriction()
    own, n = named_class('friction_model', name, lambda x: x in RECORDS and hasattr(
        x, 'resistance'), 'class marked by @record with a method resistance'), len(joint_names)
    with as_ctc_error(f'the friction_model {name} cannot be made'):
        accept_old_name(own, 'made', 'for_joints')
        made = own.for_joints(tuple(joint_names))
        at_rest = made.resistance(np.zeros(n), np.zeros(n), np.ones(n))
        if len(at_rest) != n or any(at_rest):
            raise CtcError(f'its resistance at rest is {list(at_rest)}; allowed: {n} times 0')
    return made


@function
def margin_of_rest(M: Array, bias: Array, load: Array, breakaway: Array, stuck: Truths) -> float:
    """
    Return how far the most loaded joint at rest is from breaking away [N·m]; negative if it does.

    Parameters
    ----------
    M, bias : array, shape (n, n) and (n,)
        Of the model at the state [kg·m², N·m].
    load, breakaway : array, shape (n,)
        Torque without friction of the joints at rest, and breakaway torque Kf [N·m].
    stuck : array of bool, shape (n,)
        Which joints are at rest; inf is returned for none.

    """
    held = load - bias - dot(M, solve_where(~stuck, M, load - bias))
    margin: float = np.where(stuck, _HOLD * breakaway - np.abs(held), inf).min()
    return margin


@function
def modes(model: Any, q: Array, dq: Array, u: Array, breakaway: Array) -> tuple[Array, Truths]:
    """
    Decide for every joint between sticking (0) and sliding (+1 or -1).

    Parameters
    ----------
    model : Model
        Of the plant.
    q, dq, u : array, shape (n,)
        Position [rad], velocity [rad/s], torque without friction [N·m].
    breakaway : array, shape (n,)
        Breakaway torque Kf [N·m]; a joint for which it is 0 is reported as 0 and never sticks.

    Returns
    -------
    array, shape (n,)
        A moving joint slides the way it moves. A joint at rest has the mode for which either
        its acceleration is 0 and the friction that this takes is within ±Kf, or its friction is
        ±Kf and it accelerates that way.
    array of bool, shape (n,)
        The joints that stick.

    """
    rubbing = breakaway > 0.0
    mode = np.where(rubbing, np.sign(dq), 0.0)
    stuck = rubbing & (mode == 0.0)
    if some(stuck):
        M, bias = model.mass_and_bias(q, dq)
        load = u - breakaway * mode
        if margin_of_rest(M, bias, load, breakaway, stuck) < 0.0:
            held = nearest(M, load - bias, np.where(stuck, breakaway, 0.0))
            mode = np.where(stuck & (np.abs(held) >= breakaway), np.sign(held), mode)
            stuck = rubbing & (mode == 0.0)
    return mode, stuck

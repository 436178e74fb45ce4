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
from math import exp, inf
from typing import Any, NamedTuple

from ctc_chattering.errors import CtcError, refused_as
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.compilable import (
    along,
    array,
    bits,
    each,
    function,
    least,
    record,
    RECORDS,
)
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.parameters import named_class

#: A load that rounding alone lifts above Kf breaks no joint away.
_HOLD = 1.0 + 1e-12


@record
class Friction(NamedTuple):
    """Parameters of friction; vectors of shape (n,), truth values 1.0 and 0.0."""

    #: Kf [N·m], part of the load that adds to it, asymmetry.
    coulomb: Vector
    share: Vector
    asymmetry: Vector
    #: At rest, without a load [N·m].
    breakaway: Vector
    #: Viscous [N·m·s/rad], Stribeck [N·m] and its velocity [rad/s].
    viscous: Vector
    stribeck: Vector
    stribeck_velocity: Vector
    #: Whether it depends on the load, the direction, the velocity, and whether there is an own.
    loaded: float
    uneven: float
    by_velocity: float
    own: float


@record
class NoFriction(NamedTuple):
    """In the place of an own friction; what it has, an own one must have."""

    none: float = 0.0

    @classmethod
    def made(cls, _joint_names: Sequence[str]) -> NoFriction:
        """Return the friction of a robot with these joints."""
        return cls()

    def resistance(self, velocity: Vector, _load: Vector, _mode: Vector) -> Vector:
        """
        Return what friction at the velocity is beyond that of the parameters, (n,) [N·m].

        Parameters
        ----------
        velocity : sequence of float, shape (n,)
            dq [rad/s].
        _load : sequence of float, shape (n,)
            Mean torque of the drives over the period [N·m].
        _mode : sequence of float, shape (n,)
            +1 or -1 of a joint that slides, else 0.

        Returns
        -------
        sequence of float, shape (n,)
            Against the velocity; 0 where that is 0, since the parameters have what holds a joint.

        """
        return along(velocity, -1.0, velocity)


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
    with refused_as(f'the friction_model {name} cannot be made'):
        made = own.made(tuple(joint_names))
        at_rest = made.resistance([0.0] * n, [0.0] * n, [1.0] * n)
        if len(at_rest) != n or any(at_rest):
            raise CtcError(f'its resistance at rest is {at_rest}; allowed: {n} times 0')
    return made


@function
def loaded(coulomb: float, share: float, torque: float) -> float:
    """Return Kf with what the torque of the drive adds to it."""
    return coulomb + share * abs(torque)


@function
def less_asymmetry(load: float, asymmetry: float, coulomb: float) -> float:
    """Return a load less the constant part of a friction that depends on the direction."""
    return load - asymmetry * coulomb


@function
def less_friction(load: float, breakaway: float, mode: float) -> float:
    """Return a load less the friction of sliding near rest."""
    return load - breakaway * mode


@function
def less_velocity_friction(load: float, dq: float, mode: float, viscous: float, fall: float,
                           speed: float) -> float:
    """Return a load less what friction at the velocity exceeds its value near rest by."""
    load -= viscous * dq
    if fall:
        r = dq / speed
        load += fall * mode * (1.0 - exp(-r * r))
    return load


@function
def direction(dq: float) -> float:
    """Return the mode of a joint that moves; 0 for one that does not."""
    return 1.0 if dq > 0.0 else -1.0 if dq < 0.0 else 0.0


@function
def sliding(dq: float, breakaway: float) -> float:
    """Return the mode of a joint, 0 also for one without friction."""
    return direction(dq) if breakaway > 0.0 else 0.0


@function
def if_resting(mode: float, breakaway: float) -> float:
    """Return the breakaway torque of a joint at rest, else 0."""
    return 0.0 if mode else breakaway


@function
def broken(reaction: float, mode: float, breakaway: float) -> float:
    """Return the mode of a joint after what has held it is known."""
    return direction(reaction) if not mode and abs(reaction) >= breakaway > 0.0 else mode


@function
def margin_of_rest(reaction: float, mode: float, breakaway: float) -> float:
    """Return how far from its breakaway torque the load of a joint at rest is; inf of another."""
    return _HOLD * breakaway - abs(reaction) if not mode and breakaway > 0.0 else inf


@function
def margin_of_sliding(dq: float, mode: float) -> float:
    """Return how far a joint that slides is from rest; inf of another."""
    return dq * mode if mode else inf


@function
def holding(model: Any, q: Vector, dq: Vector, load: Vector, breakaway: Vector, mode: Vector,
            fixed_joints: int) -> float:
    """
    Return how far the most loaded joint at rest is from breaking away [N·m]; negative if it does.

    Parameters
    ----------
    model : Model
        Of the plant.
    q, dq : sequence of float, shape (n,)
        Position [rad] and velocity [rad/s].
    load : sequence of float, shape (n,)
        Torque less the friction of the joints that slide [N·m].
    breakaway, mode : sequence of float, shape (n,)
        Breakaway torque Kf [N·m] and modes.
    fixed_joints : int
        The joints at rest, as `Model.forward_dynamics` takes them.

    """
    return least(each(margin_of_rest, model.reaction(q, dq, load, fixed_joints), mode, breakaway))


@function
def modes(model: Any, q: Vector, dq: Vector, u: Vector, breakaway: Vector) -> tuple[Vector, int]:
    """
    Decide for every joint between sticking (0) and sliding (+1 or -1).

    Parameters
    ----------
    model : Model
        Of the plant.
    q, dq, u : sequence of float, shape (n,)
        Position [rad], velocity [rad/s], torque without friction [N·m].
    breakaway : sequence of float, shape (n,)
        Breakaway torque Kf [N·m]; a joint for which it is 0 is reported as 0 and never sticks.

    Returns
    -------
    sequence of float, shape (n,)
        A moving joint slides the way it moves. A joint at rest has the mode for which either
        its acceleration is 0 and the friction that this takes is within ±Kf, or its friction is
        ±Kf and it accelerates that way.
    int
        The joints that stick, as `Model.forward_dynamics` takes them.

    """
    mode = each(sliding, dq, breakaway)
    resting = each(if_resting, mode, breakaway)
    fixed = bits(resting)
    if fixed:
        load = each(less_friction, u, breakaway, mode)
        if holding(model, q, dq, load, breakaway, mode, fixed) < 0.0:
            M, bias = model.mass_and_bias(q, dq)
            reaction = nearest(M, array(load) - bias, array(resting))
            mode = each(broken, reaction, mode, breakaway)
            fixed = bits(each(if_resting, mode, breakaway))
    return mode, fixed

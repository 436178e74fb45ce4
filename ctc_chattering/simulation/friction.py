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
Coulomb friction as a set.

It is F(dq) = Kf sgn(dq), and at dq = 0 any value in [-Kf, Kf]. `motion.py` asks here which joints
stick. A joint is in one of three modes: it slides forwards
(+1) or backwards (-1), or it is at rest (0). At rest it sticks until the load exceeds Kf. All
joints at rest are one problem, because M couples them (`numerics/box_qp.py`).

The parameter `friction_model` names a class of the user with further friction. It depends on
velocity, load and mode, and is 0 at rest.
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

#: Factor of Kf: a load that rounding alone lifts above Kf breaks no joint away.
_HOLD = 1.0 + 1e-12


@record
class Friction(NamedTuple):
    """Parameters of `PlantConfig`, over the coordinates."""

    #: Kf [N·m].
    coulomb_friction: Array
    #: Share of the load that adds to Kf, and asymmetry.
    load_friction: Array
    friction_asymmetry: Array
    #: Coefficient [N·m·s/rad].
    viscous_friction: Array
    #: Further friction at rest [N·m], and the velocity at which it has faded to 1/e [rad/s].
    stribeck_friction: Array
    stribeck_velocity: Array


@record
class NoFriction(NamedTuple):
    """No friction of the user, with the methods of one."""

    none: float = 0.0

    @classmethod
    def for_joints(cls, _joint_names: Sequence[str]) -> NoFriction:
        """Return the friction of a robot with these joints."""
        return cls()

    def resistance(self, velocity: Array, _load: Array, _mode: Array) -> Array:
        """
        Return the further friction at a velocity, (n,) [N·m].

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
            Against the velocity. It is 0 at rest, since the parameters have what holds a joint.

        """
        return 0.0 * velocity


def own_friction(name: str, joint_names: Sequence[str]) -> Any:
    """
    Return the friction of the class `name`, ``package.module:Name``.

    Raises
    ------
    CtcError
        If it cannot be made, or does not return a number for each joint.

    """
    if not name:
        return NoFriction()
    n = len(joint_names)
    marked = named_class(
        'friction_model', name, lambda x: x in RECORDS and hasattr(x, 'resistance'),
        'class marked by @record with a method resistance')
    with as_ctc_error(f'the friction_model {name} cannot be constructed'):
        accept_old_name(marked, 'made', 'for_joints')
        friction = marked.for_joints(tuple(joint_names))
        at_rest = friction.resistance(np.zeros(n), np.zeros(n), np.ones(n))
        if len(at_rest) != n or any(at_rest):
            raise CtcError(f'its resistance at rest is {list(at_rest)}; allowed: {n} times 0')
    return friction


@function
def stick_margin(M: Array, load: Array, breakaway: Array, stuck: Truths) -> float:
    """
    Return the torque by which the weakest stuck joint holds [N·m].

    It is negative if the joint breaks away.

    Parameters
    ----------
    M : array, shape (n, n)
        Mass matrix [kg·m²].
    load : array, shape (n,)
        Torque less C dq + G, without the friction of joints at rest [N·m].
    breakaway : array, shape (n,)
        Breakaway torque Kf [N·m].
    stuck : array of bool, shape (n,)
        Joints at rest. Without any, the margin is inf.

    """
    held = load - dot(M, solve_where(~stuck, M, load))
    margin: float = np.where(stuck, _HOLD * breakaway - np.abs(held), inf).min()
    return margin


@function
def modes(model: Any, q: Array, dq: Array, u: Array, breakaway: Array) -> tuple[Array, Truths]:
    """
    Decide for each joint between sticking (0) and sliding (±1).

    Parameters
    ----------
    model : Model
        Of the plant.
    q, dq, u : array, shape (n,)
        Position [rad], velocity [rad/s], torque without friction [N·m].
    breakaway : array, shape (n,)
        Breakaway torque Kf [N·m]. A joint for which it is 0 has the mode 0 and never sticks.

    Returns
    -------
    mode : array, shape (n,)
        A moving joint slides the way it moves. A joint at rest has the mode for which either
        its acceleration is 0 and the friction that this takes is within ±Kf, or its friction is
        ±Kf and it accelerates that way.
    stuck : array of bool, shape (n,)
        Joints that stick.

    """
    rubbing = breakaway > 0.0
    mode = np.where(rubbing, np.sign(dq), 0.0)
    stuck = rubbing & (mode == 0.0)
    if some(stuck):
        M, bias = model.mass_and_bias(q, dq)
        load = u - breakaway * mode - bias
        if stick_margin(M, load, breakaway, stuck) < 0.0:
            held = nearest(M, load, np.where(stuck, breakaway, 0.0))
            mode = np.where(stuck & (np.abs(held) >= breakaway), np.sign(held), mode)
            stuck = rubbing & (mode == 0.0)
    return mode, stuck

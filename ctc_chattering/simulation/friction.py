"""
Coulomb friction as a set: F(dq) = Kf sgn(dq), and at dq = 0 any value in [-Kf, Kf].

A joint is in one of three modes: sliding forwards (+1), sliding backwards (-1), or at rest (0).
At rest it sticks until the load exceeds Kf; which joints stick and which break away is one
problem for all joints at rest together, because M couples them.
"""

from __future__ import annotations

from collections.abc import Sequence

from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.linear_algebra import Array, Vector
import numpy as np

Modes = tuple[int, ...]
#: A load that rounding alone lifts above Kf breaks no joint away.
_HOLD = 1.0 + 1e-12


def modes(model: Model, q: Vector, dq: Vector, u: Vector, breakaway: Vector) -> Modes:
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
    tuple of int, shape (n,)
        A moving joint slides the way it moves. A joint at rest has the mode for which either
        its acceleration is 0 and the friction that this takes is within ±Kf, or its friction is
        ±Kf and it accelerates that way.

    """
    n = model.n
    rest = [i for i in range(n) if dq[i] == 0.0 and breakaway[i] > 0.0]
    mode = [(dq[i] > 0.0) - (dq[i] < 0.0) if breakaway[i] else 0 for i in range(n)]
    if not rest:
        return tuple(mode)
    load = [u[i] - breakaway[i] * mode[i] for i in range(n)]
    if max(excess(model, q, dq, load, breakaway, rest)) <= 0.0:
        return tuple(mode)
    # The inertia of the joints at rest, the others being free to move.
    mass = _inverse(_inverse(np.array(model.mass_matrix(q)))[np.ix_(rest, rest)])
    holding = mass.dot(np.array(model.forward_dynamics(q, dq, load))[rest])
    reaction = nearest(mass, holding, np.array([breakaway[i] for i in rest]))
    for i, f in zip(rest, reaction.tolist()):
        if abs(f) >= breakaway[i]:
            mode[i] = 1 if f > 0.0 else -1
    return tuple(mode)


def _inverse(a: Array) -> Array:
    """Return the inverse of a matrix."""
    return np.asarray(np.linalg.inv(a), float)


def excess(model: Model, q: Vector, dq: Vector, load: Vector, breakaway: Vector,
           stuck: Sequence[int]) -> list[float]:
    """
    Return for each stuck joint how far its load is beyond Kf [N·m]; negative while it holds.

    Parameters
    ----------
    model : Model
        Of the plant.
    q, dq : sequence of float, shape (n,)
        Position [rad] and velocity [rad/s].
    load : sequence of float, shape (n,)
        Torque less the friction of the joints that slide [N·m].
    breakaway : sequence of float, shape (n,)
        Breakaway torque Kf [N·m].
    stuck : sequence of int
        Joints at rest.

    """
    a = model.forward_dynamics(q, dq, load, bit_mask(stuck))
    need = model.inverse_dynamics(q, dq, a)
    return [abs(load[i] - need[i]) - _HOLD * breakaway[i] for i in stuck]


def bit_mask(joints: Sequence[int]) -> int:
    """Return the bit mask of `joints`, as `Model.forward_dynamics` takes it."""
    return sum(1 << i for i in joints)

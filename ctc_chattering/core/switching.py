"""
Ways to evaluate the chattering term of law (6), Ka sgn(v).

`sign` is the paper's; `boundary_layer` replaces the jump by a slope. `implicit_term` is the
backward-Euler discretisation: the term z is the element of Ka Sgn(v) at the *next* sample, so that
it can rest anywhere between -Ka and Ka once v is 0 (Acary & Brogliato 2010; Huber, Acary &
Brogliato 2016; see docs/theory.md).
"""

from __future__ import annotations

from collections.abc import Callable

from ctc_chattering.core.box import nearest, solve_box
from ctc_chattering.core.model import Model, Rows, solve, Vector

#: Values of the parameter ``switching``.
SWITCHINGS = ('sign', 'boundary_layer', 'implicit', 'implicit_observer')


def sign(v: Vector, ka: Vector) -> list[float]:
    """
    Return Ka sgn(v), shape (n,) [N·m], with sgn(0) = 0 as in the paper.

    Parameters
    ----------
    v : sequence of float, shape (n,)
        Filtered error [rad/s].
    ka : sequence of float, shape (n,)
        Gains [N·m].

    """
    return [k if x > 0.0 else -k if x < 0.0 else 0.0 for x, k in zip(v, ka)]


def boundary_layer(v: Vector, ka: Vector, width: float) -> list[float]:
    """
    Return Ka sat(v / width), shape (n,) [N·m].

    Parameters
    ----------
    v : sequence of float, shape (n,)
        Filtered error [rad/s].
    ka : sequence of float, shape (n,)
        Gains [N·m].
    width : float
        Half the width of the layer around v = 0 [rad/s].

    """
    return [k * min(max(x / width, -1.0), 1.0) for x, k in zip(v, ka)]


def implicit_term(model: Model, q: Vector, wanted: Vector, ka: Vector) -> Vector:
    """
    Return z, shape (n,) [N·m], with z ∈ Ka Sgn(v⁺) and v⁺ = b h M⁻¹ (wanted - z).

    Parameters
    ----------
    model : Model
        For M(q).
    q : sequence of float, shape (n,)
        Position [rad].
    wanted : sequence of float, shape (n,)
        The term that would make v⁺ vanish [N·m].
    ka : sequence of float, shape (n,)
        Gains [N·m].

    Notes
    -----
    Where `wanted` is within ±Ka it is the solution. Otherwise joints at their bound push the
    others through M⁻¹, and the box problem couples them all; it has one solution, whatever b h.

    """
    return within(lambda: model.mass_matrix(q), wanted, ka)


def within(mass: Callable[[], Rows], wanted: Vector, ka: Vector) -> Vector:
    """
    Return what `implicit_term` does; `mass` gives M, and is called only if it is needed.

    Where `wanted` is within ±Ka, that very object is returned.
    """
    for x, k in zip(wanted, ka):
        if not -k <= x <= k:
            break
    else:
        return wanted
    if not all(abs(x) < 1e280 for x in wanted):  # The elimination below would overflow.
        return sign(wanted, ka)
    if len(wanted) > 2:
        return nearest(mass(), wanted, ka)
    rows, n = mass(), len(wanted)
    inverse = [solve(rows, [float(i == j) for i in range(n)]) for j in range(n)]
    return solve_box(inverse, [-y for y in solve(rows, wanted)], ka)

"""Ways to evaluate the chattering term Ka sgn(v) of law (6)."""

from __future__ import annotations

from ctc_chattering.core.model import Vector

#: Values of the parameter ``switching``.
SWITCHINGS = ('sign',)


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

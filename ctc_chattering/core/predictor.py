"""The state after a known delay: the model run ahead under the torques that are on their way."""

from __future__ import annotations

from ctc_chattering.core.model import Model, Vector


def predict(model: Model, q: Vector, dq: Vector, u: Vector, h: float) -> tuple[Vector, Vector]:
    """
    Return q and dq after one period under a held torque, by the midpoint rule.

    Parameters
    ----------
    model : Model
        As the controller knows it.
    q, dq : sequence of float, shape (n,)
        Position [rad] and velocity [rad/s].
    u : sequence of float, shape (n,)
        Torque less the perturbation [N·m].
    h : float
        Period [s].

    """
    half = 0.5 * h
    a = model.forward_dynamics(q, dq, u)
    middle = [x + half * y for x, y in zip(dq, a)]
    a = model.forward_dynamics([x + half * y for x, y in zip(q, dq)], middle, u)
    return ([x + h * y for x, y in zip(q, middle)], [x + h * y for x, y in zip(dq, a)])

"""One step of the classical Runge-Kutta method: ddq = f(q, dq, u), u at three instants."""

from __future__ import annotations

from collections.abc import Callable

from ctc_chattering.numerics.linear_algebra import Vector

#: f(q, dq, u, fixed_joints), as `Model.forward_dynamics` is.
Dynamics = Callable[[Vector, Vector, Vector, int], Vector]
Load = tuple[Vector, Vector, Vector]


def step(f: Dynamics, q: Vector, dq: Vector, load: Load, fixed_joints: int, h: float
         ) -> tuple[Vector, Vector]:
    """
    Return q and dq after `h`, to fourth order.

    Parameters
    ----------
    f : callable
        Dynamics.
    q, dq : sequence of float, shape (n,)
        Position [rad] and velocity [rad/s].
    load : (u(t), u(t + h/2), u(t + h))
        Torques, each of shape (n,) [N·m].
    fixed_joints : int
        Handed on to `f`.
    h : float
        Step [s].

    """
    u0, um, u1 = load
    half, sixth = 0.5 * h, h / 6.0
    a = f(q, dq, u0, fixed_joints)
    v2 = [x + half * y for x, y in zip(dq, a)]
    b = f([x + half * y for x, y in zip(q, dq)], v2, um, fixed_joints)
    v3 = [x + half * y for x, y in zip(dq, b)]
    c = f([x + half * y for x, y in zip(q, v2)], v3, um, fixed_joints)
    v4 = [x + h * y for x, y in zip(dq, c)]
    d = f([x + h * y for x, y in zip(q, v3)], v4, u1, fixed_joints)
    return ([x + sixth * (k1 + 2.0 * (k2 + k3) + k4)
             for x, k1, k2, k3, k4 in zip(q, dq, v2, v3, v4)],
            [x + sixth * (k1 + 2.0 * (k2 + k3) + k4)
             for x, k1, k2, k3, k4 in zip(dq, a, b, c, d)])

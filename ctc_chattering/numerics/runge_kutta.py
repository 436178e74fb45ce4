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


def step_two(f: Dynamics, q: Vector, dq: Vector, load: Load, fixed_joints: int, h: float
             ) -> tuple[Vector, Vector]:
    """Return what `step` does, to the last bit, for two joints: without the loops, faster."""
    u0, um, u1 = load
    half, sixth = 0.5 * h, h / 6.0
    q1, q2 = q
    v1, v2 = dq
    a1, a2 = f(q, dq, u0, fixed_joints)
    w1, w2 = v1 + half * a1, v2 + half * a2
    b1, b2 = f((q1 + half * v1, q2 + half * v2), (w1, w2), um, fixed_joints)
    x1, x2 = v1 + half * b1, v2 + half * b2
    c1, c2 = f((q1 + half * w1, q2 + half * w2), (x1, x2), um, fixed_joints)
    y1, y2 = v1 + h * c1, v2 + h * c2
    d1, d2 = f((q1 + h * x1, q2 + h * x2), (y1, y2), u1, fixed_joints)
    return ((q1 + sixth * (v1 + 2.0 * (w1 + x1) + y1), q2 + sixth * (v2 + 2.0 * (w2 + x2) + y2)),
            (v1 + sixth * (a1 + 2.0 * (b1 + c1) + d1), v2 + sixth * (a2 + 2.0 * (b2 + c2) + d2)))

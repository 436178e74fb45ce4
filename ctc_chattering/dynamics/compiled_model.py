"""What compiled code has in the place of a `Model`: the terms of (1) of either kind of arm."""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.dynamics import tree, two_link
from ctc_chattering.numerics.compilable import dot, function, record, solve_where, truths
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.records import value, write


@record
class Place(NamedTuple):
    """Where the terms of a state are kept; arrays of shape (n,) and (n, n)."""

    q: Array
    dq: Array
    M: Array
    C: Array
    G: Array


@record
class CompiledModel(NamedTuple):
    """An arm with the memory in which its terms are computed, each a NumPy record."""

    arm: Any
    body: Any

    def mass_and_bias(self, q: Any, dq: Any) -> Any:
        """Return M and C dq + G; see `Model.mass_and_bias`. The next call changes M."""
        arm, s = self.arm, self.body
        write(s.q, q)
        write(s.dq, dq)
        if arm.closed:
            terms(arm, s.q, s.dq, s, s.M, s.C, s.bias)
            for i in range(2):
                s.bias[i] += s.C[i, 0] * dq[0] + s.C[i, 1] * dq[1]
        else:
            tree.place(arm, s.q, s)
            tree.weigh(arm, s)
            tree.move(arm, s.dq, s)
            tree.bias(arm, s, s.dq, s.bias)
            tree.mass_matrix(arm, s, s.M)
        return value(s.M), value(s.bias)

    def forward_dynamics(self, q: Any, dq: Any, u: Any, fixed_joints: int) -> Any:
        """Return ddq; see `Model.forward_dynamics`."""
        M, bias = self.mass_and_bias(q, dq)
        return solve_where(~truths(fixed_joints, u), M, u - bias)

    def reaction(self, q: Any, dq: Any, u: Any, fixed_joints: int) -> Any:
        """Return what holds fixed joints; see `Model.reaction`."""
        M, bias = self.mass_and_bias(q, dq)
        return u - bias - dot(M, solve_where(~truths(fixed_joints, u), M, u - bias))


@record
class EvaluatedModel(NamedTuple):
    """An arm with its memory, and a `Place` for what it is evaluated to, each a NumPy record."""

    arm: Any
    body: Any
    place: Any

    def evaluate(self, q: Any, dq: Any) -> Any:
        """Return M, C and G, as `Model.evaluate` does. The next call changes M and C."""
        place = self.place
        write(place.q, q)
        write(place.dq, dq)
        terms(self.arm, place.q, place.dq, self.body, place.M, place.C, place.G)
        return value(place.M), value(place.C), value(place.G)

    def acceleration(self, q: Any, dq: Any, u: Any) -> Any:
        """Return ddq, as `Model.acceleration` does."""
        return CompiledModel(self.arm, self.body).forward_dynamics(q, dq, u, 0)


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

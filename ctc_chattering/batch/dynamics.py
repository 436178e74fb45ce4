"""The terms of equation (1) in arrays, for the control step."""

from __future__ import annotations

from ctc_chattering.batch.compiler import compiled
from ctc_chattering.dynamics import compiled_model
from ctc_chattering.dynamics.arm import Arm, BodyScratch
from ctc_chattering.dynamics.compiled_model import CompiledModel
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.simd.records import value, write


@compiled
def evaluate(arm: Arm, q: Array, dq: Array, s: BodyScratch, M: Array, C: Array, G: Array) -> None:
    """Set M(q), C(q, dq) and G(q), shapes (n, n), (n, n) and (n,)."""
    compiled_model.evaluate(arm, q, dq, s, M, C, G)


@compiled
def forward_dynamics(arm: Arm, q: Array, dq: Array, u: Array, s: BodyScratch, out: Array) -> None:
    """Set ddq, shape (n,) [rad/s²], under the torque `u`."""
    write(out, CompiledModel(arm, s).forward_dynamics(value(q), value(dq), value(u), 0))

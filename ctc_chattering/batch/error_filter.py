"""The filter (3) with the state ξ, as `control/error_filter.py` has it."""

from __future__ import annotations

from ctc_chattering.batch.compiler import inlined
from ctc_chattering.batch.control_state import ControlSettings
from ctc_chattering.numerics.linear_algebra import Array


@inlined
def advance(c: ControlSettings, xi: Array, de: Array, u: Array, correction: Array) -> None:
    """Replace ξ, shape (n,) [rad/s], by what it is a period later, with the correction."""
    for i in range(len(xi)):
        xi[i] = c.decay * xi[i] + c.gain * (c.lambda_ * de[i] - u[i]) + correction[i]


@inlined
def nominal_response(c: ControlSettings, v: Array, u: Array, correction: Array, out: Array
                     ) -> None:
    """Set y: what v would be a period later if dde + Kv de + Kp e were 0, shape (n,) [rad/s]."""
    for i in range(len(v)):
        out[i] = c.decay * v[i] + c.rest * u[i] + correction[i]

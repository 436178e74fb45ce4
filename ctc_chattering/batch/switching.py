"""
The chattering term z in the place of Ka sgn(v), as `control/switching` has it, and its observer.

The observer of the perturbation is that of `control/perturbation_observer.py`.
"""

from __future__ import annotations

from ctc_chattering.batch.compiler import inlined
from ctc_chattering.batch.control_state import (
    ControlScratch,
    ControlSettings,
    ControlState,
    Evaluated,
)
from ctc_chattering.batch.error_filter import nominal_response
from ctc_chattering.batch.linear_algebra import product
from ctc_chattering.control.switching import SWITCHINGS
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.records import value, write
import numpy as np

SIGN, BOUNDARY_LAYER, IMPLICIT, IMPLICIT_OBSERVER = map(SWITCHINGS.index, (
    'sign', 'boundary_layer', 'implicit', 'implicit_observer'))


@inlined
def term(c: ControlSettings, s: ControlState, at: Evaluated, w: ControlScratch) -> None:
    """Set z in `w.robust` and its clipping error in `w.clipped`, each of shape (n,) [N·m]."""
    n = len(at.v)
    if c.switching == SIGN:
        for i in range(n):
            w.robust[i] = c.ka[i] * np.sign(at.v[i])
    elif c.switching == BOUNDARY_LAYER:
        for i in range(n):
            w.robust[i] = c.ka[i] * min(max(at.v[i] / c.width, -1.0), 1.0)
    else:
        for i in range(n):
            w.z[i] = 0.0
        nominal_response(c, at.v, at.u, w.z, w.x)
        product(at.M, w.x, w.y)
        for i in range(n):
            w.y[i] = w.y[i] / c.scale - w.compensation[i]
            if c.switching == IMPLICIT_OBSERVER:
                w.y[i] -= s.estimate[i]
        write(w.robust, nearest(value(at.M), value(w.y), value(c.ka)))
        if c.switching == IMPLICIT_OBSERVER:
            for i in range(n):
                w.clipped[i] = w.y[i] - w.robust[i]


@inlined
def observe(c: ControlSettings, s: ControlState, v: Array, w: ControlScratch) -> None:
    """Improve P̂ by what v, shape (n,) [rad/s], has become."""
    if not s.observed:
        return
    n = len(v)
    for i in range(n):
        w.x[i] = (s.nominal[i] - v[i]) / c.scale
    product(s.mass, w.x, w.y)
    for i in range(n):
        w.y[i] = s.estimate[i] + c.follow * (w.y[i] - s.residual[i] - s.estimate[i])
    write(s.estimate, nearest(value(s.mass), value(w.y), value(c.ka)))


@inlined
def predict(c: ControlSettings, s: ControlState, now: Evaluated, tau: Array, clipped: Array,
            correction: Array) -> None:
    """Remember what the next sample's v is without a perturbation."""
    n = len(tau)
    nominal_response(c, now.v, now.u, correction, s.nominal)
    for i in range(n):
        s.residual[i] = now.N[i] - tau[i]
        if abs(clipped[i]) < c.ka[i]:
            s.residual[i] += 0.5 * clipped[i]
        for j in range(n):
            s.mass[i, j] = now.M[i, j]
    s.observed = 1

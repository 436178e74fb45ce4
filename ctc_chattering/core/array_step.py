"""
The control step as three array products, for an `ArrayModel`: what `Controller.step` computes.

Both laws are linear but for the choice of the chattering term. One constant matrix gives all that
needs no model, with a = ddq_d + Kv de + Kp e and y / (b h) as `Controller` has them::

    (a, y / (b h), v, e, de, ξ⁺) = K (q, q_d, dq_d, ddq_d, ξ, dq)

The model's C and M, and M₋ of the last sample, are applied to dq, a, y / (b h) and v; one more
constant matrix makes of these products, of G / g and of p, which is all of P̂ that was known at
the last sample::

    (torque, wanted term, P̂ = p - gain M₋ v / (b h), inverse dynamics, C v)

Where the term wanted or P̂ is beyond ±Ka, or the torque beyond its limit, the box problem and the
residual of `observer.py` are worked out as they are there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
import struct
from typing import NamedTuple

import numpy as np

from ctc_chattering.core.array_model import Array, ArrayModel
from ctc_chattering.core.filter import ErrorFilter
from ctc_chattering.core.model import Rows, Vector
from ctc_chattering.core.observer import PerturbationObserver
from ctc_chattering.core.sample import ArraySample, Sample
from ctc_chattering.core.switching import within
from ctc_chattering.core.trajectory import Point

_new = tuple.__new__
#: Maps q, dq, q_d, dq_d to e, de and Kv de + Kp e.
Errors = Callable[[Vector, Vector, Vector, Vector], tuple[Vector, Vector, Vector]]
#: Maps v to the chattering term, where that is a function.
Term = Callable[[Vector], Vector]


class Limits(NamedTuple):
    """Limits of the torque."""

    #: Torques within this, shape (n,), are left alone for certain [N·m].
    within: Vector
    #: Maps the torque wanted and the one sent last to the one allowed.
    restrain: Callable[[Vector, Vector], Vector]
    #: Whether what is cut off is kept out of the filter.
    anti_windup: bool


class ArrayStep:
    """
    The step with its buffers.

    Parameters
    ----------
    model : ArrayModel
        M, C and G.
    filter_, observer : ErrorFilter, PerturbationObserver
        Whose states this step advances.

    """

    def __init__(self, model: ArrayModel, filter_: ErrorFilter,
                 observer: PerturbationObserver) -> None:
        n = model.n
        self._previous: Vector = (0.0,) * n
        self._model, self._filter, self._observer = model, filter_, observer
        #: Row by row q, q_d, dq_d, ddq_d, ξ, dq; a, y / (b h), v, e, de, ξ⁺; torque, wanted
        #: term, P̂, inverse dynamics, C v.
        self._rows = np.zeros((17, n))
        self._inputs = self._rows[:6].reshape(-1).data
        #: C, M and M₋, one below the other.
        self._matrices = np.zeros((3 * n, n))
        #: Their products with dq, a, y / (b h) and v; G / g; p.
        self._terms = np.zeros((14, n))
        self._push, self._known, self._estimate = (
            self._terms[7], self._terms[13].data, self._rows[14].data)
        # A method looked up once, and a memoryview, cost half as much as np.dot and a slice.
        self._write = struct.Struct(f'{n}d').pack_into
        self._write_inputs = struct.Struct(f'{6 * n}d').pack_into
        self._evaluate = model.evaluator(self._rows[0], self._rows[5])
        self._multiply = partial(
            self._rows[5:9].dot, self._matrices.T, self._terms[:12].reshape(4, 3 * n))
        self._c, self._coriolis = self._matrices[:n], model.coriolis
        self._m, self._mass = _flat(self._matrices[n:2 * n]), _flat(model.mass)
        self._last = _flat(self._matrices[2 * n:])
        self._weight, self._moment = self._terms[12].data, model.moment.data
        self._v, self._told, self._keep = (
            self._rows[8], self._rows[11:15].tolist, self._rows[8:17].copy)

    def configure(self, errors: Errors, term: Term | None, observing: bool, gain: float,
                  ka: Vector, limits: Limits | None) -> None:
        """
        Set the law.

        Parameters
        ----------
        errors : callable
            Maps q, dq, q_d, dq_d to e, de and Kv de + Kp e, linearly.
        term : callable or None
            Maps v to the chattering term; None for the implicit ones.
        observing : bool
            Whether the perturbation is estimated.
        gain : float
            Part of the residual that the estimate takes up per sample.
        ka : sequence of float, shape (n,)
            Bounds of the chattering term.
        limits : Limits or None
            Those of the torque.

        """
        self._term, self._observing = term, observing
        self._ka, self._limits = ka, limits
        self._within = limits.within if limits else None
        # What is within these is within ±Ka; 0 has nothing within.
        self._squares = [k * k * (1.0 - 1e-15) - 5e-324 for k in ka]
        linear, n = self._linear(errors), self._model.n
        self._prepare = partial(linear.dot, self._rows[:6].reshape(-1),
                                self._rows[6:12].reshape(-1))
        alike = linear[::n, ::n].copy()
        if (linear == np.kron(alike, np.eye(n))).all():  # All joints have the same gains.
            self._prepare = partial(alike.dot, self._rows[:6], self._rows[6:12])
        products = np.eye(14)
        c_dq, m_a, m_y, c_v, last_v, weight, known = products[[0, 4, 7, 9, 11, 12, 13]]
        inverse = c_dq + m_a + self._model.gravity * weight
        estimate = (known - gain / self._filter.scale * last_v) * observing
        wanted = m_y - c_v - estimate
        tau = inverse - c_v
        if term is None:
            tau = tau - wanted
        self._combine = partial(np.array([tau, wanted, estimate, inverse, c_v]).dot,
                                self._terms, self._rows[12:17])
        self.forget()

    def forget(self, bumpless: bool = False, previous: Vector | None = None) -> None:
        """
        Forget the last sample; ξ and P̂ are not ours.

        Parameters
        ----------
        bumpless : bool
            Whether to begin with v = 0.
        previous : sequence of float, shape (n,), optional
            Torque sent last [N·m].

        """
        self._bumpless = bumpless
        if previous is not None:
            self._previous = previous
        self._matrices[2 * self._model.n:] = 0.0
        self._terms[13] = 0.0
        self._ahead: Vector | None = self._observer.estimate if self._observing else None

    def step(self, q: Vector, dq: Vector, q_d: Vector, dq_d: Vector, ddq_d: Vector,
             ahead: Sequence[Point] = ()) -> Sample:
        """Return the sample; arguments as `Controller.step` has them."""
        del ahead  # There is no delay.
        filter_ = self._filter
        if self._bumpless:
            filter_.settle([a - b for a, b in zip(dq_d, dq)])
            self._bumpless = False
        self._write_inputs(self._inputs, 0, *q, *q_d, *dq_d, *ddq_d, *filter_.state, *dq)
        self._prepare()
        self._evaluate()
        self._c[:] = self._coriolis
        self._m[:] = self._mass
        self._weight[:] = self._moment
        self._multiply()
        if self._ahead is not None:
            self._write(self._known, 0, *self._ahead)
        self._combine()
        tau: Vector
        filter_.state, tau, term, estimate = self._told()
        if self._term is not None:
            term = self._term(self._v.tolist())
            tau = [x - s for x, s in zip(tau, term)]
            excess = None
            if self._limits is not None:
                tau, excess = self._limited(tau)
            self._previous = tau
            return _new(ArraySample, (tau, term, excess, self._keep()))
        for x, y, square in zip(term, estimate, self._squares):
            if not (x * x <= square and y * y <= square):
                return self._bounded(term, estimate)
        if self._within is not None:
            for x, limit in zip(tau, self._within):
                if not -limit <= x <= limit:
                    return self._whole(term, estimate, None)
        if self._observing:
            self._observer.estimate, self._ahead = estimate, None
            self._known[:] = self._estimate
            self._last[:] = self._mass
        self._previous = tau
        return _new(ArraySample, (tau, term, None, self._keep()))

    def _bounded(self, wanted: Vector, estimate: Vector) -> Sample:
        """Return the sample where P̂ or the term may be beyond ±Ka."""
        if self._observing:
            bounded = within(self._last_mass, estimate, self._ka)
            if bounded is not estimate:
                wanted = [w + p - x for w, p, x in zip(wanted, estimate, bounded)]
                estimate = bounded
        term = within(self._model.mass.tolist, wanted, self._ka)
        cut = None if term is wanted else [w - z for w, z in zip(wanted, term)]
        return self._whole(term, estimate, cut)

    def _whole(self, term: Vector, estimate: Vector, cut: Vector | None) -> Sample:
        """Return the sample where the torque may be beyond its limit, or the term was cut."""
        inverse, product = self._rows[15:17].tolist()
        tau: Vector = [i - c - s for i, c, s in zip(inverse, product, term)]
        excess = None
        if self._limits is not None:
            tau, excess = self._limited(tau)
        self._previous = tau
        if self._observing:
            lack, push = [i - t for i, t in zip(inverse, tau)], self._push.tolist()
            if excess is not None and self._limits is not None and self._limits.anti_windup:
                push = [m + x for m, x in zip(push, excess)]  # M times what went to ξ, / (b h).
            self._ahead = self._observer.followed(estimate, push, lack, cut)
            self._observer.estimate = estimate
            self._last[:] = self._mass
        return _new(ArraySample, (tau, term, excess, self._keep()))

    def _limited(self, wanted: Vector) -> tuple[Vector, Vector | None]:
        """Return the torque within its limits and what they cut off; keep that out of ξ."""
        assert self._limits is not None
        tau = self._limits.restrain(wanted, self._previous)
        if tau == wanted:
            return tau, None
        excess = [w - t for w, t in zip(wanted, tau)]
        if self._limits.anti_windup:
            lost = self._filter.shift(np.linalg.solve(self._model.mass, excess).tolist())
            self._filter.state = [x + y for x, y in zip(self._filter.state, lost)]
        return tau, excess

    def _last_mass(self) -> Rows:
        """Return M of the last sample."""
        rows: Rows = self._matrices[2 * self._model.n:].tolist()
        return rows

    def _linear(self, errors: Errors) -> Array:
        """Return K: the law in lists asked for each column."""
        n, filter_ = self._model.n, self._filter
        columns = []
        for q, q_d, dq_d, ddq_d, state, dq in np.eye(6 * n).reshape(-1, 6, n).tolist():
            e, de, feedback = errors(q, dq, q_d, dq_d)
            v = filter_.output(de, state)
            columns.append([
                [a + f for a, f in zip(ddq_d, feedback)],
                [y / filter_.scale for y in filter_.drift(v, feedback)],
                v, e, de, filter_.advance(state, de, feedback)])
        rows: Array = np.array(columns).reshape(6 * n, 6 * n).T
        return rows


def _flat(x: Array) -> memoryview:
    """Return a contiguous array as it lies in memory."""
    return (x if x.flags.c_contiguous else x.T).data.cast('B')

"""
Switching `implicit`: the backward-Euler discretisation of Ka sgn(v).

The term z is the element of Ka Sgn(v) at the *next* sample, so that it can rest anywhere between
-Ka and Ka once v is 0 (Acary & Brogliato 2010; Huber, Acary & Brogliato 2016; see
docs/theory.md)::

    z ∈ Ka Sgn(v⁺),     v⁺ = b h M⁻¹ (w - z),     w = M y / (b h) - C v

Where w is within ±Ka it is the solution. Otherwise joints at their bound push the others through
M⁻¹: z is the point of the box |z_i| ≤ ka_i nearest to w in the metric of M⁻¹, whatever b h.
"""

from __future__ import annotations

from ctc_chattering.control.error_filter import ErrorFilter
from ctc_chattering.control.switching.base import Switching
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.linear_algebra import Array


class Implicit(Switching):
    """
    The term for which v vanishes at the next sample, as far as Ka allows.

    Parameters
    ----------
    ka : array, shape (n,)
        Gains [N·m].
    filter_ : ErrorFilter
        Whose coefficients predict v.

    """

    def __init__(self, ka: Array, filter_: ErrorFilter) -> None:
        self._ka, self._filter = ka, filter_

    def term(self, v: Array, u: Array, mass: Array, compensation: Array
             ) -> tuple[Array, Array | None]:
        """Return z for no perturbation."""
        return nearest(mass, self.unclipped(v, u, mass, compensation), self._ka), None

    def unclipped(self, v: Array, u: Array, mass: Array, compensation: Array) -> Array:
        """Return w, shape (n,) [N·m]; arguments as `term` has them."""
        nominal = self._filter.nominal_response(v, u)
        wanted: Array = mass.dot(nominal / self._filter.scale) - compensation
        return wanted

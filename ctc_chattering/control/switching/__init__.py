"""The ways to evaluate the chattering term of law (6), Ka sgn(v), one a module."""

from __future__ import annotations

from ctc_chattering.control.error_filter import ErrorFilter
from ctc_chattering.control.perturbation_observer import PerturbationObserver
from ctc_chattering.control.switching.base import Switching
from ctc_chattering.control.switching.boundary_layer import BoundaryLayer
from ctc_chattering.control.switching.implicit import Implicit
from ctc_chattering.control.switching.implicit_observer import ImplicitObserver
from ctc_chattering.control.switching.sign import Sign
from ctc_chattering.numerics.linear_algebra import Array

__all__ = ['SWITCHINGS', 'BoundaryLayer', 'Implicit', 'ImplicitObserver', 'Sign', 'Switching',
           'make_switching']

#: Values of the parameter ``switching``.
SWITCHINGS = ('sign', 'boundary_layer', 'implicit', 'implicit_observer')


def make_switching(name: str, ka: Array, width: float, filter_: ErrorFilter,
                   observer: PerturbationObserver) -> Switching:
    """
    Return the switching of a name.

    Parameters
    ----------
    name : str
        One of `SWITCHINGS`.
    ka : array, shape (n,)
        Gains [N·m].
    width : float
        Half the width of the boundary layer [rad/s].
    filter_, observer : ErrorFilter, PerturbationObserver
        Those of the controller.

    """
    if name == 'sign':
        return Sign(ka)
    if name == 'boundary_layer':
        return BoundaryLayer(ka, width)
    if name == 'implicit':
        return Implicit(ka, filter_)
    return ImplicitObserver(ka, filter_, observer)

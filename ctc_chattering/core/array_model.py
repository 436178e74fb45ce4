"""A model that has its matrices as arrays, all of them for one state in one call."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ctc_chattering.core.model import Model

Array = npt.NDArray[np.float64]


class ArrayModel(Model):
    """
    A `Model` with an `evaluator`: the controller does a whole step in a few array products.

    With two joints lists are faster, with seven arrays are.

    Attributes
    ----------
    mass, coriolis : array, shape (n, n), contiguous
        M(q) and C(q, dq). Like `moment` the same object for good, filled by the evaluator,
        and to be read before any other method is called.
    moment : array, shape (n,)
        G(q) / gravity.
    gravity : float
        Acceleration of gravity [m/s²].

    """

    mass: Array
    coriolis: Array
    moment: Array
    gravity: float

    @abstractmethod
    def evaluator(self, q: Array, dq: Array) -> Callable[[], None]:
        """
        Return a function that fills the arrays for what stands in `q` and `dq` when it is called.

        Parameters
        ----------
        q, dq : array, shape (n,), contiguous
            Position and velocity.

        """

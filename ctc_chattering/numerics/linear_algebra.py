"""Types of vectors and matrices: the plant has sequences of floats, the control step arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Vector = Sequence[float]
Rows = Sequence[Sequence[float]]

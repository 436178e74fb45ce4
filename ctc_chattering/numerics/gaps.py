# Copyright 2026 The ctc_chattering maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Samples that a run lacks: the recorder dropped them, or the robot did not send them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def missing(t: npt.NDArray[np.float64], period: float) -> npt.NDArray[np.int64]:
    """
    Return how many samples are missing after each sample but the last, shape (N - 1,).

    Parameters
    ----------
    t : ndarray, shape (N,)
        Times of the samples, increasing [s].
    period : float
        Sample period [s].

    """
    return np.maximum(np.rint(np.diff(t) / period).astype(np.int64) - 1, 0)

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

"""
Response of a sampled loop to its reference.

`learning/design.py` asks for it. With z = exp(i ω h), the loop of (XL2) for M̂ = ρ M, and the
reference r exp(i ω t), which enters with its derivatives and with the samples of the delay::

    T(ω) = E_q (z I - A_ρ)⁻¹ B_ρ v(ω),     v(ω) = (1, i ω, -ω²) zᵃ,     a = 0 ... delay   (RR1)

T is the matrix from r to the measured q, 1 for an ideal loop.
"""

from __future__ import annotations

from ctc_chattering.margins.loop_margins import Loops
from ctc_chattering.numerics.linear_algebra import Array, ComplexArray
import numpy as np


def reference_response(loops: Loops, omega: Array, ratio: float = 1.0) -> ComplexArray:
    """
    Return T of (RR1) at each M̂ of `loops` and each frequency.

    Parameters
    ----------
    loops : Loops
        Of laws that were computed ``with_reference``.
    omega : array, shape (K,)
        ω [rad/s].
    ratio : float
        ρ, M̂ over M.

    Returns
    -------
    array, shape (masses, K, n, n)

    """
    n = len(loops.masses[0])
    z = np.exp(1j * omega * loops.period)
    responses = []
    for loop in loops.sampled:
        closed, driven = loop.closed(ratio), loop.driven(ratio)
        ahead = z[:, np.newaxis] ** np.arange(driven.shape[1] // (3 * n))
        derivatives = np.stack([np.ones_like(z), 1j * omega, -omega ** 2], axis=1)
        v = (ahead[:, :, np.newaxis] * derivatives[:, np.newaxis]).reshape(len(z), -1, 1, 1)
        entry = (v * np.eye(n)).reshape(len(z), -1, n)
        resolvent = z[:, np.newaxis, np.newaxis] * np.eye(len(closed)) - closed
        responses.append(np.linalg.solve(resolvent, driven @ entry)[:, :n])
    return np.array(responses)

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

"""The largest gain of a sampled system, against closed forms and fine grids of frequencies."""

from __future__ import annotations

from ctc_chattering.numerics.linear_algebra import peak_gain
import numpy as np


def test_of_a_sharp_resonance() -> None:
    """A pair of poles 1e-6 within the unit circle, between the points of any coarse grid."""
    r, angle = 1.0 - 1e-6, 1.2345
    A = r * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    z = np.exp(1j * (angle + np.linspace(-3e-6, 3e-6, 2001)))
    B, C = np.array([[1.0], [0.0]]), np.array([[0.0, 1.0]])
    exact = max(abs((C @ np.linalg.solve(x * np.eye(2) - A, B)).item()) for x in z)
    assert exact <= peak_gain(A, B, C) < 1.003 * exact


def test_of_random_systems() -> None:
    rng = np.random.default_rng(0)
    z = np.exp(1j * np.linspace(0.0, np.pi, 3000))[:, np.newaxis, np.newaxis]
    for m, k in ((3, 1), (6, 2), (8, 3)):
        A, B, C = (rng.standard_normal(shape) for shape in ((m, m), (m, k), (k, m)))
        A *= 0.98 / np.abs(np.linalg.eigvals(A)).max()
        scale = np.geomspace(1e-4, 1e4, m)
        responses = C @ np.linalg.solve(z * np.eye(m) - A, B[np.newaxis])
        exact = np.linalg.svd(responses, compute_uv=False).max()
        found = peak_gain(scale[:, np.newaxis] * A / scale, scale[:, np.newaxis] * B, C / scale)
        assert exact <= found < 1.003 * exact


def test_of_an_unstable_system_and_of_none() -> None:
    assert peak_gain(np.array([[1.0]]), np.ones((1, 1)), np.ones((1, 1))) == np.inf
    assert peak_gain(np.array([[0.5]]), np.ones((1, 1)), np.zeros((1, 1))) == 0.0

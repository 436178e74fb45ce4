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

"""P in short windows."""

from __future__ import annotations

from ctc_chattering.bags.recording import Stretch
from ctc_chattering.dynamics.registry import make_model
from ctc_chattering.identification.timing import ShortWindows, Timing
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import Rows
import numpy as np
import pytest

H, N, NOISE = 1e-3, 3000, 4e-6


def short(vibration: float, *delays: int) -> ShortWindows:
    """Return P where the torque vibrates at 20 Hz, with noise of the positions."""
    t = H * np.arange(N)
    model, rng = make_model('two_link', 9.81, ('a', 'b')), np.random.default_rng(1)
    q, dq, ddq = (np.stack((x, 0.5 * x), axis=1) for x in (
        np.sin(2.0 * t), 2.0 * np.cos(2.0 * t), -4.0 * np.sin(2.0 * t)))
    tau = np.array([model.inverse_dynamics(*x) for x in zip(
        q.tolist(), dq.tolist(), ddq.tolist())]) + vibration * np.sin(40.0 * np.pi * t)[:, None]
    part = Stretch(0.0, H, q + NOISE * rng.normal(size=q.shape), None, tau)
    zero = np.zeros(2)
    timing = Timing('command', float(delays[-1]), zero, zero, {
        d: np.zeros((3, 2)) for d in delays}, zero, np.full((3, 2), np.inf), zero == 0.0)
    return ShortWindows.of([part], [Rows.of(part, model, TestFunction(H, H * N))], [model],
                           timing)


def test_noise_is_that_of_positions_and_vibration_is_none() -> None:
    still, moved = short(0.0, 0), short(4.0, 0)
    spread = np.std(still.perturbation[::6], axis=0)
    assert moved.noise == pytest.approx(still.noise) and still.noise == pytest.approx(
        spread, rel=0.3)
    assert (np.abs(moved.perturbation).max(axis=0) > 6.0 * moved.noise).all()


def test_delays_that_are_not_told_apart_hide_nothing() -> None:
    """A joint with a spring looks like a delay, by which P would be less."""
    at_once, late, unsure = short(1.0, 0), short(1.0, 20), short(1.0, 0, 20)
    assert (np.abs(unsure.perturbation) == np.maximum(
        np.abs(at_once.perturbation), np.abs(late.perturbation))).all()

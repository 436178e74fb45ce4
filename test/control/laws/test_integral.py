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

"""Computed torque with integral action."""

import math
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.errors import CtcError
from laws import error, GAINS, H, inputs, KP, run, Terms
import numpy as np
import pytest

KI = np.array([300.0, 900.0])


@pytest.mark.parametrize('anti_windup', [True, False])
def test_back_calculation_by_hand(anti_windup: bool) -> None:
    """Check that x tracks M⁻¹ times what is cut off, within the integral time Kp / Ki."""
    rng, x, cuts = np.random.default_rng(5), np.zeros(2), 0
    most = np.array([150.0, 20.0])
    law = Controller(ControllerConfig.from_mapping({
        **GAINS, 'law': 'integral', 'ki': KI.tolist(), 'effort_limit': most.tolist(),
        'anti_windup': anti_windup}))
    for _ in range(200):
        rows = inputs(rng, 0.3)
        at = Terms(rows)
        wanted = at.computed_torque + at.M @ x
        tau = np.clip(wanted, -most, most)
        np.testing.assert_allclose(law.step(*rows).tau, tau, rtol=1e-10, atol=1e-9)
        x = x + H * KI * at.e
        if anti_windup:
            part = [1.0 - math.exp(-H * ki / kp) for ki, kp in zip(KI, np.diag(KP))]
            x = x - part * np.linalg.solve(at.M, wanted - tau)
        cuts += int((wanted != tau).any())
    assert cuts > 100


def test_the_integral_does_not_wind_up() -> None:
    """Check the error after a second at the limit: without anti-windup it is far larger."""
    values: dict[str, Any] = {
        'kv': [60.0] * 2, 'kp': [1200.0] * 2, 'ki': [8000.0] * 2, 'effort_limit': [60.0, 10.0]}
    good, bad = (error(run('integral', 3.0, 0.0, 0.5, 0.0, anti_windup=on, **values))
                 for on in (True, False))
    assert (good < 0.05 * bad).all()


def test_the_error_shrinks_under_friction() -> None:
    """Check a triple pole at 100 rad/s against the same law without the integral."""
    gains: dict[str, Any] = {'kv': [300.0] * 2, 'kp': [3e4] * 2}
    with_, without = (error(run('integral', ki=[ki] * 2, **gains)) for ki in (1e6, 0.0))
    assert (with_ < 0.6 * without).all()


def test_beyond_kv_kp_it_diverges() -> None:
    """Check condition (3), Ki < Kv Kp = 5000, from both sides."""
    below, at_start = (error(run('integral', t, 0.0, 0.05, ki=[2500.0] * 2)) for t in (5.0, 1.0))
    assert (below < 0.5 * at_start).all()
    try:
        beyond = error(run('integral', 5.0, 0.0, 0.05, ki=[7000.0] * 2))
    except CtcError:
        return
    assert (beyond > 2.0 * at_start).all()

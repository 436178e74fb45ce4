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

"""Law observer_feedback on an arm with real drives and encoders; by hand: test/validation."""

from __future__ import annotations

from contextlib import nullcontext
import math
from typing import Any

from ctc_chattering.control import oscillation
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.control.observer import design_observer, ModelTerms, Observed
from ctc_chattering.dynamics.drive_response import discretize_drives
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation import closed_loop
from ctc_chattering.simulation.closed_loop import Run
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
from laws import error, variation
import numpy as np
from oracles import Array
import pytest

H, LAG, DELAY = 1e-3, 2e-3, 1
RATE = np.array([5e3, 1e3])
KA, W, GAMMA = np.array([60.0, 30.0]), 100.0, 20.0
KP, KV = 1e4 * np.eye(2), 200.0 * np.eye(2)
#: Drives and encoders as they are: every cell of the docs has these.
REAL: dict[str, Any] = {
    'actuator_lag': [LAG, LAG], 'torque_rate_limit': RATE.tolist(), 'input_delay': DELAY,
    'encoder_resolution': [1e-5, 1e-5], 'velocity_sensor': 'difference'}
KNOWN: dict[str, Any] = {
    'actuator_lag': [LAG, LAG], 'torque_rate_limit': RATE.tolist(), 'input_delay': DELAY}
GAINS: dict[str, Any] = {
    'law': 'observer_feedback', 'kp': [1e4, 1e4], 'kv': [200.0, 200.0], 'ka': KA.tolist(),
    'estimator_bandwidth': W, 'friction_learning': GAMMA}


def poles(scale: float) -> Array:
    """Return the poles of one joint without friction, for M̂ = scale M, by unit vectors."""
    drives = discretize_drives(np.zeros(1), np.full(1, math.inf), H)
    observer = design_observer(drives, W, np.full(1, 1e12))
    mass, none = np.full((1, 1), scale), np.zeros(1)
    columns = []
    for q, dq, q_o, dq_o, P, slope in np.eye(6):
        at = observer.correct(Observed(*np.array([[q_o], [dq_o], [0.0], [P], [slope]])), mass,
                              np.array([q]))
        tau = scale * (-KV[0, 0] * at.dq - KP[0, 0] * at.q) + at.perturbation
        at = observer.predict(ModelTerms(at, mass, none), none, tau)
        true = q + H * dq + 0.5 * H * H * tau[0], dq + H * tau[0]
        columns.append([*true, at.q[0], at.dq[0], at.perturbation[0], at.slope[0]])
    found: Array = np.abs(np.linalg.eigvals(np.array(columns).T))
    return found


def test_the_range_of_inertia_that_is_stable() -> None:
    """Check what the law's page says: 0.47 < c < 3.1."""
    with np.errstate(all='ignore'):
        for scale, stable in ((0.46, False), (0.47, True), (1.0, True), (3.1, True),
                              (3.2, False)):
            assert (poles(scale).max() < 1.0) == stable, scale


def real(law: dict[str, Any], scale: float, duration: float, start: float = 0.0) -> Run:
    """Simulate the arm as drives and encoders are, from rest at q = 0, with a wrong model."""
    return closed_loop.run_closed_loop(
        PlantConfig.from_mapping({'duration': duration, 'coulomb_friction': [9.9] * 2, **REAL}),
        ControllerConfig.from_mapping(
            {'inertia_scale': scale, 'gravity_scale': scale, 'input_delay': DELAY, **law}),
        ReferenceConfig(start_duration=start), truth=True)


@pytest.mark.parametrize('scale', [pytest.param(0.9, marks=pytest.mark.slow), 1.1])
def test_on_an_arm_as_drives_and_encoders_are(scale: float) -> None:
    """Check error and variation, after a start 3 rad off that costs bandwidth for 6 s."""
    found = real({**GAINS, **KNOWN}, scale, duration=8.0)
    assert (error(found, 2.0) < [3.5e-5, 1.6e-4]).all()
    assert (variation(found, 2.0) < [1300.0, 230.0]).all()


@pytest.mark.parametrize('guarded', [True, False])
@pytest.mark.parametrize('wrong', [3.0, pytest.param(math.inf, marks=pytest.mark.slow)])
def test_drives_that_are_slower_than_configured(
        wrong: float, guarded: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Check that the law loses bandwidth and not the robot; without the guard it diverges."""
    if not guarded:
        monkeypatch.setattr(oscillation, 'RETREAT_RATE_RAD_S', 0.0)
    law = {**GAINS, **KNOWN, 'estimator_bandwidth': 200.0, 'error_limit': [3.0, 3.0],
           'torque_rate_limit': (wrong * RATE).tolist(), 'compiled': guarded}
    with nullcontext() if guarded else pytest.raises(CtcError, match='exceeds error_limit'):
        found = real(law, 1.1, 2.5, start=2.0)
        assert (error(found, 1.0) < [0.02, 0.15]).all()

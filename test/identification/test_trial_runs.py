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

"""Gains that fail on a robot within the intervals are not recommended."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.identification import trial_runs as module
from ctc_chattering.identification.findings import Reason, Severity
from ctc_chattering.identification.gains import recommend, Recommendation
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.perturbation import measure_perturbation, MeasuredPerturbation
from ctc_chattering.identification.trial_runs import (
    draw_robots,
    parameter_values,
    setups_tried,
    trial_runs,
)
from ctc_chattering.runs.score import Score
from identified_robots import identified, Recorded
import numpy as np
import pytest


# Made where a test needs them: not in each process that collects tests.
def made() -> Recorded:
    return identified(12.0)[0]


def base() -> Identification:
    return identified(12.0)[1]


@cache
def measured() -> MeasuredPerturbation:
    return measure_perturbation(base(), False)


@cache
def gains() -> Recommendation:
    return recommend(base(), measured(), made().model)


def values_of(recommended: Recommendation) -> dict[str, dict[str, Any]]:
    return parameter_values(base(), recommended, made().model,
                            {'model': 'two_link', 'gravity': 9.81}, None)


def setups() -> list[Setup]:
    return setups_tried(gains(), values_of(gains()))


def surviving(monkeypatch: pytest.MonkeyPatch, most: float) -> Recommendation:
    """Return what is recommended where poles above `most` diverge."""
    def run(setup: Setup, _window: Any) -> Score:
        controller = setup.controller
        if controller.law != 'compensation' and 0.5 * controller.kv[0] > most:
            return Score(failure='diverged')
        return Score(rms=(1e-4, 1e-4), saturated=0.0)
    monkeypatch.setattr(module, 'score', run)
    return trial_runs(base(), measured(), gains(), setups(), count=6)


def test_the_pole_steps_down_until_all_draws_survive(monkeypatch: pytest.MonkeyPatch) -> None:
    found = surviving(monkeypatch, 60.0)
    assert found.values['kv'] == [100.0, 100.0]
    assert [(trial.pole, trial.draws) for trial in found.trials] == [
        (100.0, 6), (70.0, 6), (50.0, 6)]
    first, _, last = (trial.failed for trial in found.trials)
    assert first is not None and (first.number, first.failure) == (1, 'diverged')
    assert last is None


def test_gains_are_refused_if_none_survive(monkeypatch: pytest.MonkeyPatch) -> None:
    finding = surviving(monkeypatch, 1.0).findings[-1]
    assert (finding.reason, finding.severity) == (Reason.NO_GAINS, Severity.REFUSED)
    assert finding.values['trial'].failed is not None


@pytest.mark.parametrize(('share', 'survives'), [(0.04, True), (0.06, False)])
def test_gains_need_not_track_as_well_as_those_of_a_stiff_recording(
        monkeypatch: pytest.MonkeyPatch, share: float, survives: bool) -> None:
    """Errors of 5 % of the amplitude are allowed, however small those of `compensation` are."""
    amplitude = setups()[0].reference.amplitude

    def run(setup: Setup, _window: Any) -> Score:
        of_law = 1e-3 if setup.controller.law == 'compensation' else share
        return Score(rms=tuple(of_law * x for x in amplitude), saturated=0.0)
    monkeypatch.setattr(module, 'score', run)
    found = trial_runs(base(), measured(), gains(), setups(), count=2)
    assert (found.trials[0].failed is None) == survives


def test_draws_have_the_corners_and_are_within_the_intervals() -> None:
    lags = np.array([[0.0, 1e-3], [1e-3, 2e-3], [2e-3, 3e-3]])
    timing = dataclasses.replace(base().timing, delays={0: lags, 2: np.zeros((3, 2))})
    plant = parameter_file.load(None, values_of(gains())).plant
    found = dataclasses.replace(base(), timing=timing)
    draws = list(draw_robots(found, measured(), plant, 20, 1))
    assert [x.delay for x in draws[:8]] == [0] * 4 + [2] * 4
    corners = {(round(x.model_scale, 6), x.friction_end) for x in draws[:4]}
    assert corners == {(0.95, -1), (0.95, 1), (1.05, -1), (1.05, 1)}
    for draw in draws:
        low, _, high = timing.delays[draw.delay]
        assert (draw.lag >= low).all() and (draw.lag <= high).all()
        assert draw.values['plant']['actuator_lag'] == draw.lag.tolist()
        assert draw.values['controller']['inertia_scale'] == draw.model_scale
    again = draw_robots(found, measured(), plant, 20, 1)
    assert [x.values for x in again] == [x.values for x in draws]


def test_the_identified_robot_survives(monkeypatch: pytest.MonkeyPatch) -> None:
    short = dataclasses.replace(module.TRIAL, duration_s=1.3)
    monkeypatch.setattr(module, 'TRIAL', short)
    found = trial_runs(base(), measured(), gains(), setups(), count=1)
    assert found.trials[0].failed is None

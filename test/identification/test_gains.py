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

"""Gains follow from what was identified, hold on another run, and make a file that works."""

from __future__ import annotations

import dataclasses
from functools import cache
from pathlib import Path

from ctc_chattering.analysis.metrics import metrics
from ctc_chattering.analysis.result import simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.findings import Estimate, Gap, Reason
from ctc_chattering.identification.friction import JointFriction
from ctc_chattering.identification.gains import recommend, Recommendation
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.perturbation import measure_perturbation, MeasuredPerturbation
from ctc_chattering.identification.trial_runs import parameter_values
from ctc_chattering.identification.verdict import verdicts
from identified_robots import identified, record, Recorded, windows_of
import numpy as np
import pytest


# Made where a test needs them: not in each process that collects tests.
def made() -> Recorded:
    return identified(16.0, 1e-5)[0]


def base() -> Identification:
    return identified(16.0, 1e-5)[1]


@cache
def measured() -> MeasuredPerturbation:
    return measure_perturbation(base(), False)


def recommended(found: Identification | None = None) -> Recommendation:
    return recommend(found or base(), measured(), made().model)


def test_ka_holds_the_largest_perturbation() -> None:
    """|P| of a joint is at most Coulomb friction and viscous friction at its fastest."""
    speed = np.abs(made().run.dq).max(axis=0)
    largest = np.array(made().plant.coulomb_friction) + made().plant.viscous_friction * speed
    ka = np.array(recommended().values['ka'], float)
    assert measured().peak == pytest.approx(largest, rel=0.03)
    assert (ka >= 1.15 * largest).all() and (ka <= 1.3 * largest).all()


def test_lag_and_delay_slow_the_gains_down() -> None:
    lag = np.array([6e-3, 2e-3])
    timing = dataclasses.replace(base().timing, delay=3.0, lag=lag,
                                 delays={3: np.tile(lag, (3, 1))})
    values = recommended(dataclasses.replace(base(), timing=timing)).values
    assert values['input_delay'] == 3
    assert values['observer_bandwidth'] * 6e-3 <= 0.3
    assert values['kp'] == [40.0 ** 2] * 2
    assert values['kv'] == [80.0] * 2


def test_the_values_make_a_parameter_file_that_beats_compensation(tmp_path: Path) -> None:
    """On a motion that was not recorded, tenfold on every joint."""
    values = parameter_values(base(), recommended(), made().model,
                              {'model': 'two_link', 'gravity': 9.81}, None)
    file = tmp_path / 'identified.yaml'
    parameter_file.dump(values, file)
    plant = parameter_file.load(file).plant
    assert plant.coulomb_friction == pytest.approx(made().plant.coulomb_friction, rel=0.02)
    errors = {}
    for law in ('compensation', 'chattering'):
        setup = parameter_file.load(file, {'controller': {'law': law}})
        errors[law] = np.array(metrics(simulate(setup).run)['rms_error_rad'])
    assert (errors['compensation'] > 10.0 * errors['chattering']).all()


def test_another_run_is_predicted_and_ka_holds_there() -> None:
    ka = recommended().values['ka']
    for friction, holds in ((made().plant.coulomb_friction, True), ((14.0, 14.0), False)):
        other = record('two_link', 7, 8.0, plant={
            'velocity_noise': [1e-5] * 2, 'coulomb_friction': list(friction)})
        data = windows_of(base(), other.recording.checked(), made().model)
        fit = dataclasses.replace(base().fit, data=data)
        run = measure_perturbation(dataclasses.replace(base(), fit=fit), False)
        whole, unexplained = (np.nanmean(np.square(x), axis=0)
                              for x in (run.measured, run.residual))
        assert (unexplained < 0.05 ** 2 * whole).all() == holds
        assert (run.peak < ka).all() == holds


def without_friction(i: int) -> Identification:
    """Return an identification in which the friction of a joint is not known."""
    used = base().fit.data.used.copy()
    used[:, i] = False
    fit = dataclasses.replace(base().fit, data=dataclasses.replace(base().fit.data, used=used))
    friction = list(base().friction)
    friction[i] = JointFriction.unknown()
    return dataclasses.replace(base(), fit=fit, friction=friction)


def test_a_joint_that_hardly_moves_has_no_gains_and_no_file() -> None:
    found = without_friction(1)
    gains = recommended(found)
    for name in ('ka', 'friction_level', 'torque_rate_limit'):
        values = gains.values[name]
        assert values[0] > 0.0 and values[1] is None
    verdict = verdicts(found, gains.findings)[1]
    assert not verdict.usable
    assert verdict.findings[0].reason == Reason.NOT_EXCITED
    with pytest.raises(CtcError, match='hardly moves'):
        parameter_values(found, gains, made().model, {'model': 'two_link'}, None)


def test_without_velocities_the_plant_takes_differences() -> None:
    found = dataclasses.replace(base(), noise=[Estimate.unknown(Gap.NO_VELOCITIES)] * 2)
    gains = recommended(found)
    plant = parameter_values(found, gains, made().model, {'model': 'two_link'}, None)['plant']
    assert plant['velocity_sensor'] == 'difference' and 'velocity_noise' not in plant


def test_a_slow_period_slows_the_gains_down() -> None:
    """At 4 ms, with a delay of 1 and a lag of 3.8 ms, or one of 2 and none: the slower counts."""
    lag = np.full(2, 3.8e-3)
    timing = dataclasses.replace(base().timing, delay=1.0, lag=lag, delays={
        1: np.array([0.9 * lag, lag, 1.1 * lag]), 2: np.zeros((3, 2))})
    found = dataclasses.replace(base(), timing=timing,
                                clock=dataclasses.replace(base().clock, period=4e-3))
    pole = 0.5 * np.array(recommended(found).values['kv'], float)
    assert (pole * (1.1 * 3.8e-3 + 8e-3) <= 0.4).all() and (pole > 30.0).all()


def test_the_motion_keeps_limits_that_the_recorded_one_did_not_keep() -> None:
    class Slow(TwoLink):
        velocity_limits = (0.2, 0.4)

    values = parameter_values(base(), recommended(), Slow(9.81), {'model': 'two_link'}, None)
    motion = values['reference']
    speed = 2.0 * np.pi * np.array(motion['amplitude']) * motion['frequency']
    recorded = np.abs(base().fit.data.windows.velocity).max(axis=0)
    assert (speed <= (0.2, 0.4)).all() and (recorded > 0.4).all()

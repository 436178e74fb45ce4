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

"""A run and its numbers: definitions written out, failures, and what is no failure."""

from __future__ import annotations

import dataclasses
from math import inf
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.metrics import metrics
from ctc_chattering.analysis.result import Result, simulate
from ctc_chattering.compiled.machine_code import MACHINE_CODE, PLAIN_PYTHON
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.compilation import compile_setups
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.errors import CtcError, MachineError
from ctc_chattering.runs.run_lists import result_row
from ctc_chattering.runs.score import (
    result_columns,
    Score,
    score,
    simulate_truth,
    slips_at_rest,
    torque_limits,
)
from ctc_chattering.runs.spec import Failure
from ctc_chattering.simulation.closed_loop import Run, run_closed_loop
from map_specs import evaluate, ON_TRACK
import numpy as np
import pytest

WINDOW = (0.05, 0.1)


def setup(**plant: Any) -> Setup:
    return parameter_file.load(None, {
        'plant': {**ON_TRACK, 'duration': 0.1, **plant}, 'controller': {'switching': 'implicit'}})


def test_numbers_are_those_of_the_samples_with_none_missing_in_between() -> None:
    """Check a run that lacks samples, in the window and as a whole."""
    made = setup(sample_loss=0.2)
    result = simulate_truth(made)
    found, run = score(made, WINDOW, lambda _: result), result.run
    part, whole = (metrics(run, x, period=1e-3) for x in (WINDOW, (0.0, 0.1)))
    assert part['missing_samples'] == found.missing != 0
    assert found.variation == tuple(part['torque_variation_nm_per_s'])
    assert found.peak_rate == tuple(whole['max_torque_rate_nm_per_s'])
    assert found.peak == tuple(np.abs(run.tau).max(axis=0))
    row = result_row(found, 2, NONE)
    assert (row['error'], row['variation']) == (max(found.rms), max(found.variation))
    assert [row[f'peak_torque_nm_{i}'] for i in (1, 2)] == list(found.peak)
    assert (found.failure, found.engine) == (
        '', MACHINE_CODE if run.compiled else PLAIN_PYTHON)
    across = score(made, WINDOW, lambda _: result, across_gaps=True)
    assert across.variation == tuple(metrics(run, WINDOW)['torque_variation_nm_per_s'])
    assert across.variation != found.variation


def test_a_failure_has_a_reason_and_no_numbers() -> None:
    found = score(setup(), (0.0501, 0.0502))
    assert found == Score(failure='fewer than two samples from 0.0501 s to 0.0502 s',
                          engine=found.engine)
    assert (found.error, result_row(found, 2, NONE)['variation']) == (inf, None)


@pytest.mark.parametrize(('error', 'text'), [
    (CtcError('it diverged'), 'it diverged'), (ZeroDivisionError('a\nb'), 'the run failed: '
                                               'ZeroDivisionError: a b')])
def test_an_error_of_a_run_is_its_failure(error: Exception, text: str) -> None:
    def run(_: Setup) -> Result:
        raise error

    assert score(setup(), run=run).failure == text


@pytest.mark.parametrize('error', [MemoryError(), OSError(28, 'no space'), KeyboardInterrupt()])
def test_an_error_of_the_machine_is_no_failure_of_the_run(error: BaseException) -> None:
    def run(_: Setup) -> Result:
        raise error

    with pytest.raises((MachineError, KeyboardInterrupt)):
        score(setup(), run=run)


def test_slips_are_counted_at_rest_only() -> None:
    """Check one slip in the window, and those before it, of a short rest and too slow."""
    t, one = np.linspace(0.0, 2.0, 2001), np.zeros((2001, 2))
    dq_d, dq = one.copy(), one.copy()
    dq_d[:300, 0] = 1.0
    dq_d[:1500, 1] = 1.0
    for k in (550, 700, 1550):
        dq[k:k + 20] = (-0.01, 0.01)
    dq[800:820, 0] = 9e-4
    run = Run(t, one, dq, one, dq_d, one, one, one)
    np.testing.assert_allclose(slips_at_rest(run, (0.0, 1.6)), [2.0 / 1.001, 0.0], rtol=5e-3)
    np.testing.assert_allclose(slips_at_rest(run, (0.8, 1.6)), [1.0 / 0.801, 0.0], rtol=5e-3)
    correction = np.random.default_rng(3).normal(size=(2001, 3, 2))
    learned = dataclasses.replace(
        run, dq_d=dq_d + correction[:, 1], ddq_d=one + correction[:, 2], correction=correction)
    np.testing.assert_array_equal(
        slips_at_rest(learned, (0.0, 1.6)), slips_at_rest(run, (0.0, 1.6)))


def test_numbers_use_true_states() -> None:
    coarse = setup(encoder_resolution=[0.01, 0.01])
    seen = simulate(coarse).run
    true = simulate_truth(coarse).run
    assert (true.tau == seen.tau).all()
    assert seen.q[1:] == pytest.approx(0.01 * np.round(seen.q[1:] / 0.01), abs=1e-9)
    assert np.abs(true.q - seen.q).max() > 1e-3


CONFIG = Path(__file__).parents[2] / 'config'
LATE = (0.1, 0.2)
NONE = Failure()


def noisy(plant: dict[str, Any] | None = None, **controller: Any) -> Setup:
    noise = {'velocity_noise': [1e-3, 1e-3], 'noise_seed': 4}
    return parameter_file.load(None, {
        'plant': {**ON_TRACK, **noise, 'duration': 0.2, **(plant or {})},
        'controller': {'switching': 'implicit', **controller}})


WAYS = pytest.mark.parametrize('way', [MACHINE_CODE, PLAIN_PYTHON])


def setup_for(way: str, **controller: Any) -> Setup:
    """Return a setup that is computed in a way."""
    made = noisy({'compiled': way == MACHINE_CODE}, switching='sign', **controller)
    compile_setups([made], print)
    return made


@WAYS
def test_the_numbers_are_those_of_the_true_states(way: str) -> None:
    """Compare with definitions written out, over a plain simulation of these parameters."""
    made = setup_for(way)
    row = evaluate(made, LATE, NONE)
    made = setup_for(PLAIN_PYTHON)
    run = run_closed_loop(made.plant, made.controller, made.reference, truth=True)
    inside = slice(100, 201)
    e, tau = (run.q_d - run.q)[inside], run.tau[inside]
    step = np.abs(np.diff(tau, axis=0))
    expected = {
        'error': np.sqrt((e ** 2).mean(axis=0)).max(),
        'error_share': (np.sqrt((e ** 2).mean(axis=0)) / (0.5 * (
            run.q_d.max(axis=0) - run.q_d.min(axis=0)))).max(),
        'variation': (step.sum(axis=0) / 0.1).max(), 'saturated': 0.0,
        'rms_error_rad_1': np.sqrt((e[:, 0] ** 2).mean()),
        'rms_torque_nm_2': np.sqrt((tau[:, 1] ** 2).mean()),
        'max_torque_step_nm_2': step[:, 1].max(),
        'max_torque_rate_nm_per_s_1': step[:, 0].max() / 1e-3,
        'max_error_norm1_rad': np.abs(e).sum(axis=1).max(), 'missing_samples': 0}
    np.testing.assert_allclose([row[key] for key in expected], list(expected.values()), rtol=1e-6)
    assert (row['engine'], row['failure'], row['reason']) == (way, '', '')
    assert list(row) == list(result_columns(2))


@WAYS
def test_a_run_that_diverges_has_no_numbers(way: str) -> None:
    row = evaluate(setup_for(way, error_limit=[1e-6, 1e-6]), LATE, NONE)
    assert (row.pop('engine'), row.pop('failure')) == ('', 'diverged')
    assert 'error_limit' in row.pop('reason')
    assert set(row.values()) == {None}


def middle_torque(made: Setup) -> float:
    """Return the median torque of joint 1 in the window."""
    run = run_closed_loop(made.plant, made.controller, made.reference, truth=True)
    return float(np.median(np.abs(run.tau[100:, 0])))


def test_the_first_limit_that_is_exceeded_is_named() -> None:
    """Check each kind just above and just below what a run has."""
    limit = middle_torque(noisy())
    made = noisy(effort_limit=[limit, 1e3])
    found = evaluate(made, LATE, NONE)
    run = run_closed_loop(made.plant, made.controller, made.reference, truth=True)
    part = float((np.abs(run.tau[100:, 0]) >= limit).mean())
    assert 0.0 < part < 1.0
    assert found['saturated'] == pytest.approx(part)

    def kind(**most: Any) -> str:
        return str(evaluate(made, LATE, Failure.from_mapping(most))['failure'])
    error = found['error']
    assert kind(error_above=0.99 * error) == 'error'
    assert kind(error_above=1.01 * error) == ''
    assert kind(error_share_above=0.99 * found['error_share']) == 'error'
    assert kind(error_share_above=1.01 * found['error_share']) == ''
    assert kind(saturated_above=0.99 * part) == 'saturated'
    assert kind(saturated_above=1.01 * part) == ''
    assert kind(saturated_above=0.99 * part, error_above=0.99 * error) == 'error'
    far = noisy({'initial_velocity': [9.0, 9.0]}, law='compensation')
    row = evaluate(far, LATE, Failure(not_reached=True))
    assert (row['failure'], row['reason']) == ('not reached', 'v never stays within its band')


def test_the_limit_of_a_torque_is_the_least_of_controller_model_and_drives() -> None:
    panda = parameter_file.load(CONFIG / 'panda.yaml', {
        'controller': {'effort_limit': [np.inf, 50.0, *[np.inf] * 5]},
        'plant': {'torque_saturation': [np.inf, np.inf, 60.0, *[np.inf] * 4]}})
    assert torque_limits(panda) == [87.0, 50.0, 60.0, 87.0, 12.0, 12.0, 12.0]

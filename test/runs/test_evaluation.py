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

"""One run: its numbers are those of the simulation, its failure is that of the limits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from broken_arm import Broken
from ctc_chattering.analysis.compilation import compile_setups
from ctc_chattering.compiled.machine_code import MACHINE_CODE, PLAIN_PYTHON
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.errors import CtcError, MachineError
from ctc_chattering.runs.points import evaluate, refused
from ctc_chattering.runs.score import limits, of_results
from ctc_chattering.runs.spec import Failure
from ctc_chattering.runs.tune import scores_of
from ctc_chattering.simulation.closed_loop import simulate
from map_specs import ON_TRACK
import numpy as np
import pytest

CONFIG = Path(__file__).parents[2] / 'config'
WINDOW = (0.1, 0.2)
NONE = Failure()


def setup(plant: dict[str, Any] | None = None, **controller: Any) -> Setup:
    noise = {'velocity_noise': [1e-3, 1e-3], 'noise_seed': 4}
    return parameter_file.load(None, {
        'plant': {**ON_TRACK, **noise, 'duration': 0.2, **(plant or {})},
        'controller': {'switching': 'implicit', **controller}})


WAYS = pytest.mark.parametrize('way', [MACHINE_CODE, PLAIN_PYTHON])


def setup_for(way: str, **controller: Any) -> Setup:
    """Return a setup that is computed in a way."""
    made = setup({'compiled': way == MACHINE_CODE}, switching='sign', **controller)
    compile_setups([made], print)
    return made


@WAYS
def test_the_numbers_are_those_of_the_true_states(way: str) -> None:
    """Compare with definitions written out, over a plain simulation of these parameters."""
    made = setup_for(way)
    row = evaluate(made, WINDOW, NONE)
    made = setup_for(PLAIN_PYTHON)
    run = simulate(made.plant, made.controller, made.reference, truth=True)
    inside = slice(100, 201)
    e, tau = (run.q_d - run.q)[inside], run.tau[inside]
    step = np.abs(np.diff(tau, axis=0))
    expected = {
        'error': np.sqrt((e ** 2).mean(axis=0)).max(),
        'variation': (step.sum(axis=0) / 0.1).max(), 'saturated': 0.0,
        'rms_error_rad_1': np.sqrt((e[:, 0] ** 2).mean()),
        'rms_torque_nm_2': np.sqrt((tau[:, 1] ** 2).mean()),
        'max_torque_step_nm_2': step[:, 1].max(),
        'max_torque_rate_nm_per_s_1': step[:, 0].max() / 1e-3,
        'max_error_norm1_rad': np.abs(e).sum(axis=1).max(), 'missing_samples': 0}
    np.testing.assert_allclose([row[key] for key in expected], list(expected.values()), rtol=1e-6)
    assert (row['engine'], row['failure'], row['reason']) == (way, '', '')
    assert list(row) == list(of_results(2))


def test_what_is_missing_has_no_number() -> None:
    lost = evaluate(setup({'sample_loss': 0.3}), WINDOW, NONE)
    assert lost['missing_samples'] > 0
    never = evaluate(setup({'initial_velocity': [9.0, 9.0]}, law='compensation'), WINDOW, NONE)
    assert never['reaching_time_s'] is None
    assert never['error'] > 0.0


@WAYS
def test_a_run_that_diverges_has_no_numbers(way: str) -> None:
    row = evaluate(setup_for(way, error_limit=[1e-6, 1e-6]), WINDOW, NONE)
    assert (row.pop('engine'), row.pop('failure')) == ('', 'diverged')
    assert 'error_limit' in row.pop('reason')
    assert set(row.values()) == {None}


def middle_torque(made: Setup) -> float:
    """Return the median torque of joint 1 in the window."""
    run = simulate(made.plant, made.controller, made.reference, truth=True)
    return float(np.median(np.abs(run.tau[100:, 0])))


def test_the_first_limit_that_is_exceeded_is_named() -> None:
    """Check each kind just above and just below what a run has."""
    limit = middle_torque(setup())
    made = setup(effort_limit=[limit, 1e3])
    found = evaluate(made, WINDOW, NONE)
    run = simulate(made.plant, made.controller, made.reference, truth=True)
    part = float((np.abs(run.tau[100:, 0]) >= limit).mean())
    assert 0.0 < part < 1.0
    assert found['saturated'] == pytest.approx(part)

    def kind(**most: Any) -> str:
        return str(evaluate(made, WINDOW, Failure.from_mapping(most))['failure'])
    error = found['error']
    assert kind(error_above=0.99 * error) == 'error'
    assert kind(error_above=1.01 * error) == ''
    assert kind(saturated_above=0.99 * part) == 'saturated'
    assert kind(saturated_above=1.01 * part) == ''
    assert kind(saturated_above=0.99 * part, error_above=0.99 * error) == 'error'
    far = setup({'initial_velocity': [9.0, 9.0]}, law='compensation')
    row = evaluate(far, WINDOW, Failure(not_reached=True))
    assert (row['failure'], row['reason']) == ('not reached', 'v never stays within its band')


def test_the_limit_of_a_torque_is_the_least_of_controller_model_and_drives() -> None:
    limit = middle_torque(setup())
    for plant, controller in (({'torque_saturation': [limit, 1e3]}, {}),
                              ({'torque_saturation': [5e3, 1e3]}, {'effort_limit': [limit, 1e3]})):
        row = evaluate(setup(plant, **controller), WINDOW, NONE)
        assert 0.0 < row['saturated'] < 1.0
    panda = parameter_file.load(CONFIG / 'panda.yaml', {
        'controller': {'effort_limit': [np.inf, 50.0, *[np.inf] * 5]},
        'plant': {'torque_saturation': [np.inf, np.inf, 60.0, *[np.inf] * 4]}})
    assert limits(panda) == [87.0, 50.0, 60.0, 87.0, 12.0, 12.0, 12.0]


def test_too_few_samples_are_no_number() -> None:
    row = evaluate(setup(), (0.1001, 0.1002), NONE)
    assert (row['failure'], row['reason']) == (
        'diverged', 'fewer than two samples from 0.1001 s to 0.1002 s')


def test_refused() -> None:
    row = refused(2, CtcError('no such value'))
    assert list(row) == list(of_results(2))
    assert (row['failure'], row['reason'], row['error']) == ('refused', 'no such value', None)


def test_a_row_says_what_simulated_it() -> None:
    elastic = setup({'joint_stiffness': [1e4, 1e4], 'motor_inertia': [1.0, 0.1]},
                    law='compensation')
    assert evaluate(elastic, WINDOW, NONE)['engine'] == PLAIN_PYTHON


@pytest.mark.parametrize(('error', 'kind'), [
    (MemoryError, MachineError), (OSError, MachineError), (ImportError, MachineError),
    (RuntimeError, None)])
def test_what_the_machine_cannot_do_is_no_failure_of_the_run(
        error: type[Exception], kind: type[CtcError] | None,
        monkeypatch: pytest.MonkeyPatch) -> None:
    """Check a map and a search for gains; what a model of one's own computes does count."""
    monkeypatch.setattr(Broken, 'error', error)
    made = broken()
    if kind is None:
        assert evaluate(made, WINDOW, NONE)['failure'] == 'diverged'
        assert 'no more' in scores_of(WINDOW, [made])[0].failure
        return
    with pytest.raises(kind, match=f'^the run failed: {error.__name__}: no more$'):
        evaluate(made, WINDOW, NONE)
    with pytest.raises(kind):
        scores_of(WINDOW, [made])


def broken() -> Setup:
    return parameter_file.load(None, {
        '/**': {'model': 'broken_arm:Broken'}, 'plant': {'duration': 0.2}})

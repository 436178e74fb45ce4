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

from math import inf
from typing import Any

from ctc_chattering.analysis.metrics import metrics
from ctc_chattering.analysis.result import Result, simulate
from ctc_chattering.compiled.machine_code import MACHINE_CODE, PLAIN_PYTHON
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.errors import CtcError, MachineError
from ctc_chattering.runs.score import over_simulation, Score, score, slips_at_rest, worst
from ctc_chattering.simulation.closed_loop import Run
from map_specs import ON_TRACK
import numpy as np
import pytest

WINDOW = (0.05, 0.1)


def setup(**plant: Any) -> Setup:
    return parameter_file.load(None, {
        'plant': {**ON_TRACK, 'duration': 0.1, **plant}, 'controller': {'switching': 'implicit'}})


def test_numbers_are_those_of_the_samples_with_none_missing_in_between() -> None:
    """Check a run that lacks samples, in the window and as a whole."""
    made = setup(sample_loss=0.2)
    result = over_simulation(made)
    found, run = score(made, WINDOW, lambda _: result), result.run
    part, whole = (metrics(run, x, period=1e-3) for x in (WINDOW, (0.0, 0.1)))
    assert part['missing_samples'] == found.missing != 0
    assert found.variation == tuple(part['torque_variation_nm_per_s'])
    assert found.peak_rate == tuple(whole['max_torque_rate_nm_per_s'])
    assert found.peak == tuple(np.abs(run.tau).max(axis=0))
    assert (found.error, found.most_variation) == (max(found.rms), max(found.variation))
    assert (found.failure, found.engine) == (
        '', MACHINE_CODE if run.compiled else PLAIN_PYTHON)
    across = score(made, WINDOW, lambda _: result, across_gaps=True)
    assert across.variation == tuple(metrics(run, WINDOW)['torque_variation_nm_per_s'])
    assert across.variation != found.variation


def test_a_failure_has_a_reason_and_no_numbers() -> None:
    found = score(setup(), (0.0501, 0.0502))
    assert found == Score(failure='fewer than two samples from 0.0501 s to 0.0502 s',
                          engine=found.engine)
    assert (found.error, found.most_variation) == (inf, inf)


@pytest.mark.parametrize(('error', 'text'), [
    (CtcError('it diverged'), 'it diverged'), (ZeroDivisionError('a\nb'), 'the run failed: '
                                               'ZeroDivisionError: a b')])
def test_what_a_run_raises_is_its_failure(error: Exception, text: str) -> None:
    def run(_: Setup) -> Result:
        raise error

    assert score(setup(), run=run).failure == text


@pytest.mark.parametrize('error', [MemoryError(), OSError(28, 'no space'), KeyboardInterrupt()])
def test_what_the_machine_cannot_do_is_none(error: BaseException) -> None:
    def run(_: Setup) -> Result:
        raise error

    with pytest.raises((MachineError, KeyboardInterrupt)):
        score(setup(), run=run)


def test_the_worst_of_runs_is_the_first_that_fails_and_no_further_one_is_made() -> None:
    made = iter([Score((1.0,)), Score(failure='diverged'), Score((2.0,))])
    assert worst(made).failure == 'diverged'
    assert next(made).rms == (2.0,)


def test_slips_are_those_at_rest() -> None:
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


def test_states_are_the_true_ones() -> None:
    coarse = setup(encoder_resolution=[0.01, 0.01])
    seen = simulate(coarse).run
    true = over_simulation(coarse).run
    assert (true.tau == seen.tau).all()
    assert seen.q[1:] == pytest.approx(0.01 * np.round(seen.q[1:] / 0.01), abs=1e-9)
    assert np.abs(true.q - seen.q).max() > 1e-3

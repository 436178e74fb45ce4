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

"""Candidates over draws: numbers of runs, the same draws for all, jobs, the recommended point."""

from __future__ import annotations

import dataclasses
from math import inf

from ctc_chattering.runs.points import Runs
from ctc_chattering.runs.pool import processes
from ctc_chattering.runs.recommended import recommended_setup
from ctc_chattering.runs.score import Score
from ctc_chattering.runs.tune import (
    Candidate,
    over_draws,
    recommended_of,
    scores_of,
    searched,
    setups,
    Tuning,
    with_gains,
)
from ctc_chattering.runs.tune_spec import Limits
import pytest
from tunings import short_spec, short_tuning


def test_a_candidate_is_evaluated_on_every_draw() -> None:
    found = short_spec()
    draws, values = Runs(found), {'kp': [50.0, 60.0]}
    mine, other = (with_gains(draws, x) for x in (values, {}))
    assert mine == [dataclasses.replace(x, controller=x.controller.changed(values))
                    for x in draws.setups]
    assert scores_of(found.window, mine) != scores_of(found.window, other)


@pytest.fixture
def tuning() -> Tuning:
    return short_tuning()


@pytest.mark.slow
def test_the_result_does_not_depend_on_the_number_of_processes(tuning: Tuning) -> None:
    with processes(2) as each:
        again = searched(tuning.spec, 12, 100.0, 1, each)
    assert (again.trials, again.points, again.others, again.best) == (
        tuning.trials, tuning.points, tuning.others, tuning.best)


def test_the_first_trials_are_the_gains_of_the_file_and_the_recommended(tuning: Tuning) -> None:
    assert tuning.trials[0].numbers == pytest.approx(
        {'pole': 10.0, 'damping': 2.5, 'lambda': 10.0, 'ka': 1.0, 'observer_bandwidth': 1200.0})
    assert tuning.trials[1].numbers['observer_bandwidth'] == pytest.approx(200.0)


def test_the_points_are_validated_on_all_fresh_draws(tuning: Tuning) -> None:
    assert len(tuning.fresh.setups) == 8
    assert tuning.points
    for x in (*tuning.points, *tuning.others):
        assert len(x.drawn.runs) == 2
        assert len(x.fresh.runs) == 8
    for k, x in zip(tuning.front, tuning.points):
        assert x.drawn == tuning.trials[k].score
    errors = [x.drawn.error for x in tuning.points]
    assert errors == sorted(errors, reverse=True)


def test_others_are_the_file_and_the_recommended_settings(tuning: Tuning) -> None:
    found = tuning.spec.references
    assert [x.name for x in tuning.others] == list(found) == [
        'file chattering sign', 'recommended chattering implicit_observer',
        'recommended observer_feedback']
    for name, file in zip(found, (tuning.spec.file, *(
            recommended_setup(tuning.spec.file, law)
            for law in ('chattering', 'observer_feedback')))):
        assert tuning.spec.setup.controller.changed(found[name]) == file.controller
        assert 'inertia_scale' not in found[name]  # A draw may have it.


def test_all_laws_that_run_are_compiled_first() -> None:
    """Check the law that is tuned, and those that it is compared with."""
    assert [(x.controller.law, x.controller.switching_in_force)
            for x in setups(short_spec())] == [
        ('chattering', 'implicit_observer'), ('chattering', 'sign'),
        ('chattering', 'implicit_observer'), ('observer_feedback', '')]


def candidate(error: float, variation: float, torque: float) -> Candidate:
    run = Score((error,), variation=(variation,), peak=(torque,), peak_rate=(0.0,))
    found = over_draws([run], Limits((1.0,), (inf,)), 100.0)
    return Candidate('', {}, found, found)


def test_the_recommended_of_keeps_the_limits_on_fresh_draws() -> None:
    """Check the products 6, 4 and 5, of which the second is beyond a limit."""
    points = [candidate(3.0, 2.0, 0.5), candidate(2.0, 2.0, 1.5), candidate(1.0, 5.0, 0.5)]
    assert recommended_of(points) is points[2]
    assert recommended_of(points[:2]) is points[0]
    assert recommended_of([points[1]]) is points[1]
    assert recommended_of([]) is None


def test_the_recommended_is_where_both_change_by_the_same_part() -> None:
    """On error = 1 + 100 / variation² the slope on logarithmic axes is -1 at variation = 10."""
    points = [candidate(1.0 + 100.0 / v ** 2, v, 0.5) for v in (1.1 ** k for k in range(60))]
    found = recommended_of(points)
    assert found is not None
    assert found.fresh.variation == pytest.approx(10.0, rel=0.05)
    assert recommended_of([points[0], points[0]._replace(name='second')]) is points[0]


def test_limits_that_nothing_keeps_leave_no_front() -> None:
    result = short_tuning(torque_limit=1.0)
    assert (result.points, result.best, result.front) == ((), None, ())
    assert len(result.trials) == 12
    assert [x.fresh.allowed for x in result.others] == [False] * 3

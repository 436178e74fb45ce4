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

"""The plan of a soak test, what it measures, and its verdict, without a graph."""

from __future__ import annotations

from typing import Any

from faults import Report
import numpy as np
import pytest
from soak import plan, report
from soak.measurements import Gap, gaps, memory, Outage, unhealthy, WARM_UP
from soak.plan import Fault

S = 1_000_000_000


def test_growth_is_the_slope_after_the_warm_up() -> None:
    rng = np.random.default_rng(1)
    t = 1e6 + np.cumsum(rng.uniform(0.5, 1.5, 500))
    # It grows much in the warm-up, which does not count.
    size = 7e4 + 0.03 * t + rng.normal(0.0, 20.0, 500) - 1e3 * np.clip(WARM_UP + t[0] - t, 0, 30)
    late = t - t[0] >= WARM_UP
    found = memory(list(zip(t.tolist(), size.tolist())))
    slope = np.linalg.lstsq(np.stack([t[late] - t[-1], np.ones(late.sum())], 1), size[late])[0][0]
    assert found.pop('memory_kb') == [size[late][0], size[-1]]
    assert found == pytest.approx(
        {'growth_kb_per_min': 60.0 * slope, 'fitted_s': np.ptp(t[late])}, rel=1e-6)
    assert memory([])['memory_kb'] == [0.0, 0.0]
    for short in ([(1.0, 5.0)], [(1.0, 5.0), (2.0, 5.0)], [(1.0, 4.0), (40.0, 5.0)]):
        assert memory(short) == {
            'memory_kb': [5.0, 5.0], 'growth_kb_per_min': 0.0, 'fitted_s': 0.0}


def reports(t: int = 2 * S, **messages: str) -> dict[str, Report]:
    values = {'controller': {'rate [Hz]': '950.3'},
              'recorder': {'messages': '12', 'rate [Hz]': '3500.0'}}
    said = {**dict.fromkeys(plan.PROCESSES, 'running'), 'recorder': 'recording to x', **messages}
    return {name: Report(b'\0', message, values.get(name, {}), t)
            for name, message in said.items()}


def test_an_unhealthy_graph() -> None:
    assert unhealthy(reports(), S, 900.0) == ''
    assert unhealthy(reports(plant='running; x has several publishers'), S, 900.0) == ''
    assert unhealthy(reports(recorder='3 messages were dropped'), S, 900.0) == ''
    assert unhealthy(reports(), 3 * S, 900.0) == 'recorder does not report'
    assert unhealthy(reports(), S, 990.0) == 'controller: 950 samples per second of 990'
    assert 'brakes' in unhealthy(reports(plant='no command; brakes on'), S, 900.0)
    assert 'stopped' in unhealthy(reports(recorder='recording has stopped: full'), S, 900.0)
    deaf = reports()
    deaf['recorder'].values['rate [Hz]'] = '4.0'
    assert unhealthy(deaf, S, 900.0) == 'recorder: 4 messages per second of 1800'
    missing = reports()
    del missing['reference']
    assert unhealthy(missing, S, 900.0) == 'reference does not report'


def test_gaps_are_found_and_explained_by_outages() -> None:
    ms = S // 1000
    stamps = [*range(0, S, ms), *range(3 * S, 4 * S, ms), 3 * S, *range(9 * S, 10 * S, ms)]
    found = gaps(stamps, [Outage(S + 400 * ms, 2 * S)])
    assert found == [Gap(S - ms, 3 * S, True), Gap(4 * S - ms, 3 * S, False),
                     Gap(3 * S, 9 * S, False)]
    assert gaps(stamps[:1000], []) == gaps([], []) == []


PROCESS = {'samples': 1000, 'misses': 2, 'refused': {'joint_states: not_finite': 3},
           'timeouts': {'timeouts, state': 4}, 'restarts': 1, 'crashes': 0,
           'memory_kb': [70_000.0, 71_000.0], 'growth_kb_per_min': 5.0, 'fitted_s': 80.0}
BAGS = {'count': 2, 'messages': 5000, 'states': 2000, 'gaps': 1, 'longest_gap_s': 1.25,
        'unexplained_gaps': 0, 'dropped': 6, 'unexplained_dropped': 0, 'unreadable': []}


def result(fault: Fault, took: float, failure: str = '') -> dict[str, Any]:
    return {'at_s': fault.at, 'kind': fault.kind, 'target': fault.target, 'text': str(fault),
            'recovery_s': took, 'failure': failure}


def document(**more: Any) -> dict[str, Any]:
    """Return a document without complaints."""
    return {
        'seed': 7, 'asked_s': 120.0, 'duration_s': 90.0, 'control_period_s': 1e-3,
        'machine': 'Z80, 1 cores', 'crashes': [], 'bags': dict(BAGS), 'faults': [
            result(Fault(1.0, plan.KILL, 'plant'), 2.5),
            result(Fault(2.0, plan.RESET, 'controller'), 0.4)],
        'processes': {name: dict(PROCESS) for name in plan.PROCESSES}, **more}


def test_verdict() -> None:
    assert report.complaints(document()) == []
    failed = document(faults=[
        result(Fault(5.0, plan.STOP, 'plant', 1.0), 10.0, 'plant does not report')])
    assert report.complaints(failed) == [
        'at 5.0 s, SIGSTOP plant for 1.00 s: plant does not report']
    assert '| SIGSTOP plant | 1 | 0 |  |' in report.to_markdown(failed)
    assert report.complaints(document(crashes=['plant'])) == ['plant']
    for key in ('unexplained_gaps', 'unexplained_dropped'):
        found = document(bags={**BAGS, key: 3})
        (line,) = report.complaints(found)
        assert line.startswith('3 ') and line in report.to_markdown(found)
    assert report.complaints(document(bags={**BAGS, 'unreadable': ['x: not a bag']}))


@pytest.mark.parametrize(('slope', 'fitted', 'fails'), [
    (5000.0, 20.0, False),                          # Too short.
    (1000.0, 60.0, False), (3000.0, 60.0, True),    # Not more than 2 MB; more.
    (99.0, 36000.0, False), (101.0, 36000.0, True), (-500.0, 3600.0, False)])
def test_growth_that_is_too_much(slope: float, fitted: float, fails: bool) -> None:
    made = document()
    made['processes']['plant'].update(growth_kb_per_min=slope, fitted_s=fitted)
    found = [line.startswith('plant: memory') for line in report.complaints(made)]
    assert found == [True] * fails

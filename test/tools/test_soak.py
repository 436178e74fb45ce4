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

"""A soak test: what it measures and its verdict, and a short one of a real graph."""

from __future__ import annotations

import gc
import json
import os
from pathlib import Path
import subprocess
import sys
import tracemalloc
from typing import Any

from bags import state
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.bags.writer import BagWriter, offered_qos
from ctc_chattering.configuration.topics import TOPICS
from ctc_chattering.nodes.recorder import FLUSH_PERIOD
from ctc_chattering.numerics.time_grid import NANOSECONDS as S
from faults import Report
import numpy as np
from processes import PATIENCE
import pytest
from soak import plan, report
from soak.measurements import examine, gaps, memory, Outage, SETTLING, unhealthy, WARM_UP
from soak.plan import Fault

ROOT = Path(__file__).resolve().parents[2]


def test_growth_is_the_slope_after_the_warm_up() -> None:
    """It grows much in the warm-up, which does not count."""
    t = np.arange(500.0)
    size = 7e4 + 0.03 * t - 1e3 * np.clip(WARM_UP - t, 0, 30)
    samples = list(zip(t.tolist(), size.tolist()))
    assert memory(samples, {})['growth_kb_per_min'] == pytest.approx(1.8)
    assert memory([(1.0, 4.0), (40.0, 5.0)], {})['growth_kb_per_min'] == 0.0


def test_growth_is_judged_after_every_process_was_stopped_for_long() -> None:
    """A process keeps messages for a stopped one, the first time: its memory grows once."""
    t = np.arange(1000.0, 1500.0)
    size = 7e4 + 0.05 * t + 700.0 * (t > 1200.0) + 300.0 * (t > 1302.0)
    samples = list(zip(t.tolist(), size.tolist()))
    stops = {'controller': [1200.0, 1400.0], 'recorder': [900.0, 1300.0]}
    found = memory(samples, stops)
    assert found['growth_kb_per_min'] == pytest.approx(3.0)
    assert found['fitted_s'] == 1499.0 - 1300.0 - SETTLING
    assert memory(samples, {**stops, 'plant': [999.0]})['fitted_s'] == 0.0


def test_each_process_is_stopped_for_long_after_the_kills_of_a_long_run() -> None:
    for duration, count in (900.0, len(plan.PROCESSES)), (24.0, 0):
        faults = plan.plan(3, duration)
        last_kill = max(i for i, x in enumerate(faults) if x.kind == plan.KILL)
        stopped = [x.target for x in faults[last_kill:] if x.lasts == plan.LONGEST_STOP]
        assert sorted(stopped) == sorted(plan.PROCESSES)[:count]


def test_what_the_recorder_keeps_of_each_flush_explains_its_growth(tmp_path: Path) -> None:
    recording, flushes = BagWriter(tmp_path / 'bag'), 50
    names = [name.lstrip('/') for name in TOPICS]

    def flush(k: int) -> None:
        for name in names:
            recording.write(f'/{name}', 'std_msgs/msg/String', k, bytes(100), '')
        recording.flush()

    for k in range(20):
        flush(k)
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        for k in range(flushes):
            flush(20 + k)
        gc.collect()
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
        recording.close()
    kept = (after - before) / flushes * 60.0 / FLUSH_PERIOD / 1e3
    assert 0.5 * report.EXPLAINED['recorder'] < kept < report.EXPLAINED['recorder']


def reports(t: int = 2 * S, rate: str = '3500.0', **messages: str) -> dict[str, Report]:
    values = {'controller': {'rate [Hz]': '950.3'},
              'recorder': {'messages': '12', 'rate [Hz]': rate}}
    said = {**dict.fromkeys(plan.PROCESSES, 'running'), 'recorder': 'recording to x', **messages}
    return {name: Report(b'\0', message, values.get(name, {}), t)
            for name, message in said.items()}


def test_an_unhealthy_graph() -> None:
    assert unhealthy(reports(), S, 900.0) == ''
    assert unhealthy(reports(recorder='3 messages were dropped'), S, 900.0) == ''
    assert unhealthy(reports(), 3 * S, 900.0) == 'recorder does not report'
    assert unhealthy(reports(), S, 990.0) == 'controller: 950 samples per second of 990'
    assert 'brakes' in unhealthy(reports(plant='no command; brakes on'), S, 900.0)
    assert 'stopped' in unhealthy(reports(recorder='recording has stopped: full'), S, 900.0)
    assert unhealthy(reports(rate='4.0'), S, 900.0) == 'recorder: 4 messages per second of 1800'


def test_gaps_of_a_bag_and_what_explains_them(tmp_path: Path) -> None:
    """Check one between states, and states that end before something else does."""
    rows = [(t, 'joint_states', 'sensor_msgs/msg/JointState',
             bytes(state(('joint1', 'joint2'), [[0.0, 0.0]] * 3, divmod(t, S))))
            for t in (*range(0, S, S // 50), *range(3 * S, 4 * S, S // 50))]
    rows += [(t, 'text', 'std_msgs/msg/String', b'\0\1\0\0\1\0\0\0\0')
             for t in range(0, 9 * S, S // 2)]
    recording = BagWriter(tmp_path / 'bag')
    for t, topic, kind, data in sorted(rows):
        recording.write(f'/{topic}', kind, t, data, offered_qos(10, False))
    recording.close()
    assert len(gaps([0, S // 1000, 0], [])) == 1, 'a stamp that goes back is one, too'
    for outages, unexplained in ([], 2), ([Outage(S, 2 * S)], 1), ([Outage(20 * S, 21 * S)], 2):
        found = examine([tmp_path / 'bag'], outages)
        assert (found['states'], found['messages']) == (100, 118)
        assert (found['gaps'], found['unexplained_gaps']) == (2, unexplained)


PROCESS = {'samples': 1000, 'misses': 2, 'refused': {'joint_states: not_finite': 3},
           'timeouts': {'timeouts, state': 4}, 'restarts': 1, 'crashes': 0,
           'memory_kb': [70_000.0, 71_000.0], 'growth_kb_per_min': 5.0, 'fitted_s': 80.0}
BAGS = {'count': 2, 'messages': 5000, 'states': 2000, 'gaps': 1, 'longest_gap_s': 1.25,
        'unexplained_gaps': 0, 'dropped': 6, 'unexplained_dropped': 0, 'unreadable': []}


def document(failure: str = '', **more: Any) -> dict[str, Any]:
    """Return a document without complaints but of a failure."""
    return {
        'seed': 7, 'asked_s': 120.0, 'duration_s': 90.0, 'control_period_s': 1e-3,
        'machine': 'Z80, 1 cores', 'crashes': [], 'bags': dict(BAGS), 'faults': [
            {'at_s': 1.0, 'kind': plan.KILL, 'target': 'plant', 'recovery_s': 2.5,
             'text': str(Fault(1.0, plan.KILL, 'plant', 1.0)), 'failure': failure}],
        'processes': {name: dict(PROCESS) for name in plan.PROCESSES}, **more}


def test_verdict() -> None:
    assert report.complaints(document()) == []
    assert report.complaints(document('plant does not report')) == [
        'at 1.0 s, SIGKILL plant for 1.00 s: plant does not report']
    assert report.complaints(document(crashes=['plant'])) == ['plant']
    for key in ('unexplained_gaps', 'unexplained_dropped'):
        found = document(bags={**BAGS, key: 3})
        (line,) = report.complaints(found)
        assert line.startswith('3 ') and line in report.to_markdown(found)
    assert report.complaints(document(bags={**BAGS, 'unreadable': ['x: not a bag']}))


@pytest.mark.parametrize(('slope', 'fitted', 'fails'), [
    (5000.0, 20.0, False),                          # Too short.
    (900.0, 60.0, False), (1100.0, 60.0, True),     # Not more than 1 MB; more.
    (99.0, 36000.0, False), (101.0, 36000.0, True)])
def test_growth_that_is_too_much(slope: float, fitted: float, fails: bool) -> None:
    made = document()
    made['processes']['plant'].update(growth_kb_per_min=slope, fitted_s=fitted)
    found = [line.startswith('plant: memory') for line in report.complaints(made)]
    assert found == [True] * fails


def test_the_index_of_a_bag_is_no_leak_of_the_recorder() -> None:
    made = document()
    for slope, fails in (390.0, False), (410.0, True):
        made['processes']['recorder'].update(growth_kb_per_min=slope, fitted_s=36000.0)
        assert bool(report.complaints(made)) == fails


@pytest.mark.slow
@pytest.mark.ros
def test_a_short_soak_is_passed(tmp_path: Path) -> None:
    """Check its verdict at a rate that two busy processors keep, and that its bags are whole."""
    out, period = tmp_path / 'out', 0.005
    paths = ROOT / 'tools', ROOT / 'test' / 'support', ROOT
    done = subprocess.run(
        [sys.executable, '-m', 'soak', '--minutes=0.4', '--seed=5', f'--control-period={period}',
         '--out', str(out)], text=True, capture_output=True, timeout=3 * PATIENCE, check=False,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(map(str, paths))})
    log = (out / 'soak.log').read_text(encoding='utf-8')
    found: dict[str, Any] = json.loads((out / 'soak.json').read_text(encoding='utf-8'))
    assert found['complaints'] == [] and done.returncode == 0, log
    assert 'Traceback' not in done.stderr + log
    assert done.stdout == (out / 'soak.md').read_text(encoding='utf-8')
    assert plan.KILL in [x['kind'] for x in found['faults']] and len(found['faults']) >= 4
    bags = sorted(x for x in (out / 'bags').iterdir() if x.suffix != '.damaged')
    assert len(bags) == found['bags']['count'] == 1 + found['processes']['recorder']['restarts']
    for bag in bags:
        open_bag(bag).close()
    for name in ('plant', 'controller'):
        assert found['processes'][name]['samples'] > 0.5 * found['duration_s'] / period

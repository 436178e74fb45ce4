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

"""The light is green only when it should be."""

from __future__ import annotations

import dataclasses
import time

from ctc_chattering.live.health import (
    ENDED,
    ERROR,
    Light,
    light,
    NodeReport,
    OK,
    SIGNALS,
    SIGNS,
    UNKNOWN,
    WARN,
)
import pytest

REPORTS = {node: NodeReport(OK, 'running', 0.4) for node in SIGNALS}
HEARD = dict.fromkeys(SIGNALS.values(), 0.05)


def test_green_when_all_three_run_and_are_heard() -> None:
    assert light(REPORTS, HEARD).level == OK
    assert light({}, {}).level == UNKNOWN
    assert len({sign[0] for sign in SIGNS}) == 5, 'levels are told apart without colour'


@pytest.mark.parametrize('node', SIGNALS)
def test_not_green_without_one_of_them(node: str) -> None:
    less = {name: report for name, report in REPORTS.items() if name != node}
    assert light(less, HEARD).level == UNKNOWN
    assert f'{node}: not heard yet' in light(less, HEARD).lines
    other = next(name for name in SIGNALS if name != node)
    assert light(less | {other: NodeReport(ERROR, 'why', 0.4)}, HEARD).level == ERROR
    for level in (WARN, ERROR, 3):
        found = light(REPORTS | {node: NodeReport(level, 'why', 0.4)}, HEARD)
        assert found.level == min(level, ERROR)
        assert f'{node}: why' in found.lines
    old = dataclasses.replace(REPORTS[node], age=3.0)
    assert light(REPORTS | {node: old}, HEARD).level == ERROR


@pytest.mark.parametrize('topic', SIGNALS.values())
def test_not_green_when_a_topic_falls_silent(topic: str) -> None:
    """Check that it is seen within a second, long before the next report is overdue."""
    found = light(REPORTS, HEARD | {topic: 0.6})
    assert found.level == ERROR
    assert any(topic in line and '0.6 s' in line for line in found.lines)
    never = {name: age for name, age in HEARD.items() if name != topic}
    assert light(REPORTS, never).level == UNKNOWN
    assert light(REPORTS, HEARD | {topic: 0.6}, patience={topic: 1.0}).level == OK


def test_simulated_time_may_stand_still() -> None:
    assert light(REPORTS, dict.fromkeys(HEARD, 60.0), lockstep=True).level == WARN


def test_says_what_ended_and_why() -> None:
    """Check one node, all of them, by their own words or by silence, and what bringup says."""
    def ended(why: str, age: float) -> NodeReport:
        return NodeReport(OK, f'ended: {why}', age, {'ended': why})
    now = time.mktime((2026, 1, 2, 12, 0, 10, 0, 0, -1))
    one = light(REPORTS | {'controller': ended('SIGINT', 1.0)}, HEARD, now=now)
    assert one.level == ERROR
    assert 'controller: ended at 12:00:09: SIGINT' in one.lines
    dead = {node: dataclasses.replace(report, age=age)
            for (node, report), age in zip(REPORTS.items(), (4.2, 6.0, 4.9))}
    quiet = dict(zip(HEARD, (4.0, 5.0, 4.5)))
    assert light(dead, quiet, now=now) == Light(ENDED, (
        'controller: silent since 12:00:05', 'reference: silent since 12:00:05',
        'plant: silent since 12:00:06'))
    over = light(dead | {'plant': ended('the experiment has ended', 3.0)}, quiet, now=now)
    assert over.lines[-1] == 'plant: ended at 12:00:07: the experiment has ended'
    whole = light(REPORTS | {'bringup': ended('stopped by SIGINT', 0.1)}, HEARD, now=now)
    assert whole == Light(ENDED, ('bringup: stopped by SIGINT',))

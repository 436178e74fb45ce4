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

"""The light of the page: levels and lines for reports and silence."""

from __future__ import annotations

import dataclasses
import time

from ctc_chattering.live.status_light import (
    assess,
    Level,
    NodeReport,
    StatusLight,
    TOPIC_OF_NODE,
)
import pytest

REPORTS = {node: NodeReport(Level.OK, 'running', 0.4) for node in TOPIC_OF_NODE}
HEARD = dict.fromkeys(TOPIC_OF_NODE.values(), 0.05)


def test_green_when_all_three_run_and_are_heard() -> None:
    assert assess(REPORTS, HEARD).level == Level.OK
    assert assess({}, {}).level == Level.WAITING
    assert len({level.title[0] for level in Level}) == 5, 'levels are told apart without colour'


@pytest.mark.parametrize('node', TOPIC_OF_NODE)
def test_not_green_without_one_of_them(node: str) -> None:
    less = {name: report for name, report in REPORTS.items() if name != node}
    assert assess(less, HEARD).level == Level.WAITING
    assert f'{node}: not heard yet' in assess(less, HEARD).lines
    other = next(name for name in TOPIC_OF_NODE if name != node)
    assert assess(less | {other: NodeReport(Level.ERROR, 'why', 0.4)}, HEARD).level == Level.ERROR
    for level in (Level.WARN, Level.ERROR, 3):
        light = assess(REPORTS | {node: NodeReport(level, 'why', 0.4)}, HEARD)
        assert light.level == min(level, Level.ERROR)
        assert f'{node}: why' in light.lines
    old = dataclasses.replace(REPORTS[node], age=3.0)
    assert assess(REPORTS | {node: old}, HEARD).level == Level.ERROR


@pytest.mark.parametrize('topic', TOPIC_OF_NODE.values())
def test_not_green_when_a_topic_falls_silent(topic: str) -> None:
    """Check that it is seen within a second, long before the next report is overdue."""
    light = assess(REPORTS, HEARD | {topic: 0.6})
    assert light.level == Level.ERROR
    assert any(topic in line and '0.6 s' in line for line in light.lines)
    never = {name: age for name, age in HEARD.items() if name != topic}
    assert assess(REPORTS, never).level == Level.WAITING
    patient = assess(REPORTS, HEARD | {topic: 0.6}, reference_patience=0.5).level
    assert patient == (Level.OK if topic == 'reference' else Level.ERROR)


def test_simulated_time_may_stand_still() -> None:
    assert assess(REPORTS, dict.fromkeys(HEARD, 60.0), lockstep=True).level == Level.WARN


def test_says_what_ended_and_why() -> None:
    """Check one node, all of them, by their own words or by silence, and what bringup says."""
    def ended(why: str, age: float) -> NodeReport:
        return NodeReport(Level.OK, f'ended: {why}', age, {'ended': why})
    now = time.mktime((2026, 1, 2, 12, 0, 10, 0, 0, -1))
    one = assess(REPORTS | {'controller': ended('SIGINT', 1.0)}, HEARD, now=now)
    assert one.level == Level.ERROR
    assert 'controller: ended at 12:00:09: SIGINT' in one.lines
    dead = {node: dataclasses.replace(report, age=age)
            for (node, report), age in zip(REPORTS.items(), (4.2, 6.0, 4.9))}
    quiet = dict(zip(HEARD, (4.0, 5.0, 4.5)))
    assert assess(dead, quiet, now=now) == StatusLight(Level.ENDED, (
        'controller: silent since 12:00:05', 'reference: silent since 12:00:05',
        'plant: silent since 12:00:06'))
    over = assess(dead | {'plant': ended('the experiment has ended', 3.0)}, quiet, now=now)
    assert over.lines[-1] == 'plant: ended at 12:00:07: the experiment has ended'
    whole = assess(REPORTS | {'bringup': ended('stopped by SIGINT', 0.1)}, HEARD, now=now)
    assert whole == StatusLight(Level.ENDED, ('bringup: stopped by SIGINT',))

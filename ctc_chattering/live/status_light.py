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

"""
Light of the page: the state of a graph.

It depends on the nodes' reports, and on the silence of their topics.

`GraphPage` shows the `StatusLight` that `assess` returns. `GraphReader` collects the reports on
/diagnostics and the times since the last messages.
"""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from enum import IntEnum
import math
import time

#: Silence on a topic after which it is reported [s].
MAX_SILENCE_S = 0.5
#: Age from which a report is out of date [s].
MAX_REPORT_AGE_S = 2.5
#: Topic that each node of a loop publishes all the time.
TOPIC_OF_NODE = {
    'plant': 'joint_states',
    'controller': 'controller/tracking',
    'reference': 'reference'}


class Level(IntEnum):
    """Level of the light. The first three are those of /diagnostics."""

    OK = 0
    WARN = 1
    ERROR = 2
    WAITING = 3
    ENDED = 4

    @property
    def title(self) -> str:
        """Sign and words, which do not need colours."""
        return ('● OK', '▲ warning', '■ error', '○ waiting', '◆ the graph has ended')[self]


@dataclasses.dataclass(frozen=True)
class NodeReport:
    """
    A node's report on /diagnostics.

    Attributes
    ----------
    level : int
    message : str
    age : float
        Time since it came [s].
    values : mapping of str to str

    """

    level: int
    message: str
    age: float
    values: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def ended(self) -> str:
        """Reason for the node's end, or an empty text."""
        return self.values.get('ended', '')


@dataclasses.dataclass(frozen=True)
class StatusLight:
    """A level and the lines that explain it."""

    level: Level
    lines: tuple[str, ...]


def assess(
    reports: Mapping[str, NodeReport],
    silence: Mapping[str, float],
    lockstep: bool = False,
    reference_patience: float = 0.0,
    now: float = 0.0,
) -> StatusLight:
    """
    Return the light of a graph.

    It is `OK` only if plant, controller and reference all say so, have said so of late, and are
    heard on their topics. While one of them was never heard it is `WAITING`, or `ERROR` if another
    has one.

    Parameters
    ----------
    reports : mapping of str to NodeReport
        Reports by node.
    silence : mapping of str to float
        Time since a topic's last message [s]. Topics never heard are left out.
    lockstep : bool
        Simulated time may stand still, so silence is only a warning.
    reference_patience : float
        Silence of the reference that is allowed beyond `MAX_SILENCE_S` [s].
    now : float
        Wall time [s].

    """
    if not silence and not reports:
        return StatusLight(Level.WAITING, ('waiting for a graph',))
    if ends := _describe_ends(reports, silence, now):
        return StatusLight(Level.ENDED, ends)
    level = Level.OK
    lines = []
    waiting = False
    for node, topic in TOPIC_OF_NODE.items():
        report = reports.get(node)
        quiet = silence.get(topic)
        if report is None or quiet is None:
            waiting = True
        if report is None:
            lines.append(f'{node}: not heard yet')
        else:
            node_level, line = _assess_report(node, report, now)
            level = max(level, node_level)
            lines.append(line)
        allowed = MAX_SILENCE_S + (reference_patience if node == 'reference' else 0.0)
        if quiet is not None and quiet > allowed:
            level = max(level, Level.WARN if lockstep else Level.ERROR)
            lines.append(f'{topic}: {_describe_silence(quiet, now)}')
    if waiting and level < Level.ERROR:
        level = Level.WAITING
    return StatusLight(level, tuple(lines))


def _assess_report(node: str, report: NodeReport, now: float) -> tuple[Level, str]:
    """Return the level of a node and its line."""
    if report.ended:
        return Level.ERROR, _describe_end(node, report, now)
    if report.age > MAX_REPORT_AGE_S:
        return Level.ERROR, f'{node}: {_describe_silence(report.age, now)}'
    return Level(min(report.level, Level.ERROR)), f'{node}: {report.message}'


def _describe_ends(
    reports: Mapping[str, NodeReport], silence: Mapping[str, float], now: float
) -> tuple[str, ...]:
    """
    Return a line for the end of each node, in their order.

    While a node runs, there are none.
    """
    bringup = reports.get('bringup')
    told_by_bringup = bringup is not None and bool(bringup.ended)
    ends = []
    if bringup is not None and told_by_bringup:
        ends.append((math.inf, f'bringup: {bringup.ended}'))
    for node, topic in TOPIC_OF_NODE.items():
        report = reports.get(node)
        age = math.inf if report is None else report.age
        quiet = min(silence.get(topic, math.inf), age)
        if report is not None and report.ended:
            ends.append((report.age, _describe_end(node, report, now)))
        elif MAX_REPORT_AGE_S < quiet < math.inf:
            ends.append((quiet, f'{node}: silent since {_clock(now - quiet)}'))
        elif quiet < math.inf and not told_by_bringup:
            return ()
    return tuple(text for _, text in sorted(ends, reverse=True))


def _describe_end(node: str, report: NodeReport, now: float) -> str:
    return f'{node}: ended at {_clock(now - report.age)}: {report.ended}'


def _describe_silence(duration: float, now: float) -> str:
    return f'silent for {duration:.1f} s, since {_clock(now - duration)}'


def _clock(t: float) -> str:
    """Return a wall time in this machine's zone."""
    return time.strftime('%H:%M:%S', time.localtime(t))

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

"""Whether all is well with a graph: the light of the page, from what was heard and when."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
import math
import time

#: Levels of the light. `OK`, `WARN` and `ERROR` are those of /diagnostics.
OK, WARN, ERROR, UNKNOWN, ENDED = range(5)
#: Sign and word of each level: who does not see colours reads these.
SIGNS = ('● OK', '▲ warning', '■ error', '○ waiting', '◆ the graph has ended')
#: Silence on a topic after which it is reported, and age of a report that is too old [s].
SILENT, STALE = 0.5, 2.5
#: What each node publishes all the time.
SIGNALS = {'plant': 'joint_states', 'controller': 'controller/tracking', 'reference': 'reference'}


@dataclasses.dataclass(frozen=True)
class NodeReport:
    """
    What a node said of itself on /diagnostics.

    Attributes
    ----------
    level : int
    message : str
    age : float
        [s].
    values : mapping of str to str

    """

    level: int
    message: str
    age: float
    values: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def ended(self) -> str:
        """Return why the node has ended; empty if it has not said so."""
        return self.values.get('ended', '')


@dataclasses.dataclass(frozen=True)
class Light:
    """A level, and lines that say why."""

    level: int
    lines: tuple[str, ...]


def light(reports: Mapping[str, NodeReport], silence: Mapping[str, float],
          lockstep: bool = False, patience: Mapping[str, float] | None = None,
          now: float = 0.0) -> Light:
    """
    Return the light of a graph.

    It is `OK` only if plant, controller and reference all say so, have said so of late, and are
    heard on their topics. While one of them was never heard it is `UNKNOWN`, or `ERROR` if another
    has one.

    Parameters
    ----------
    reports : mapping of str to NodeReport
        By node.
    silence : mapping of str to float
        Time since the last message of a topic of `SIGNALS` [s]; topics never heard are left out.
    lockstep : bool
        Whether simulated time may stand still: silence of all topics is then a warning.
    patience : mapping of str to float, optional
        Silence allowed on a topic, where it is more than `SILENT` [s].
    now : float
        Time of the clock on the wall [s].

    """
    if not silence and not reports:
        return Light(UNKNOWN, ('waiting for a graph',))
    if ends := _ends(reports, silence, now):
        return Light(ENDED, ends)
    found: list[tuple[int, str]] = []
    waiting = False
    for node, topic in SIGNALS.items():
        report, silent = reports.get(node), silence.get(topic)
        waiting = waiting or report is None or silent is None
        if report is None:
            found.append((OK, f'{node}: not heard yet'))
        elif report.ended:
            found.append((ERROR, _ended(node, report, now)))
        elif report.age > STALE:
            found.append((ERROR, f'{node}: {_silent(report.age, now)}'))
        else:
            found.append((min(report.level, ERROR), f'{node}: {report.message}'))
        if silent is not None and silent > (patience or {}).get(topic, SILENT):
            found.append((WARN if lockstep else ERROR, f'{topic}: {_silent(silent, now)}'))
    level = max(x for x, _ in found)
    return Light(UNKNOWN if waiting and level < ERROR else level,
                 tuple(text for _, text in found))


def _ends(reports: Mapping[str, NodeReport], silence: Mapping[str, float],
          now: float) -> tuple[str, ...]:
    """Return how the nodes have ended, the first one first; nothing while the graph runs."""
    whole = reports.get('bringup')
    told = whole is not None and bool(whole.ended)
    ends = [(math.inf, f'bringup: {whole.ended}')] if whole is not None and told else []
    for node, topic in SIGNALS.items():
        report = reports.get(node)
        heard = min(silence.get(topic, math.inf), math.inf if report is None else report.age)
        if report is not None and report.ended:
            ends.append((report.age, _ended(node, report, now)))
        elif STALE < heard < math.inf:
            ends.append((heard, f'{node}: silent since {_at(now - heard)}'))
        elif heard < math.inf and not told:
            return ()
    return tuple(text for _, text in sorted(ends, reverse=True))


def _ended(node: str, report: NodeReport, now: float) -> str:
    return f'{node}: ended at {_at(now - report.age)}: {report.ended}'


def _silent(since: float, now: float) -> str:
    return f'silent for {since:.1f} s, since {_at(now - since)}'


def _at(t: float) -> str:
    """Return a time of the clock on the wall as this machine's zone has it."""
    return time.strftime('%H:%M:%S', time.localtime(t))

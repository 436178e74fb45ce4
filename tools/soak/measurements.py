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

"""Measurements of a soak test: recovery, memory, and gaps in bags."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
import itertools
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

from ctc_chattering.bags.repair import open_bag, repair
from ctc_chattering.configuration.topics import JOINT_STATES
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from faults import Report
import numpy as np
from soak.plan import PROCESSES

#: Part of the sample rate that controller and recorder must reach again.
RATE = 0.9
#: A process's memory is fitted from so long after its start on [s] ...
WARM_UP = 30.0
#: ... and from so long after the last of the long stops on [s].
SETTLING = 5.0
#: A longer step between stamps of joint states, or from the last one to the end of the bag, is a
#: gap [ns].
GAP = NANOSECONDS // 5
#: Time by which an outage may precede or follow its fault [ns].
MARGIN = NANOSECONDS // 2
#: A stamp as far from the time of its recording is not the plant's [ns].
_FOREIGN = 10 * NANOSECONDS
#: Bytes of the encapsulation of a serialized message.
_HEAD = 4
#: Bytes of a stamp.
_STAMP = 8
#: An empty frame.
_NO_FRAME = b'\1\0\0\0\0'


def unhealthy(reports: Mapping[str, Report], since: int, rate: float) -> str:
    """
    Return why the graph has not recovered; an empty string if it has.

    Parameters
    ----------
    reports : mapping
        The last report of each process.
    since : int
        Earlier reports do not count [ns].
    rate : float
        Samples per second that the controller must answer, and the recorder must record.

    """
    for name in PROCESSES:
        report = reports.get(name)
        if report is None or report.stamp < since:
            return f'{name} does not report'
        if not report.message.startswith('running') and name != 'recorder':
            return f'{name}: {report.message}'
    recorder = reports['recorder']
    if not recorder.count('messages') or 'stopped' in recorder.message:
        return f'recorder: {recorder.message}'
    # Each sample has at least a state and a torque.
    for name, factor, unit in (('controller', 1.0, 'samples'), ('recorder', 2.0, 'messages')):
        found = float(reports[name].values.get('rate [Hz]', 0.0))
        if found < factor * rate:
            return f'{name}: {found:.0f} {unit} per second of {factor * rate:.0f}'
    return ''


def totals(generations: Iterable[Report]) -> Counter[str]:
    """Return what a process has counted, summed over the last reports of its generations."""
    return sum((Counter({key: int(value) for key, value in report.values.items()
                         if value.isdecimal()}) for report in generations), Counter())


def memory(samples: Sequence[tuple[float, float]], long_stops: Mapping[str, Sequence[float]]
           ) -> dict[str, Any]:
    """
    Return size and growth of a process's memory after its high-water marks are reached.

    Those are the windows of its statistics, and what it keeps for a reader that is stopped. Where
    they are not reached, there is no growth to be judged.

    Parameters
    ----------
    samples : sequence of (float, float)
        Time [s] and memory [kB], from the start of the process on.
    long_stops : mapping
        When each of the processes was continued after a long stop [s].

    """
    start = samples[0][0] if samples else 0.0
    marks = [min((t for t in times if t > start), default=inf) for times in long_stops.values()]
    begin = max([start + WARM_UP, *(t + SETTLING for t in marks)])
    late = [x for x in samples if x[0] >= begin]
    shown = late if len(late) > 1 else samples[-1:] or [(0.0, 0.0)]
    t, size = np.array(shown).T
    slope = np.polyfit(t - t[0], size, 1)[0] if len(t) > 1 else 0.0
    return {'memory_kb': [float(size[0]), float(size[-1])],
            'growth_kb_per_min': 60.0 * float(slope), 'fitted_s': float(t[-1] - t[0])}


class Outage(NamedTuple):
    """An interval in which the plant or the recorder did not run because of a fault [ns]."""

    begin: int
    end: int


class Gap(NamedTuple):
    """Two successive stamps that are too far apart [ns], and whether an outage explains it."""

    begin: int
    end: int
    explained: bool


def gaps(stamps: Iterable[int], outages: Sequence[Outage]) -> list[Gap]:
    """
    Return where stamps are more than `GAP` apart, or go back.

    Parameters
    ----------
    stamps : iterable of int
        In the order of recording [ns].
    outages : sequence of Outage
        Of plant and recorder.

    """
    return [Gap(a, b, any(o.begin - MARGIN < max(a, b) and min(a, b) < o.end + MARGIN
                          for o in outages))
            for a, b in itertools.pairwise(stamps) if not 0 < b - a <= GAP]


def examine(bags: Sequence[Path], outages: Sequence[Outage]) -> dict[str, Any]:
    """
    Read every bag and find the gaps in the stamps of the plant's states; repair it before.

    Parameters
    ----------
    bags : sequence of Path
        Directories.
    outages : sequence of Outage
        Of plant and recorder.

    """
    found: list[Gap] = []
    unreadable = []
    messages = states = 0
    for bag in bags:
        try:
            repair(bag)
            with closing(open_bag(bag)) as reader:
                stamps = _stamps(reader)
                count, end = reader.message_count, reader.end_time
        except CtcError as error:
            unreadable.append(str(error))
            continue
        messages += count
        states += len(stamps)
        # The end of the bag, after the last of them.
        found += gaps([*stamps, max(end, stamps[-1] + 1)] if stamps else [], outages)
    return {'count': len(bags), 'messages': messages, 'states': states, 'gaps': len(found),
            'unexplained_gaps': sum(not gap.explained for gap in found),
            'longest_gap_s': seconds(max((abs(b - a) for a, b, _ in found), default=0)),
            'unexplained': [[a, b] for a, b, explained in found if not explained],
            'unreadable': unreadable}


def _stamps(reader: Any) -> list[int]:
    """Return the stamps [ns] of the plant's own states: near their time, and without a frame."""
    result = []
    end = _HEAD + _STAMP
    connections = [x for x in reader.connections if x.topic.endswith('/' + JOINT_STATES)]
    for _, t, data in reader.messages(connections) if connections else ():
        sec = int.from_bytes(data[_HEAD:_HEAD + 4], 'little', signed=True)
        stamp = sec * NANOSECONDS + int.from_bytes(data[_HEAD + 4:end], 'little')
        if data[end:end + len(_NO_FRAME)] == _NO_FRAME and abs(stamp - t) < _FOREIGN:
            result.append(stamp)
    return result

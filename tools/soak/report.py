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

"""The result of a soak test as tables, and its verdict."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ctc_chattering.configuration.topics import JOINT_STATES
from ctc_chattering.numerics.time_grid import seconds
from soak import measurements, run
from soak.plan import KILL, LONGEST_STOP, STOP

#: A faster growth fails the run [kB/min] ...
GROWTH = 100.0
#: ... if it is more than this in all [kB] ...
GROWN = 1000.0
#: ... and was fitted over this time [s].
FITTED = 30.0
#: Growth that is explained [kB/min]: the index of a bag has an entry for each flush, until another
#: file begins after ten minutes.
EXPLAINED = {'recorder': 300.0}


def complaints(document: Mapping[str, Any]) -> list[str]:
    """Return what makes the run a failure."""
    result = [f'at {x["at_s"]:.1f} s, {x["text"]}: {x["failure"]}' for x in document['faults']
              if x['failure']] + document['crashes']
    for name, p in document['processes'].items():
        growth, span = p['growth_kb_per_min'] - EXPLAINED.get(name, 0.0), p['fitted_s']
        if span >= FITTED and growth > GROWTH and growth * span / 60.0 > GROWN:
            result.append(f'{name}: memory grows by {p["growth_kb_per_min"]:.0f} kB/min over '
                          f'{span:.0f} s')
    bags = document['bags']
    if bags['unexplained_gaps']:
        result.append(f'{bags["unexplained_gaps"]} gaps in the stamps of {JOINT_STATES} that no '
                      'fault explains')
    if bags['unexplained_dropped']:
        result.append(f'{bags["unexplained_dropped"]} messages were dropped although the recorder '
                      'was not stopped')
    return [*result, *bags['unreadable']]


def to_markdown(document: Mapping[str, Any]) -> str:
    """Return the tables and the verdict."""
    bags, processes = document['bags'], document['processes']
    found = complaints(document)
    return '\n'.join([
        f'{document["duration_s"] / 60.0:.1f} min of {document["asked_s"] / 60.0:.1f}, seed '
        f'{document["seed"]}, control period {1e3 * document["control_period_s"]:g} ms, on '
        f'{document["machine"]}.', '', '## Faults', '',
        f'Recovered: within {run.RECOVERY:g} s every node reports "running", the controller at '
        f'{measurements.RATE:.0%} of its rate or more, the recorder as well. Nodes report once a '
        'second.', '',
        *_table(('fault', 'injected', 'recovered', 'longest recovery [s]'),
                _by_kind(document['faults'])),
        '', '## Processes', '',
        'Counts are sums over all restarts of a process; memory (resident, without files) is that '
        f'of its longest run. The growth is fitted from {measurements.WARM_UP:g} s after the '
        f'start on, and after each process has been stopped for {LONGEST_STOP:g} s, as others '
        f'keep messages meanwhile. Allowed: {GROWTH:g} kB/min, or {GROWN:g} kB in all; of the '
        f'recorder, {EXPLAINED["recorder"]:g} kB/min more, the index of its bag.', '',
        *_table(('process', 'samples', 'misses', 'refused', 'timeouts', 'restarts', 'crashes',
                 'memory [MB]', 'growth [kB/min]', 'over [s]'),
                ((name, p['samples'] or '', p['misses'] or '', sum(p['refused'].values()),
                  sum(p['timeouts'].values()), p['restarts'], p['crashes'],
                  ' → '.join(f'{x / 1e3:.1f}' for x in p['memory_kb']),
                  f'{p["growth_kb_per_min"]:.1f}', f'{p["fitted_s"]:.0f}')
                 for name, p in processes.items())),
        '', '## Refused messages and timeouts', '',
        *_table(('process', 'what', 'count'),
                ((name, *item) for name, p in processes.items()
                 for group in ('refused', 'timeouts') for item in sorted(p[group].items()))),
        '', '## Bags', '',
        f'Gap: more than {seconds(measurements.GAP):g} s between two stamps of {JOINT_STATES}. '
        'Explained: the plant or the recorder was stopped or killed at that time.', '',
        *_table(('bags', 'messages', 'joint states', 'gaps', 'longest [s]', 'unexplained',
                 'dropped', 'unexplained'),
                [(bags['count'], bags['messages'], bags['states'], bags['gaps'],
                  f'{bags["longest_gap_s"]:.2f}', bags['unexplained_gaps'], bags['dropped'],
                  bags['unexplained_dropped'])]),
        '', '## Verdict', '', *([f'- {line}' for line in found] or ['Passed.']), ''])


def _by_kind(faults: Sequence[Mapping[str, Any]]) -> list[tuple[object, ...]]:
    kinds: dict[str, list[Mapping[str, Any]]] = {}
    for x in faults:
        named = x['kind'] in (KILL, STOP)
        kinds.setdefault(f'{x["kind"]} {x["target"]}' if named else x['kind'], []).append(x)
    rows: list[tuple[object, ...]] = []
    for kind, some in [*sorted(kinds.items()), ('**all**', list(faults))]:
        took = [x['recovery_s'] for x in some if not x['failure']]
        rows.append((kind, len(some), len(took), f'{max(took):.1f}' if took else ''))
    return rows


def _table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    return [f'| {" | ".join(map(str, cells))} |'
            for cells in (heads, ['---'] * len(heads), *rows)]

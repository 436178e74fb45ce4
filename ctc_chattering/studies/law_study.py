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
Every law with its recommended settings over the cases of the study, against `compensation`.

A law whose errors are larger than those of the original law shows here: docs/laws.md says under
which condition, and what to take instead.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import math

from ctc_chattering.analysis.markup import fragment, Markup
from ctc_chattering.analysis.tables import bold, Table
from ctc_chattering.studies.study import CaseOutcome, engines, rows

BASE = 'compensation'


def ratio(outcome: CaseOutcome, base: CaseOutcome) -> float:
    """Return the RMS error over that of `base`, of the joint where it is larger; inf: diverged."""
    if outcome.score.failure or base.score.failure:
        return math.inf
    return max(mine / theirs for mine, theirs in zip(outcome.score.rms, base.score.rms))


def about(outcomes: Sequence[CaseOutcome]) -> Markup:
    """Return what the table shows."""
    return fragment(
        'Output of <code>ctc study --laws</code>: RMS error of each law with its recommended '
        'settings, over that of <code>{{ base }}</code> with the gains of the paper; of the two '
        'joints the larger ratio. True errors, the second half of each run. Delay, lag and rate '
        'limit of the drives are given where a law takes them, unless the case says otherwise; '
        'Coulomb friction is given to <code>slotine_li</code> and '
        '<code>friction_feedforward</code>. Bold: worse than <code>{{ base }}</code> by more than '
        '1 %; inf: diverged. {{ engines }}.', base=BASE, engines=engines(outcomes))


def tables(outcomes: Sequence[CaseOutcome]) -> Iterator[Table]:
    """Yield the table of ratios; a law that is worse than `compensation` in a case is bold."""
    table = [{o.variant: o for o in row} for row in rows(outcomes)]
    laws = [law for law in table[0] if law != BASE]
    lines = []
    for row in table:
        case, base = row[BASE].case, row[BASE]
        cells = [ratio(row[law], base) for law in laws]
        lines.append([f'{case.group}: {case.name}', *(
            bold(f'{x:.2g}') if x > 1.01 else f'{x:.2g}' for x in cells)])
    yield Table('', ['case', *laws], lines)

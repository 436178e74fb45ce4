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

from __future__ import annotations

from ctc_chattering.control.controller import LAWS
from ctc_chattering.runs.score import Score
from figure_layout import overlaps
from imperfections import Case, CaseOutcome, NOISE, SHORT_NOISE
import imperfections_page as study_page


def outcomes(*groups: str) -> list[CaseOutcome]:
    """Return made-up outcomes of long names under all laws, of which some diverged."""
    cases = [Case(f'a case with a name that is rather long, {k}', group, {}, x=float(k))
             for group in groups for k in (1, 2, 5)]
    return [CaseOutcome(case, law, 1e-3, (1.0, 1.0), Score(failure='diverged') if (i + j) % 3 == 0
                        else Score(rms=(1e-3, 2e-3 * (i + 1)), variation=(9.0, 20.0 * (j + 1))))
            for j, case in enumerate(cases) for i, law in enumerate(LAWS)]


def test_nothing_is_over_a_legend_or_a_label() -> None:
    made = outcomes(NOISE, SHORT_NOISE)
    swept = study_page.sweep(made, (NOISE, SHORT_NOISE), 'A title ' * 20, 'what is changed')
    assert not overlaps(swept)
    texts = [text.get_text() for ax in swept.axes for text in ax.texts]
    assert len(texts) == 4 and all('in all)' in text for text in texts)
    assert not overlaps(study_page.overview(made, 'One imperfection at a time'))

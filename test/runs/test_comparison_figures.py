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

from pathlib import Path

from ctc_chattering.runs import compare_page
from ctc_chattering.runs.compare import BASE, Outcome, Task, variants
from ctc_chattering.runs.conditions import Case, CONDITIONS
from ctc_chattering.runs.score import Score
from figure_layout import overlaps
import pytest


@pytest.mark.parametrize('n', [2, 7])
def test_nothing_is_over_a_legend_or_a_label(n: int) -> None:
    """Check joints and experiments of long names, under two conditions."""
    score = Score(rms=tuple(3e-4 * (k + 1) for k in range(n)),
                  variation=tuple(40.0 * (k + 1) for k in range(n)))
    tasks = [Task(Path('robot.yaml'), condition, variant)
             for condition in (None, list(CONDITIONS.values())[-1])
             for variant in variants()[:9]]
    made = [Outcome(task, 'an_experiment_' * 9, tuple(
        f'a_joint_of_a_robot_{k}' for k in range(n)), (), score) for task in tasks]
    assert not overlaps(compare_page.compromises(made, 'A title ' * 20))
    assert not overlaps(compare_page.errors(made[-9:]))


@pytest.mark.parametrize('count, figures, folded', [(16, 17, 0), (17, 1, 34)])
def test_many_conditions_have_one_figure_and_folded_tables(
        count: int, figures: int, folded: int, tmp_path: Path) -> None:
    score = Score(rms=(1e-3,), variation=(40.0,), step=(1.0,), rate=(1.0,), peak=(1.0,))
    made = [Outcome(Task(Path('robot.yaml'), Case(f'case {k}', f'case {k}'), BASE), 'x', ('j',),
                    ({},), score) for k in range(count)]
    assert len(list(compare_page.figures(made))) == figures
    compare_page.write_page(made, [], tmp_path / 'index.html')
    text = (tmp_path / 'index.html').read_text(encoding='utf-8')
    assert text.count('<summary><b>') == folded and text.count('<table>') == 2 * count

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
from ctc_chattering.runs.compare import Outcome, Task, variants
from ctc_chattering.runs.conditions import CONDITIONS
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
    assert not overlaps(compare_page.trade_off(made, 'A title ' * 20))
    assert not overlaps(compare_page.errors(made[-9:]))

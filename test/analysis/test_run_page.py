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

"""The folder that `write_runs` writes."""

from __future__ import annotations

import json
from pathlib import Path

from ctc_chattering.analysis.run_page import write_runs
from ctc_chattering.errors import CtcError, ParameterError
from made_up_runs import made_up
import pytest


def test_a_page_with_figures_numbers_and_samples(tmp_path: Path) -> None:
    results = [made_up(1, 50)]
    out = tmp_path / 'a' / 'out'
    write_runs(results, str(out), [tmp_path / 'one'], command='mine')
    page = (out / 'index.html').read_text(encoding='utf-8')
    assert all(x in page for x in ('href="../../one"', '<code>mine</code>'))
    assert len(json.loads((out / 'metrics.json').read_text(encoding='utf-8'))['runs']) == 1
    assert len(list((out / 'samples').iterdir())) == 1
    assert len(list((out / 'figures').glob('*.svg'))) == 3
    with pytest.raises(CtcError, match='exists already'):
        write_runs(results, out)


def test_wrong_arguments_are_refused_before_anything_is_written(tmp_path: Path) -> None:
    out = tmp_path / 'out'
    for results, bags, extra, words in (
            ([], (), 'svg', 'results'),
            ([made_up(1, 9)], ['a', 'b'], 'svg', 'none, or 1, one of each'),
            ([made_up(1, 9)], (), 'jpg', 'svg | pdf | png')):
        with pytest.raises(ParameterError, match=words):
            write_runs(results, out, bags, extra)
    assert not out.exists()

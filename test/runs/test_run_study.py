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

from ctc_chattering import study, write_study
from ctc_chattering.control.switching import SWITCHINGS
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.runs import study as cases
from ctc_chattering.runs.study import Case
import pytest

TWO = tuple(Case('0.1 s', group, {
    'plant': {'duration': 0.1, 'compiled': False},
    'controller': {'law': 'chattering', 'ka': [12.0, 12.0]}})
    for group in ('Drive lag', 'Encoder resolution'))


def test_one_group_of_cases_and_its_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cases, 'CASES', TWO)
    done: list[tuple[int, int]] = []
    found = study(groups=['Drive lag'], progress=lambda *x: done.append(x))
    n = len(SWITCHINGS)
    assert [(x.case, x.variant) for x in found] == [(TWO[0], x) for x in SWITCHINGS]
    assert done == [(k, n) for k in range(1, n + 1)]
    with pytest.raises(ParameterError, match=r"groups: 'Drive lags' .*did you mean Drive lag\?"):
        study(groups=['Drive lags'])
    write_study(found, tmp_path, command='mine')
    assert '<code>mine</code>' in (tmp_path / 'study.html').read_text(encoding='utf-8')
    assert len((tmp_path / 'study.csv').read_text(encoding='utf-8').splitlines()) == n + 1
    with pytest.raises(CtcError, match='exists already'):
        write_study(found, tmp_path)
    for outcomes, words in (([], 'one or more'), ([5], r'outcomes\[0\]')):
        with pytest.raises(ParameterError, match=words):
            write_study(outcomes, tmp_path / 'out')  # type: ignore[arg-type]
    assert not (tmp_path / 'out').exists()

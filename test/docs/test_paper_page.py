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

"""validation/paper.md has the rows of `validation/paper_study.py`, and their numbers."""

from __future__ import annotations

from pathlib import Path
import re
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / 'validation' / 'paper.md').read_text(encoding='utf-8')


@pytest.fixture
def study(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(ROOT / 'validation'))
    return pytest.importorskip('paper_study')


def rows(name: str) -> list[list[str]]:
    """Return the cells of a table of the page, its head first."""
    block = re.findall(rf'<!-- table: {name} -->\n(.*?)\n<!--', TEXT, re.DOTALL)[0]
    return [[cell.strip() for cell in row.strip('|').split('|')]
            for row in block.splitlines() if not row.startswith('|---')]


def test_its_tables_have_every_row_and_column(study: Any) -> None:
    head, *body = rows('bound')
    assert head[1:] == list(study.COLUMNS)
    assert len(body) == sum(len(kas) for _, kas in study.LAWS.values())
    head, *body = rows('horizon')
    assert head[2:] == list(study.TOLD) and len(body) == len(study.HORIZONS)


@pytest.mark.slow
def test_numbers_of_its_tables(study: Any) -> None:
    """Of each table a cell; joint 2 in `real_arm` differs by some 10 % with the last bit."""
    for row in rows('bound')[1:3]:
        law, (ka,) = study.LAWS[row[0]]
        error, variation = (float(x) for x in study.cell(law, ka, 'ideal').split(', '))
        assert [float(x) for x in row[1].split(', ')] == pytest.approx(
            [error, variation], rel=0.05)
    error, _ = study.slid(study.HORIZONS[-1], study.TOLD['real arm'])
    assert [float(x) for x in rows('horizon')[-1][2].split(', ')] == pytest.approx(
        error.tolist(), rel=0.25)

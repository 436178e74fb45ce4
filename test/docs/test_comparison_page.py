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

"""docs/comparison.md says what `make compare` wrote, and what the code declares."""

from __future__ import annotations

from math import inf
import re
from statistics import median

from comparison_page import (
    DOCS,
    filled,
    filled_readme,
    held_out_errors,
    lines,
    PAGE,
    README,
)
from ctc_chattering.runs.conditions import ALL, CONDITIONS
import pytest

TEXT = PAGE.read_text(encoding='utf-8')
BLOCKS = re.findall(r'<!-- tables: (\S+) -->', TEXT)


def shown(directory: str, title: str) -> dict[tuple[str, ...], list[str]]:
    """Return the rows of the table with a title, by law, switching and settings."""
    text = (DOCS / directory / 'compare.md').read_text(encoding='utf-8').replace('**', '')
    table = text[text.index(title):].split('\n\n')[1]
    rows = [[x.strip() for x in row.strip('|').split('|')] for row in table.splitlines()[2:]]
    return {tuple(row[:3]): row[3:] for row in rows}


def test_its_tables_are_those_that_were_written() -> None:
    assert filled(TEXT) == TEXT
    assert BLOCKS
    text = README.read_text(encoding='utf-8')
    assert filled_readme(text) == text
    assert '<!-- tables: ' in text


def test_it_has_every_condition() -> None:
    table = TEXT[TEXT.index('| `--condition` |'):].split('\n\n')[0]
    assert re.findall(r'^\| `(\w+)`', table, re.MULTILINE) == [*CONDITIONS, ALL]


@pytest.mark.parametrize('directory', BLOCKS)
def test_each_number_of_the_tables_is_in_the_csv(directory: str) -> None:
    """Check RMS errors joint by joint, and what survived of the held-out conditions."""
    found = [x for x in lines(directory) if x['rms_error'] and x['condition'] == 'real_arm']
    assert found
    for x in found:
        title = f'{x["experiment"]}, {x["condition"]}'
        row = shown(directory, f'{title}: RMS error')[x['law'], x['switching'], x['settings']]
        assert f'{float(x["rms_error"]):.1e}' in row
    table = shown(directory, f'{x["experiment"]}: 24 held-out conditions')
    for variant, row in table.items():
        errors = sorted(held_out_errors(directory, variant))
        assert row[0] == f'{sum(x < inf for x in errors)} of 24'
        assert row[1:3] == [f'{x:.1e}' if x < inf else 'lost'
                            for x in (errors[-1], median(errors))]

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

"""How numbers are shown, and cells of a CSV file that a spreadsheet must not compute."""

from __future__ import annotations

import csv
import io

from ctc_chattering.analysis import tables
from ctc_chattering.analysis.markup import in_html
import pytest


@pytest.mark.parametrize(('text', 'wanted'), [
    (tables.measured(None), '-'), (tables.measured([1.23456e-5, 1234.5]), '1.23e-05 1234'),
    (tables.shown([0.5, 12.34567]), '[0.5, 12.35]'), (tables.shown(True), 'True'),
    (tables.number_text((8.0, 8.0)), '8'), (tables.number_text([8.0, 9.5]), '8/9.5'),
    (tables.in_field([0.1 + 0.2, 1]), '0.3, 1'), (tables.in_field('sign'), 'sign'),
    (tables.with_interval(1.23456, 0.0, 'N*m'), '1.235 N*m'),
    (tables.with_interval(1.23456, 0.0123, 'N*m'), '1.235 ± 0.01 N*m'),
    (tables.with_interval(1.23456, 9.0), '1.23 ± 9'),
    (in_html(None), '<span class="none" title="none">–</span>'),
    (in_html(-1234.5), '<data value="-1234.5">−1234</data>'),
    (in_html(1e-9), '<data value="1e-09">1.00e−09</data>'),
    (tables.number_text([3.0, 1.0, 2.0, 4.0], 3), '1 to 4'),
    (tables.number_text([3.0, 1.0], 3), '3/1'),
    (tables.number_text((2.0,) * 7, 3), '2'), (tables.number_text(0.5, 3), '0.5'),
    (tables.counted(1, 'run'), '1 run'),
    (tables.counted(1200, 'run'), '1\N{NARROW NO-BREAK SPACE}200 runs'),
    (str(tables.rounded(123456.0)), '123000.0'), (str(tables.rounded(1.23456789, 6)), '1.23457')])
def test_text(text: str, wanted: str) -> None:
    assert text == wanted


def test_no_cell_of_a_csv_file_is_a_formula() -> None:
    """Check text from outside; numbers, negative ones as well, are numbers."""
    names = ['=1+1', '+1', '-1', '@SUM(A1)', '\t=1', '\r=1', 'arm =1', '', 'two\n=1']
    text = tables.csv_text([{'name': name, 'error': -1.5, 'count': -2} for name in names])
    rows = list(csv.DictReader(io.StringIO(text, newline='')))
    assert [row['name'] for row in rows] == [
        "'=1+1", "'+1", "'-1", "'@SUM(A1)", "' =1", "' =1", 'arm =1', '', 'two =1']
    assert {(row['error'], row['count']) for row in rows} == {('-1.5', '-2')}

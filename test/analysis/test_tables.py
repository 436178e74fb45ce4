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

"""Cells of a CSV file that a spreadsheet must not compute."""

from __future__ import annotations

import csv
import io

from ctc_chattering.analysis import tables


def test_no_cell_of_a_csv_file_is_a_formula() -> None:
    """Check text from outside; numbers, negative ones as well, are numbers."""
    names = ['=1+1', '+1', '-1', '@SUM(A1)', '\t=1', '\r=1', 'arm =1', '', 'two\n=1']
    text = tables.csv_text([{'name': name, 'error': -1.5, 'count': -2} for name in names])
    rows = list(csv.DictReader(io.StringIO(text, newline='')))
    assert [row['name'] for row in rows] == [
        "'=1+1", "'+1", "'-1", "'@SUM(A1)", "' =1", "' =1", 'arm =1', '', 'two =1']
    assert {(row['error'], row['count']) for row in rows} == {('-1.5', '-2')}

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

"""Numbers as text for messages, terminals and pages."""

from __future__ import annotations

from math import ceil, floor, inf

from ctc_chattering.analysis.markup import in_html
from ctc_chattering.number_format import (
    format_count,
    format_interval,
    format_joint_values,
    format_number,
    format_numbers,
    format_value,
    round_number,
    round_towards,
)
import pytest


@pytest.mark.parametrize(('text', 'expected'), [
    (format_number(None), '-'), (format_number(99.96), '100'), (format_number(inf), 'inf'),
    (format_number(1e8), '1e+08'), (format_number(-1234.5, 4), '-1234'),
    (format_numbers([1.23456e-5, 1234.5]), '1.23e-05 1234'), (format_numbers(None), '-'),
    (format_value([0.5, 12.34567]), '0.5, 12.35'), (format_value(True), 'True'),
    (format_value([0.1 + 0.2, 1], 12), '0.3, 1'), (format_value('sign'), 'sign'),
    (format_joint_values((8.0, 8.0)), '8'), (format_joint_values([8.0, 9.5]), '8/9.5'),
    (format_joint_values([3.0, 1.0, 2.0, 4.0], 3), '1 to 4'),
    (format_joint_values([3.0, 1.0], 3), '3/1'),
    (format_joint_values((2.0,) * 7, 3), '2'), (format_joint_values(0.5, 3), '0.5'),
    (format_interval(1.23456, 0.0, 'N*m'), '1.235 N*m'),
    (format_interval(1.23456, 0.0123, 'N*m'), '1.235 ± 0.01 N*m'),
    (format_interval(1.23456, 9.0), '1.23 ± 9'),
    (format_interval(-14.3, 11.0), '-14.3 ± 10'),
    (format_count(1, 'run'), '1 run'),
    (format_count(1200, 'run'), '1\N{NARROW NO-BREAK SPACE}200 runs'),
    (in_html(None), '<span class="none" title="none">–</span>'),
    (in_html(-1234.5), '<data value="-1234.5">−1234</data>'),
    (in_html(1.5), '<data value="1.5">1.50</data>'),
    (in_html(1e-9), '<data value="1e-09">1.00e−09</data>')])
def test_text_of_a_number(text: str, expected: str) -> None:
    assert text == expected


@pytest.mark.parametrize(('rounded', 'expected'), [
    (round_number(123456.0), 123000.0), (round_number(1.23456789, 6), 1.23457),
    (round_towards(12.01, 2, ceil), 13.0), (round_towards(12.99, 2, floor), 12.0),
    (round_towards(0.1 + 0.2, 1, ceil), 0.3), (round_towards(0.0, 2, ceil), 0.0),
    (round_towards(inf, 2, floor), inf)])
def test_rounding_to_significant_digits(rounded: float, expected: float) -> None:
    assert rounded == expected

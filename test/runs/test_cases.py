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

"""Files of cases for `ctc compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ctc_chattering import compare
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.package_share import config_directory, find_config
from ctc_chattering.errors import CtcError
from ctc_chattering.runs.conditions import read_cases
from ctc_chattering.runs.score import score
import pytest

CASES = """
overrides:
  plant: {duration: 6.0, compiled: false}
cases:
  Drive lag:
    2 ms: {x: 2, plant: {actuator_lag: [2.0e-3, 2.0e-3]}}
  Sample period:
    5 ms: {'/**': {control_period: 5.0e-3}, plant: {duration: 7.0}}
"""


def test_a_case_is_above_what_all_have_and_that_above_the_file(tmp_path: Path) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text(CASES)
    found = compare(['friction'], ['compensation'], cases=file)
    assert [x.task.condition.name for x in found if x.task.condition] == [
        'Drive lag: 2 ms', 'Sample period: 5 ms']
    given: tuple[dict[str, Any], ...] = (
        {'plant': {'duration': 6.0, 'compiled': False, 'actuator_lag': [2e-3, 2e-3]}},
        {'/**': {'control_period': 5e-3}, 'plant': {'duration': 7.0, 'compiled': False}})
    for outcome, values in zip(found, given, strict=True):
        setup = parameter_file.load(config_directory() / 'friction.yaml',
                                    {**values, 'controller': {'law': 'compensation'}})
        assert outcome.score == score(setup)


@pytest.mark.parametrize('old, new, words', [
    ('actuator_lag', 'actuator_lags', 'actuator_lags.*did you mean'),
    ('overrides', 'override', 'override.*did you mean overrides'),
    ("'/**'", 'robot', '5 ms.*robot.*controller'), ('cases:', 'cases: 3\nx:', 'x'),
    ('    2 ms: {x: 2, plant: {actuator_lag: [2.0e-3, 2.0e-3]}}', '    2 ms: 3', '2 ms.*3')])
def test_what_is_wrong_is_named_before_anything_runs(
        old: str, new: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text(CASES.replace(old, new))
    with pytest.raises(CtcError, match=words):
        compare(['friction'], ['compensation'], cases=file)


def test_the_cases_of_the_package_are_allowed() -> None:
    cases = read_cases(find_config('imperfections', folder='cases'))
    assert len({case.name for case in cases}) == len(cases) == 81
    for case in cases:
        parameter_file.load(config_directory() / 'friction.yaml', case.values)
    with pytest.raises(CtcError, match='did you mean imperfections'):
        compare(['friction'], cases='imperfection')

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

"""`ctc stability`: its table, its files, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

from ctc_commands import ctc, refused
import pytest

LAW = ('stability', '--law', 'observer_feedback')


def test_table_and_files(tmp_path: Path) -> None:
    """The intervals printed lie within those of the file, and a robot with lag stands less."""
    result = ctc(*LAW, '--lag', 0.002, '--out', tmp_path)
    assert result.returncode == 0, result.stderr
    lines = result.stdout.splitlines()
    assert lines[1:3] == ['law: lag 3 ms, delay 0', 'robot: lag 2 ms, delay 0']
    found = json.loads((tmp_path / 'stability.json').read_text(encoding='utf-8'))
    (shown,) = (line for line in lines if ', constant' in line)
    low, high = (float(shown.split()[k]) for k in (-3, -1))
    assert found['ratios'] == [pytest.approx(low, rel=0.1), pytest.approx(high, rel=0.1)]
    assert found['ratios'][0] <= low < high <= found['ratios'][1]
    assert found['ratios'][0] < found['guaranteed'][0] < found['guaranteed'][1] < high
    assert (tmp_path / 'figures' / 'region.svg').exists()


def test_an_unstable_loop_has_status_1() -> None:
    result = ctc(*LAW, '--lag', 0.02)
    assert result.returncode == 1
    assert 'unstable: a pole at 1.0' in result.stdout


def test_refuses() -> None:
    refused(ctc('stability', '--law', 'chattering'), 'chattering sign is not linear')
    refused(ctc(*LAW, '--gains', 'file', '--lag', -1.0), 'actuator_lag', '-1', '>= 0')
    refused(ctc(*LAW, '--gains', 'file', '--delay', 300), 'input_delay', '300', '<= 100')

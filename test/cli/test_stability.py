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

"""`ctc stability`: its table, its status, and what it refuses."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.configuration import parameter_file
from ctc_chattering.runs.stability import stability
from ctc_commands import ctc
import pytest

LAW = ('--law', 'observer_feedback', '--gains', 'recommended')


def robot(folder: Path, lag: float) -> Path:
    """Return a parameter file of the paper's arm with drives of this lag [s]."""
    file = folder / 'robot.yaml'
    file.write_text(f'plant: {{ros__parameters: {{actuator_lag: [{lag}, {lag}]}}}}\n'
                    'controller: {ros__parameters: {actuator_lag: [0.003, 0.003]}}\n')
    return file


def test_the_table_is_rounded_inwards(tmp_path: Path) -> None:
    file = robot(tmp_path, 0.002)
    result = ctc('stability', file, *LAW)
    assert result.returncode == 0, result.stderr
    lines = result.stdout.splitlines()
    assert lines[1:3] == ['law: lag 3 ms, delay 0', 'robot: lag 2 ms, delay 0']
    over, _ = parameter_file.with_gains(file, {'controller': {'law': LAW[1]}}, LAW[3])
    found = stability(parameter_file.load(file, over))
    (shown,) = (line for line in lines if ', constant' in line)
    low, high = (float(shown.split()[k]) for k in (-3, -1))
    assert found.ratios is not None and found.guaranteed is not None
    assert found.ratios == pytest.approx((low, high), rel=0.1)
    assert found.ratios[0] <= low < high <= found.ratios[1]
    assert found.ratios[0] < found.guaranteed[0] < found.guaranteed[1] < high


def test_an_unstable_loop_has_status_1(tmp_path: Path) -> None:
    result = ctc('stability', robot(tmp_path, 0.02), *LAW)
    assert result.returncode == 1
    assert 'unstable: a pole at 1.0' in result.stdout

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

"""A short soak test of a real graph."""

from __future__ import annotations

import json
import os
from pathlib import Path
import subprocess
import sys
import time
from typing import Any

from ctc_chattering.bags.repair import open_bag
from processes import PATIENCE
import pytest
from soak import plan

pytestmark = pytest.mark.ros
ROOT = Path(__file__).resolve().parents[2]
#: Slow enough for two processors that others use as well.
PERIOD = 0.005


def start(out: Path, minutes: float, seed: int = 1) -> subprocess.Popen[str]:
    paths = ROOT / 'tools', ROOT / 'test' / 'support', ROOT
    return subprocess.Popen(
        [sys.executable, '-m', 'soak', f'--minutes={minutes}', f'--seed={seed}',
         f'--control-period={PERIOD}', '--out', str(out)], text=True, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, env={**os.environ, 'PYTHONPATH': os.pathsep.join(map(str, paths))})


def ended(process: subprocess.Popen[str], out: Path) -> dict[str, Any]:
    """Check what every end has; return the document."""
    stdout, stderr = process.communicate(timeout=3 * PATIENCE)
    assert 'Traceback' not in stderr + (out / 'soak.log').read_text(encoding='utf-8')
    document: dict[str, Any] = json.loads((out / 'soak.json').read_text(encoding='utf-8'))
    assert process.returncode == bool(document['complaints']), stderr
    assert document['complaints'] == [], (out / 'soak.log').read_text(encoding='utf-8')
    assert stdout == (out / 'soak.md').read_text(encoding='utf-8')
    bags = sorted(x for x in (out / 'bags').iterdir() if x.suffix != '.damaged')
    assert len(bags) == document['bags']['count'] == (
        1 + document['processes']['recorder']['restarts'])
    for bag in bags:
        open_bag(bag).close()
    for name in ('plant', 'controller'):
        assert document['processes'][name]['samples'] > 0.5 * document['duration_s'] / PERIOD
    assert all(p['memory_kb'][-1] > 1e4 for p in document['processes'].values())
    return document


@pytest.mark.slow
def test_a_short_soak_is_passed(tmp_path: Path) -> None:
    begin = time.monotonic()
    process = start(tmp_path / 'out', 0.4, seed=5)
    document = ended(process, tmp_path / 'out')
    assert time.monotonic() - begin < 60.0
    kinds = [x['kind'] for x in document['faults']]
    assert len(kinds) >= 4 and plan.KILL in kinds
    again = start(tmp_path / 'out', 0.4)
    _, stderr = again.communicate(timeout=PATIENCE)
    assert again.returncode == 1 and 'exists already' in stderr

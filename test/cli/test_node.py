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

"""The nodes' executables before there is a node."""

from __future__ import annotations

import os
from pathlib import Path
import signal
import subprocess
import sys

from processes import PATIENCE, wait_for
import pytest

pytestmark = pytest.mark.ros


@pytest.mark.parametrize(('name', 'number'), [
    ('plant', signal.SIGINT), ('controller', signal.SIGTERM), ('reference', signal.SIGINT),
    ('recorder', signal.SIGTERM)])
def test_a_signal_while_it_imports_ends_it_without_a_traceback(
        name: str, number: signal.Signals, tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, '-m', 'ctc_chattering.cli.node', name, '--ros-args', '-p',
         f'bag:={tmp_path / "bag"}'] if name == 'recorder' else
        [sys.executable, '-m', 'ctc_chattering.cli.node', name],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        maps = Path(f'/proc/{process.pid}/maps')
        wait_for(lambda: 'rclpy' in maps.read_text(), 'rclpy to be imported')
        process.send_signal(number)
        output, _ = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    assert (process.returncode, output) == (0, '')
    assert not (tmp_path / 'bag').exists()


def test_numpy_starts_no_threads() -> None:
    """For each processor OpenBLAS would start one, which computes in vain at first."""
    program = "import ctc_chattering.cli, numpy, os; print(len(os.listdir('/proc/self/task')))"
    environment = {name: value for name, value in os.environ.items() if 'THREADS' not in name}
    assert subprocess.check_output([sys.executable, '-c', program], env=environment) == b'1\n'

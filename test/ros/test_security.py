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

"""Security that is enforced: who cannot keep to it does not begin."""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys

from domains import own_domain
from processes import CONFIG, PATIENCE
import pytest

pytestmark = pytest.mark.ros


def test_enforced_security_without_a_keystore_ends_all_at_once(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One line, status 1, no traceback, and nothing is left: neither a process nor a bag."""
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_STRATEGY', 'Enforce')
    monkeypatch.delenv('ROS_SECURITY_KEYSTORE', raising=False)
    bag = tmp_path / 'bag'
    arguments = {
        'bringup': ['bringup', '--params-file', str(CONFIG / 'friction.yaml'), '--record',
                    str(bag)],
        'recorder': ['node', 'recorder', '--ros-args', '-p', f'bag:={bag}']}
    with own_domain():
        processes = {name: subprocess.Popen(
            [sys.executable, '-m', f'ctc_chattering.cli.{module}', *more], text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            for name, (module, *more) in arguments.items()}
        outputs = {name: process.communicate(timeout=2 * PATIENCE)[0]
                   for name, process in processes.items()}
    for name, output in outputs.items():
        assert processes[name].returncode == 1, output
        assert output.startswith(f'{name}: ') and len(output.splitlines()) == 1
        assert 'ROS_SECURITY_KEYSTORE is not set' in output
    assert not bag.exists()

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

"""The profile for Fast DDS, and what it does to the sockets of a process."""

from __future__ import annotations

import os
from pathlib import Path

from ctc_chattering.ros.process import use_profile, VARIABLES
from processes import CONFIG, has_port, probe
import pytest
from rclpy.utilities import get_rmw_implementation_identifier


def test_it_is_used_unless_there_is_another_one(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in VARIABLES:
        monkeypatch.setenv(name, 'before the test')  # To be put back afterwards.
        monkeypatch.delenv(name)
    use_profile()
    assert os.environ[VARIABLES[0]] == str(CONFIG / 'fastdds.xml')
    for name in VARIABLES:
        monkeypatch.delenv(VARIABLES[0], raising=False)
        monkeypatch.setenv(name, 'theirs.xml')
        use_profile()
        assert [os.environ.get(x) for x in VARIABLES] == [
            'theirs.xml' if x == name else None for x in VARIABLES]
        monkeypatch.delenv(name)


@pytest.mark.ros
@pytest.mark.parametrize('theirs', [False, pytest.param(True, marks=pytest.mark.slow)])
def test_no_process_writes_into_the_memory_of_a_node_by_default(
        theirs: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A node that has no port in shared memory cannot be cut off from it, nor hold others up."""
    if get_rmw_implementation_identifier() != 'rmw_fastrtps_cpp':
        pytest.skip('not Fast DDS')
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    if theirs:
        profile = tmp_path / 'profile.xml'
        profile.write_text('<profiles><participant profile_name="plain"/></profiles>')
        monkeypatch.setenv(VARIABLES[0], str(profile))
    with probe() as it:
        child = it.start('reference')
        it.until(lambda: 'reference' in it.node.get_node_names(), 'the node')
        assert has_port(child.process.pid) == theirs
        assert not has_port(os.getpid())  # Else a killed node may take the tests with it.

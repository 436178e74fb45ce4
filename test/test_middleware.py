"""The profile for Fast DDS, and what it does to the sockets of a process."""

from __future__ import annotations

import os
from pathlib import Path
import subprocess
import sys
from xml.etree import ElementTree

import pytest
from rclpy.utilities import get_rmw_implementation_identifier
from ros import CONFIG, wait_for

from ctc_chattering.domain import own_domain
from ctc_chattering.middleware import use_profile, VARIABLES


def test_it_is_used_unless_there_is_another_one(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in VARIABLES:
        monkeypatch.setenv(name, 'before the test')  # To be put back afterwards.
        monkeypatch.delenv(name)
    use_profile()
    assert os.environ[VARIABLES[0]] == str(CONFIG / 'fastdds.xml')
    assert ElementTree.parse(os.environ[VARIABLES[0]]).getroot().tag.endswith('profiles')
    for name in VARIABLES:
        monkeypatch.delenv(VARIABLES[0], raising=False)
        monkeypatch.setenv(name, 'theirs.xml')
        use_profile()
        assert [os.environ.get(x) for x in VARIABLES] == [
            'theirs.xml' if x == name else None for x in VARIABLES]
        monkeypatch.delenv(name)


@pytest.mark.ros
@pytest.mark.parametrize('how', ['LOCALHOST', 'SUBNET'])
@pytest.mark.parametrize('ours', [True, False])
def test_nobody_can_write_into_the_memory_of_a_node(
        how: str, ours: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A node that has no port in shared memory cannot be cut off from it, nor hold others up."""
    if get_rmw_implementation_identifier() != 'rmw_fastrtps_cpp':
        pytest.skip('not Fast DDS')
    (tmp_path / 'default.xml').write_text('<profiles/>')
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    if not ours:
        monkeypatch.setenv(VARIABLES[0], str(tmp_path / 'default.xml'))
    with own_domain():
        monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', how)
        bag = tmp_path / 'bag'
        process = subprocess.Popen([
            sys.executable, '-m', 'ctc_chattering.cli.node', 'recorder', '--ros-args', '-p',
            f'bag:={bag}'])
        try:
            wait_for(bag.exists, 'the recorder')
            mapped = Path(f'/proc/{process.pid}/maps').read_text()
        finally:
            process.terminate()
            process.wait()
    assert ('/dev/shm/fastrtps_port' in mapped) == (not ours)

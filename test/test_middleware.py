"""The profile for Fast DDS, and what it does to the sockets of a process."""

from __future__ import annotations

import os
from pathlib import Path
import subprocess
import sys
from xml.etree import ElementTree

from faults import nodes_of
import pytest
from rclpy.utilities import get_rmw_implementation_identifier
from ros import CONFIG, wait_for

from ctc_chattering.domain import own_domain
from ctc_chattering.middleware import use_profile, VARIABLES


@pytest.mark.parametrize('real_time', [True, False])
def test_it_is_used_unless_there_is_another_one(
        real_time: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in VARIABLES:
        monkeypatch.setenv(name, 'before the test')  # To be put back afterwards.
        monkeypatch.delenv(name)
    use_profile(real_time)
    profile = Path(os.environ[VARIABLES[0]])
    assert profile.parent == CONFIG
    text = ElementTree.tostring(ElementTree.parse(profile).getroot(), encoding='unicode')
    assert ('udpv4' in text) == real_time
    for name in VARIABLES:
        monkeypatch.delenv(VARIABLES[0], raising=False)
        monkeypatch.setenv(name, 'theirs.xml')
        use_profile(real_time)
        assert [os.environ.get(x) for x in VARIABLES] == [
            'theirs.xml' if x == name else None for x in VARIABLES]
        monkeypatch.delenv(name)


@pytest.mark.ros
@pytest.mark.parametrize('how', ['LOCALHOST', 'SUBNET'])
@pytest.mark.parametrize('pacing', ['real_time', 'lockstep'])
def test_in_real_time_nobody_writes_into_the_memory_of_a_node(
        how: str, pacing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A node that has no port in shared memory cannot be cut off from it, nor hold others up."""
    if get_rmw_implementation_identifier() != 'rmw_fastrtps_cpp':
        pytest.skip('not Fast DDS')
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    bag = tmp_path / 'bag'
    with own_domain():
        monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', how)
        process = subprocess.Popen([
            sys.executable, '-m', 'ctc_chattering.cli.bringup', '--pacing', pacing, '--duration',
            '0', '--record', str(bag)], stdout=subprocess.DEVNULL)
        try:
            wait_for(bag.exists, 'the recorder')
            pid = nodes_of(process.pid)['recorder']
            mapped = Path(f'/proc/{pid}/maps').read_text()
        finally:
            process.terminate()
            process.wait()
    assert ('/dev/shm/fastrtps_port' in mapped) == (pacing == 'lockstep')

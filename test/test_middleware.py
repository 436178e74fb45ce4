"""The profile for Fast DDS, and what it does to the sockets of a process."""

from __future__ import annotations

import os
from pathlib import Path

from faults import nodes_of
import pytest
from rclpy.utilities import get_rmw_implementation_identifier
from ros import bringup, CONFIG, descriptors, PLAIN, probe, wait_for

from ctc_chattering.middleware import use_profile, VARIABLES


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


def has_port(pid: int) -> bool:
    """Return whether others can write into the memory of a process."""
    return any(path.startswith('/dev/shm/fastrtps_port') for path in descriptors(pid))


@pytest.fixture
def _fast_dds(monkeypatch: pytest.MonkeyPatch) -> None:
    if get_rmw_implementation_identifier() != 'rmw_fastrtps_cpp':
        pytest.skip('not Fast DDS')
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)


@pytest.mark.ros
@pytest.mark.usefixtures('_fast_dds')
@pytest.mark.parametrize('how', ['LOCALHOST', 'SUBNET'])
def test_nobody_writes_into_the_memory_of_what_bringup_starts(
        how: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A node that has no port in shared memory cannot be cut off from it, nor hold others up."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', how)
    bag = tmp_path / 'bag'
    with bringup('--duration', '0', '--record', str(bag)) as process:
        wait_for(lambda: len(nodes_of(process.pid)) == 4 and bag.exists(), 'the nodes')
        pids = [process.pid, *nodes_of(process.pid).values()]
        ports = [has_port(pid) for pid in pids]
        process.terminate()
        process.wait()
    assert ports == [False] * 5


@pytest.mark.ros
@pytest.mark.usefixtures('_fast_dds')
@pytest.mark.parametrize('theirs', [False, True])
def test_a_node_started_alone_is_like_that_unless_told_otherwise(
        theirs: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if theirs:
        profile = tmp_path / 'profile.xml'
        profile.write_text(PLAIN)
        monkeypatch.setenv(VARIABLES[0], str(profile))
    with probe() as it:
        child = it.start('reference')
        it.until(lambda: 'reference' in it.node.get_node_names(), 'the node')
        assert has_port(child.process.pid) == theirs

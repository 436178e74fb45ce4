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

"""Who may talk: security that is enforced, and a graph that is confined to this host."""

from __future__ import annotations

import os
from pathlib import Path
import subprocess
import sys

from domains import own_domain
from faults import nodes_of
from processes import alive, CONFIG, descriptors, has_port, PATIENCE, wait_for
import pytest
from rclpy.utilities import get_rmw_implementation_identifier

pytestmark = pytest.mark.ros
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
ENFORCED = {'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce'}
NODES = ('plant', 'controller', 'reference', 'recorder')


def command(name: str, folder: Path) -> list[str]:
    """Return the command line of a node, or of bringup."""
    if name == 'bringup':
        return [sys.executable, '-m', 'ctc_chattering.cli.bringup', '--params-file',
                str(CONFIG / 'friction.yaml'), '--record', str(folder / 'bag')]
    bag = ('--ros-args', '-p', f'bag:={folder / "bag"}') if name == 'recorder' else ()
    return [sys.executable, '-m', 'ctc_chattering.cli.node', name, *bag]


@pytest.mark.parametrize(
    'keystore', ['unset', pytest.param('without the libraries', marks=pytest.mark.slow)])
def test_enforced_security_without_a_keystore_ends_all_at_once(
        keystore: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One line, status 1, no traceback, and nothing is left: neither a process nor a bag."""
    place = tmp_path / 'keys'
    words = {'unset': 'ROS_SECURITY_KEYSTORE is not set',
             'without the libraries': ''}[keystore]
    if keystore == 'without the libraries':
        (place / 'enclaves').mkdir(parents=True)
    for name, value in ENFORCED.items():
        monkeypatch.setenv(name, value)
    monkeypatch.delenv('ROS_SECURITY_KEYSTORE', raising=False)
    if keystore != 'unset':
        monkeypatch.setenv('ROS_SECURITY_KEYSTORE', str(place))
    with own_domain():
        processes = {name: subprocess.Popen(
            command(name, tmp_path / name), text=True, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT) for name in (*NODES, 'bringup')}
        outputs = {name: process.communicate(timeout=2 * PATIENCE)[0]
                   for name, process in processes.items()}
    for name, output in outputs.items():
        assert processes[name].returncode == 1, output
        mine = [line for line in output.splitlines() if line.startswith(f'{name}: ')]
        assert len(mine) == 1, output
        assert words in mine[0]
        if keystore != 'without the libraries':  # Then ROS adds lines of its own.
            assert len(output.splitlines()) == 1
            assert 'Traceback' not in output
    assert not list(tmp_path.glob('*/bag'))


def environment(pid: int) -> dict[str, str]:
    """Return the environment that a process was started with."""
    text = Path(f'/proc/{pid}/environ').read_text()
    return dict(item.split('=', 1) for item in text.split('\0') if '=' in item)


def multicast(pid: int, domain: int) -> bool:
    """Return whether a process listens where others of the network announce themselves."""
    port = 7400 + 250 * domain
    rows = [line.split() for line in Path('/proc/net/udp').read_text().splitlines()[1:]]
    inodes = {row[9] for row in rows if int(row[1].split(':')[1], 16) == port}
    links = descriptors(pid)
    return any(f'socket:[{inode}]' in links for inode in inodes)


@pytest.mark.parametrize(('before', 'after'), [
    (None, 'LOCALHOST'), pytest.param('SUBNET', 'SUBNET', marks=pytest.mark.slow)])
def test_what_bringup_starts_is_confined_to_this_host(
        before: str | None, after: str, tmp_path: Path) -> None:
    """By its environment, and by its sockets; unless the environment says otherwise."""
    bag = tmp_path / 'bag'
    with own_domain() as domain:
        del os.environ[RANGE]
        process = subprocess.Popen(
            [*command('bringup', tmp_path), '--duration', '0'], text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            env={**os.environ, **({} if before is None else {RANGE: before})})
        try:
            wait_for(lambda: len(nodes_of(process.pid)) == len(NODES) and bag.exists(),
                     'the nodes')
            found = nodes_of(process.pid)
            assert {name: environment(pid)[RANGE] for name, pid in found.items()} == (
                dict.fromkeys(NODES, after))
            if get_rmw_implementation_identifier() == 'rmw_fastrtps_cpp':
                assert not any(has_port(pid) for pid in (*found.values(), process.pid))
                # The recorder has its bag after its sockets; bringup comes last.
                pids = (found['recorder'], process.pid)
                if after == 'SUBNET':
                    wait_for(lambda: all(multicast(pid, domain) for pid in pids), 'multicast')
                else:
                    assert not any(multicast(pid, domain) for pid in (*found.values(), *pids))
        finally:
            process.terminate()
            output, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, output
    assert alive(list(found.values())) == []

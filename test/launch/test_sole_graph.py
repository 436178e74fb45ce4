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

"""One graph in a domain and namespace, of several real ones."""

from __future__ import annotations

import os
from pathlib import Path
import subprocess
import sys

from domains import own_domain
from faults import endless, nodes_of, running
from processes import bringup, PATIENCE, probe, wait_for
import pytest
import rclpy

pytestmark = pytest.mark.ros
SHORT = 'friction', '--pacing', 'lockstep', '--duration', '0.1'


def started(*arguments: str) -> subprocess.Popen[str]:
    """Start another bringup in the domain of this process."""
    return subprocess.Popen(
        [sys.executable, '-m', 'ctc_chattering.cli.bringup', *arguments], text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT)


def test_a_second_bringup_is_refused_by_the_name_of_the_first_which_goes_on(tmp_path: Path
                                                                            ) -> None:
    """In another namespace it runs; and in this one once the first was killed."""
    bag = tmp_path / 'bag'
    with bringup(*endless(bag)) as process:
        pids = running(process, bag)
        size = sum(x.stat().st_size for x in bag.glob('*.mcap'))
        output, _ = (second := started(*SHORT)).communicate(timeout=PATIENCE)
        assert second.returncode == 1
        where = f'ROS_DOMAIN_ID {os.environ["ROS_DOMAIN_ID"]} and namespace /'
        assert f'bringup: another bringup runs in {where}: process {process.pid}, ' in output
        assert f'ctc_chattering.cli.bringup {" ".join(endless(bag))}' in output
        assert '__ns:=/NAME' in output
        assert '[plant]' not in output
        output, _ = (other := started(*SHORT, '--ros-args', '-r', '__ns:=/other')).communicate(
            timeout=PATIENCE)
        assert other.returncode == 0, output
        wait_for(lambda: sum(x.stat().st_size for x in bag.glob('*.mcap')) > size + 20_000,
                 'more samples')
        assert nodes_of(process.pid) == pids
        process.kill()
        output, _ = (third := started(*SHORT)).communicate(timeout=PATIENCE)
        assert third.returncode == 0, output


def test_of_two_bringups_that_start_at_once_one_runs() -> None:
    with own_domain():
        both = [started(*SHORT) for _ in range(2)]
        outputs = [process.communicate(timeout=PATIENCE)[0] for process in both]
    assert sorted(process.returncode for process in both) == [0, 1], outputs


def test_nodes_that_no_bringup_has_started_are_named() -> None:
    with probe() as it:
        nodes = [rclpy.create_node(name, context=it.context, namespace=namespace)
                 for name, namespace in (('plant', '/'), ('reference', '/other'))]
        output, _ = (process := started(*SHORT)).communicate(timeout=PATIENCE)
        assert process.returncode == 1
        assert 'and namespace /: /plant; stop that one first' in output
        for node in nodes:
            node.destroy_node()

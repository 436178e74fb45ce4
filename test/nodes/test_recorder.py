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

"""What the recorder loses when it is killed, and when it cannot keep up; and that it says so."""

from __future__ import annotations

from ast import literal_eval
from collections.abc import Iterator
from contextlib import closing
import itertools
import os
from pathlib import Path
import random
import resource
import signal
from tempfile import TemporaryDirectory
import time
from typing import Any

from bags import joint_state
from ctc_chattering.bags.repair import open_bag, recover
from ctc_chattering.launch import child_process
from ctc_chattering.ros.messages import read_stamp
from ctc_chattering.ros.topics import COMMANDS, DIAGNOSTICS, JOINT_STATES, ROBOT_DESCRIPTION
from faults import Diagnostics, ERROR
import numpy as np
from processes import PATIENCE, Probe, probe, Stopwatch
import pytest
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from recorded_runs import metadata
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

pytestmark = pytest.mark.ros
STATES = f'/{JOINT_STATES}'


#: Largest size of a bag without a message [bytes].
EMPTY = 500


def recorded(bag: Path) -> dict[str, list[bytes]]:
    """Return the messages of a bag by topic, as `ctc plot` reads them."""
    found: dict[str, list[bytes]] = {}
    with TemporaryDirectory() as scratch:
        if not (bag / 'metadata.yaml').exists():  # It is being recorded.
            recover(bag, Path(scratch) / 'bag')
            bag = Path(scratch) / 'bag'
        with closing(open_bag(bag)) as reader:
            for connection, _, data in reader.messages():
                found.setdefault(connection.topic, []).append(bytes(data))
    return found


def size(bag: Path) -> int:
    file = bag / f'{bag.name}_0.mcap'
    return file.stat().st_size if file.exists() else 0


def test_messages_without_a_pause_do_not_keep_it_from_the_disk(tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    with probe() as it:
        reports = Diagnostics(it)
        recorder = it.start('recorder', '-p', f'bag:={bag}')
        publisher = it.node.create_publisher(Float64MultiArray, COMMANDS, 1000)

        def publish() -> bool:
            for _ in range(10):
                publisher.publish(Float64MultiArray(data=[1.0, 2.0]))
                time.sleep(3e-4)
            return True

        it.until(lambda: publish() and size(bag) > EMPTY, 'the first messages')
        watch = Stopwatch(recorder.process.pid, os.getpid())
        growth, reported, latest = [0.0], 0, size(bag)

        def has_reported() -> bool:
            nonlocal reported, latest
            publish()
            reported += reports.latest.pop('recorder', None) is not None
            if size(bag) > latest:
                latest = size(bag)
                growth.append(watch.read())
            return reported > 3

        it.until(has_reported, 'reports')
        assert max(b - a for a, b in itertools.pairwise([*growth, watch.read()])) < 1.0


def dropped(bag: Path) -> list[tuple[bytes, str]]:
    """Return the level of each report of a recorder in a bag, and what it says was dropped."""
    found = []
    with closing(open_bag(bag)) as reader:
        for connection, _, data in reader.messages():
            if connection.topic == DIAGNOSTICS:
                message: Any = reader.deserialize(data, connection.msgtype)
                found += [(bytes([status.level]), value.value) for status in message.status
                          for value in status.values
                          if status.name == '/recorder' and value.key == 'dropped']
    return found


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[tuple[Probe, Path, child_process.Child, Publisher]]:
    """Yield a recorder that hears a publisher of states whose history has one message only."""
    with probe() as it:
        child = it.start('recorder', '-p', f'bag:={tmp_path / "bag"}')
        publisher = it.node.create_publisher(JointState, JOINT_STATES, 1)
        it.until(lambda: publisher.get_subscription_count() > 0, 'the recorder')
        yield it, tmp_path / 'bag', child, publisher


def test_what_is_dropped_is_counted_exactly_and_said(
        recorder: tuple[Probe, Path, child_process.Child, Publisher]) -> None:
    """
    A recorder that is stopped for too long: what it recorded and lost is what was published.

    The publisher sends nothing again; the kernel keeps 8 MB, at 8 kB a message at most 1000.
    """
    it, bag, child, publisher = recorder
    reports, sent = Diagnostics(it), itertools.count()

    def send(count: int) -> bool:
        for _ in range(count):
            message: Any = joint_state(next(sent), ['joint1'], *np.zeros((3, 1))).message
            message.header.frame_id = 'x' * 8000
            publisher.publish(message)
        return True

    it.until(lambda: send(1) and size(bag) > EMPTY, 'the first state')
    child.signal(signal.SIGSTOP)
    it.until(lambda: state_of(child) == 'T', 'that it stops')
    send(3000)
    child.signal(signal.SIGCONT)
    it.until(lambda: send(1) and 'recorder' in reports.latest
             and reports.latest['recorder'].count('dropped') > 0, 'that it counts')
    published = next(sent)

    def recorded_stamps() -> list[int]:
        return [read_stamp(x) for x in recorded(bag)[STATES]]

    def complete() -> bool:
        dropped, found = reports.next('recorder').count('dropped'), recorded_stamps()
        return len(found) + dropped == published - found[0]

    it.until(complete, 'that all is recorded or counted')
    child.signal(signal.SIGINT)
    assert child.process.wait(PATIENCE) == 0
    report = reports.latest['recorder']
    total = report.count('dropped')
    assert total > 2000 and report.count(f'dropped, {STATES}') == total
    assert report.level == ERROR
    assert report.message == f'{total} messages were dropped'
    found = recorded_stamps()
    assert found == sorted(set(found)) and found[-1] == published - 1
    assert len(found) + total == published - found[0]
    assert literal_eval(metadata(bag)['custom_data']['dropped']) == {STATES: total}
    assert (ERROR, str(total)) in dropped(bag)
    assert any('messages were dropped' in line for line in it.lines)
    assert any(line.endswith(f', {total} dropped') for line in it.lines)


def publish(publisher: Publisher, begin: int, count: int) -> None:
    for t in range(begin, begin + count):
        publisher.publish(joint_state(t, ['joint1'], *np.full((3, 1), float(t))).message)


def state_of(child: child_process.Child) -> str:
    return Path(f'/proc/{child.process.pid}/stat').read_text().rsplit(')', 1)[1].split()[0]


def test_a_full_disk_before_the_first_state_ends_the_recording_with_one_line(
        recorder: tuple[Probe, Path, child_process.Child, Publisher]) -> None:
    """The limit on the size of files stands for the end of the disk; the node stays."""
    it, bag, child, publisher = recorder
    reports = Diagnostics(it)
    it.until(lambda: (bag / 'bag_0.mcap').exists(), 'the bag')
    hard = resource.prlimit(child.process.pid, resource.RLIMIT_FSIZE)[1]
    resource.prlimit(child.process.pid, resource.RLIMIT_FSIZE, (20_000, hard))
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    describe = it.node.create_publisher(String, ROBOT_DESCRIPTION, latched)
    describe.publish(String(data=random.Random(1).randbytes(1_000_000).hex()))
    it.until(lambda: describe.get_subscription_count() > 0, 'the recorder')
    assert describe.wait_for_all_acked(Duration(seconds=PATIENCE))
    publish(publisher, 0, 10)
    said = 'recording has stopped: File too large; what was written before is kept'
    it.until(lambda: said in reports.next('recorder').message, 'its report')
    publish(publisher, 10, 10)
    assert reports.next('recorder').level == ERROR
    child.signal(signal.SIGINT)
    assert child.process.wait(PATIENCE) == 1
    assert [said in line for line in it.lines if '[INFO]' not in line] == [True], it.lines

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

"""What the recorder keeps whatever ends it, and what it loses and says so."""

from __future__ import annotations

from ast import literal_eval
from contextlib import closing
import itertools
import os
from pathlib import Path
import resource
import signal
from tempfile import TemporaryDirectory
import time

from ctc_chattering.bags.repair import open_bag, recover, repair
from ctc_chattering.configuration.topics import COMMANDS, JOINT_STATES
from faults import Diagnostics, ERROR
from processes import PATIENCE, probe, Stopwatch
import pytest
from recorded_runs import metadata, reports_of
from ros_messages import ns, state
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

pytestmark = pytest.mark.ros
#: Largest size of a bag without a message [bytes].
EMPTY = 500


def size(bag: Path) -> int:
    file = bag / f'{bag.name}_0.mcap'
    return file.stat().st_size if file.exists() else 0


@pytest.mark.parametrize('full', [False, True])
def test_what_was_heard_a_second_ago_is_kept_whatever_ends_the_recording(
        tmp_path: Path, full: bool) -> None:
    """
    While messages come without a pause it is killed, or the disk is full, and the node stays.

    A limit on the size of files stands for the full disk.
    """
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
        if full:
            resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (size(bag) + 2000,) * 2)
            said = 'the recording has stopped: File too large; '
            it.until(lambda: publish() and 'recorder' in reports.latest
                     and said in reports.latest['recorder'].message, 'the end of the recording')
            assert reports.next('recorder').level == ERROR
            recorder.process.send_signal(signal.SIGINT)
            assert recorder.process.wait(PATIENCE) == 1
            it.until(lambda: any(said in line for line in it.lines), 'the line')
        else:
            watch, end = Stopwatch(recorder.process.pid, os.getpid()), time.monotonic() + 2.5
            it.until(lambda: publish() and time.monotonic() > end, 'the end of some seconds')
            waited = watch.waited()
            recorder.process.send_signal(signal.SIGKILL)
            killed = time.time()
            recorder.process.wait(PATIENCE)
    assert repair(bag) is not None
    with closing(open_bag(bag)) as reader:
        assert reader.message_count > 9
        assert full or reader.end_time / 1e9 > killed - 1.0 - waited


def recorded_stamps(bag: Path) -> list[int]:
    """Return the stamps of the states that are in the files, while they are being written, too."""
    with TemporaryDirectory() as scratch:
        copy = Path(scratch) / 'copy.mcap'
        recover(bag / f'{bag.name}_0.mcap', copy)
        with closing(open_bag(copy)) as reader:
            return [ns(x.header.stamp) for _, x in reader.read(reader.named(JOINT_STATES))]


def test_what_is_dropped_is_counted_exactly_and_said(tmp_path: Path) -> None:
    """
    A recorder that is stopped for too long: what it recorded and lost is what was published.

    The publisher, whose history has one message, sends nothing again; the kernel keeps 8 MB, at
    50 kB a message at most 160. So few are soon sent: stopped for longer than its lease, the
    recorder might not find the publisher again.
    """
    bag, sent = tmp_path / 'bag', itertools.count()
    with probe() as it:
        reports = Diagnostics(it)
        child = it.start('recorder', '-p', f'bag:={bag}')
        publisher = it.node.create_publisher(JointState, JOINT_STATES, 1)
        it.until(publisher.get_subscription_count, 'the recorder')

        def send(count: int) -> bool:
            for _ in range(count):
                message = state(next(sent), joint1=(0.0, 0.0))
                message.header.frame_id = 'x' * 50_000
                publisher.publish(message)
            return True

        it.until(lambda: send(1) and size(bag) > EMPTY, 'the first state')
        child.process.send_signal(signal.SIGSTOP)
        it.until(lambda: ' T ' in Path(f'/proc/{child.process.pid}/stat').read_text(), 'the stop')
        send(500)
        child.process.send_signal(signal.SIGCONT)
        it.until(lambda: send(1) and 'recorder' in reports.latest
                 and reports.latest['recorder'].count('dropped') > 0, 'that it counts')
        published = next(sent)

        def complete() -> bool:
            dropped, found = reports.next('recorder').count('dropped'), recorded_stamps(bag)
            return len(found) + dropped == published - found[0]

        it.until(complete, 'that all is recorded or counted')
        child.process.send_signal(signal.SIGINT)
        assert child.process.wait(PATIENCE) == 0
        report = reports.latest['recorder']
        total = report.count('dropped')
        assert total > 300 and report.count(f'dropped, /{JOINT_STATES}') == total
        assert (report.level, report.message) == (ERROR, f'{total} messages were dropped')
        found = recorded_stamps(bag)
        assert found == sorted(set(found)) and found[-1] == published - 1
        assert len(found) + total == published - found[0]
        assert literal_eval(metadata(bag)['custom_data']['dropped']) == {
            f'/{JOINT_STATES}': total}
        assert reports_of(bag, 'recorder')[-1]['dropped'] == str(total)
        it.until(lambda: any(x.endswith(f', {total} dropped') for x in it.lines), 'the last line')
        assert any('messages were dropped' in line for line in it.lines)

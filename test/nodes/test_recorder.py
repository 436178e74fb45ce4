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
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import closing
import itertools
import os
from pathlib import Path
import random
import resource
import signal
import time
from typing import Any, NamedTuple

from bags import joint_state
from ctc_chattering.analysis.result import simulate
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.bags.repair import is_damaged, open_bag, repair
from ctc_chattering.configuration import parameter_file
from ctc_chattering.errors import CtcError
from ctc_chattering.launch import child_process
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.ros.messages import read_state, StateMessage
from ctc_chattering.ros.subscription import with_info
from ctc_chattering.ros.topics import COMMANDS, DIAGNOSTICS, JOINT_STATES, ROBOT_DESCRIPTION
from faults import Diagnostics, ERROR, OK
from mcap.reader import make_reader
import numpy as np
from processes import CONFIG, PATIENCE, Probe, probe, run_bringup, Stopwatch
import pytest
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from recorded_runs import assert_equal, counts, metadata
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

pytestmark = pytest.mark.ros
STATES, TORQUES = f'/{JOINT_STATES}', f'/{COMMANDS}'
PERIOD = 1_000_000
#: What a killed recorder may lose, beside what comes while it waits for a processor [ns].
LOSS = NANOSECONDS
#: Recorders killed in each graph, by pacing (lockstep is slow), and those alive at the same time.
KILLS, ALIVE = {'lockstep': 6, 'real_time': 2}, 2
#: Largest size of a bag without a message [bytes].
EMPTY = 500


class Seen(NamedTuple):
    """A message that was published: its bytes, when [ns], and its publisher's number."""

    data: bytes
    t: int
    number: int


class Witness:
    """Sees what is published, as fast as it comes, and when it was."""

    def __init__(self, it: Probe) -> None:
        old, it.executor = it.executor, EventsExecutor(context=it.context)
        assert isinstance(old, SingleThreadedExecutor)
        old.remove_node(it.node)
        it.executor.add_node(it.node)
        self.states, self.commands = (self._listen(it, kind, topic) for kind, topic in (
            (JointState, JOINT_STATES), (Float64MultiArray, COMMANDS)))

    def _listen(self, it: Probe, kind: Any, topic: str) -> list[Seen]:
        seen: list[Seen] = []

        def on_message(data: bytes, info: Mapping[str, Any]) -> None:
            seen.append(Seen(
                bytes(data), info['source_timestamp'], info['publication_sequence_number']))

        it.node.create_subscription(kind, topic, with_info(on_message), 100_000, raw=True)
        return seen


def recorded(bag: Path) -> dict[str, list[bytes]]:
    """Return the messages of a bag by topic, as `ctc plot` reads them."""
    found: dict[str, list[bytes]] = {}
    with closing(open_bag(bag)) as reader:
        for connection, _, data in reader.messages():
            found.setdefault(connection.topic, []).append(bytes(data))
    return found


class Killed(NamedTuple):
    """A recorder's bag, and when the recorder was killed [ns]."""

    bag: Path
    end: int
    #: Whether it said before that messages were dropped on the way.
    dropped: bool
    #: For how long others kept the processor from it [ns].
    waited: int


def size(bag: Path) -> int:
    file = bag / f'{bag.name}_0.mcap'
    return file.stat().st_size if file.exists() else 0


def kill_at_random(it: Probe, folder: Path, dice: random.Random, kills: int) -> list[Killed]:
    """Start so many recorders, and kill each of them at a random moment of its life."""
    killed: list[Killed] = []
    running: dict[Path, tuple[child_process.Child, float]] = {}
    watches: dict[Path, Stopwatch] = {}
    begun: dict[Path, int] = {}
    started = 0

    def due() -> bool:
        now = time.time_ns()
        for bag in running:
            if bag not in begun and size(bag) > EMPTY:
                begun[bag] = now
        return any(now - begin > 1e9 * running[bag][1] for bag, begin in begun.items())

    while len(killed) < kills:
        while started < kills and len(running) < ALIVE:
            bag = folder / f'bag{started}'
            running[bag] = it.start('recorder', '-p', f'bag:={bag}'), dice.uniform(0.0, 1.5)
            watches[bag] = Stopwatch(running[bag][0].process.pid)
            started += 1
        it.until(due, 'the moment')
        bag = min(begun, key=lambda x: begun[x] + 1e9 * running[x][1])
        child, _ = running.pop(bag)
        del begun[bag]
        waited = round(1e9 * watches[bag].waited())
        end = time.time_ns()
        child.signal(signal.SIGKILL)
        killed.append(Killed(bag, end, 'were dropped' in child.exit_report(), waited))
    return killed


@pytest.mark.parametrize(
    'pacing', [pytest.param('lockstep', marks=pytest.mark.slow), 'real_time'])
def test_recorders_killed_at_random_moments_lose_a_second_at_most(
        pacing: str, tmp_path: Path) -> None:
    """
    Check that nothing is missing before, unless a recorder that could not keep up said so.

    The loop goes on, with at most the pause of docs/safety.md; others can read the mended bag.
    What was published, and when, says a witness; in lockstep every state in every bag equals the
    simulation, to the last bit, and none is missing between two.
    """
    period: tuple[str, ...] = ()
    law: tuple[str, ...] = ()
    if pacing == 'real_time':
        period = '-p', 'control_period:=0.002'  # The machine has others to serve.
        # Less than the friction: such a motion does not diverge, however late its torques are.
        law = '-p', 'effort_limit:=[1.0, 1.0]'
    with probe() as it:
        reports, witness = Diagnostics(it), Witness(it)
        loop = [it.start('plant', '-p', f'pacing:={pacing}', *period),
                it.start('controller', '-p', 'state_timeout:=5.0', *period, *law),
                it.start('reference')]
        it.until(lambda: len(witness.commands) > 100, 'motion')
        killed = kill_at_random(it, tmp_path, random.Random(pacing), KILLS[pacing])
        count = len(witness.commands)
        it.until(lambda: len(witness.commands) > count + 100, 'that the loop goes on')
        report = reports.next('controller')
        assert (report.count('restarts'), report.count('timeouts, state')) == (0, 0)
        assert [child.status for child in loop] == [None] * 3
        assert not any('Traceback' in line for line in it.lines)

    published = [(read_state(x.data), x.t) for x in witness.states]
    whole = latest = 0
    states: list[StateMessage] = []
    for bag, end, overrun, waited in killed:
        assert is_damaged(bag)
        done = repair(bag)
        assert done is not None
        assert len(others(bag)) == done[0].span.count > 0
        mine = [read_state(data) for data in recorded(bag).get(STATES, [])]
        have = {x.t for x in mine}
        missing = [end - t for x, t in published if mine and mine[0].t <= x.t
                   and x.t not in have]
        assert overrun or max(missing, default=0) <= LOSS + waited, bag
        try:
            whole += len(read_bag(bag).run.t) > 100 and not overrun
        except CtcError as error:  # It was killed before it had met all of the graph.
            assert any(x in str(error) for x in ('no message on', 'no reference', 'no state on'))
        states += mine
        latest = max(latest, *(x.t for x in mine[-1:]), 0)
        if pacing == 'lockstep' and not overrun:
            steps = {b.t - a.t for a, b in itertools.pairwise(mine)}
            assert steps <= {0, PERIOD}  # A state that is not answered at once is sent again.
    assert whole >= KILLS[pacing] // 2
    if pacing == 'lockstep':
        expected = simulate(parameter_file.load(None, {'plant': {'duration': latest / 1e9}})).run
        rows = np.array([x.t // PERIOD for x in states])
        assert np.array_equal(np.array([x.position for x in states]), expected.q[rows])
        assert np.array_equal(np.array([x.velocity for x in states]), expected.dq[rows])


def others(bag: Path) -> list[bytes]:
    """Return the messages that both `rosbags` and `mcap` find in a bag, without help of ours."""
    with AnyReader([bag]) as reader:
        found = [bytes(data) for _, _, data in reader.messages()]
    with (bag / f'{bag.name}_0.mcap').open('rb') as stream:
        assert Counter(found) == Counter(
            message.data for _, _, message in make_reader(stream).iter_messages())
    return found


def test_a_second_at_1_khz_hold_every_sample_and_equal_the_simulation(tmp_path: Path) -> None:
    bag, file = tmp_path / 'bag', CONFIG / 'friction.yaml'
    status, output = run_bringup(
        '--params-file', str(file), '--duration', '1', '--record', str(bag))
    assert status == 0, output
    assert 'were dropped' not in output
    assert_equal(read_bag(bag), simulate(parameter_file.load(file, {'plant': {'duration': 1.0}})))
    found = counts(bag)
    stamps = [read_state(data).t for data in recorded(bag)[STATES]]
    # A state whose answer took long is sent again, and so is the answer.
    assert stamps == sorted(stamps) and sorted(set(stamps)) == [k * PERIOD for k in range(1001)]
    assert len(stamps) == found[STATES]
    assert found[TORQUES] >= 1001
    assert found['/clock'] >= 101
    for topic in ('tracking', 'filter', 'torques'):
        assert found[f'/controller/{topic}'] == 101
    assert not metadata(bag)['custom_data']
    said = dropped(bag)
    assert said
    assert set(said) == {(OK, '0')}


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
        return [read_state(x).t for x in recorded(bag)[STATES]]

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


def test_what_comes_while_it_has_no_processor_is_kept_by_the_kernel(
        recorder: tuple[Probe, Path, child_process.Child, Publisher]) -> None:
    """As of a real robot, whose publisher sends nothing again: more than fits by default."""
    it, bag, child, publisher = recorder

    def begun() -> bool:
        publish(publisher, 0, 1)
        return size(bag) > EMPTY

    it.until(begun, 'the first state')
    child.signal(signal.SIGSTOP)
    it.until(lambda: state_of(child) == 'T', 'that it stops')
    publish(publisher, 1, 300)
    child.signal(signal.SIGCONT)
    reports = Diagnostics(it)

    def over() -> bool:
        publish(publisher, 301, 1)
        it.executor.spin_once(0.02)
        report = reports.latest.get('recorder')
        return report is not None and report.count('messages') + report.count('dropped') > 300

    it.until(over, 'that all is recorded or dropped')
    child.signal(signal.SIGINT)
    assert child.process.wait(PATIENCE) == 0
    found = [read_state(x).t for x in recorded(bag)[STATES]]
    assert [t for t in found if 0 < t < 301] == list(range(1, 301))


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

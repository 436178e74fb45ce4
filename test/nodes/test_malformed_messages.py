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

"""Messages that no honest node would send, from the only publisher and from a second one."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
import re
import time
from typing import Any

from bags import chunk, state
from ctc_chattering.analysis.result import simulate
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.configuration import parameter_file
from ctc_chattering.ros.messages import read_stamp
from ctc_chattering.ros.topics import CLOCK, COMMANDS, JOINT_STATES, REFERENCE
from faults import clock, Diagnostics, JOINTS, Kind, KINDS, malformed
import numpy as np
from processes import bringup, CONFIG, PATIENCE, Probe, probe
import pytest
from rclpy.serialization import deserialize_message
from recorded_runs import assert_equal
from sensor_msgs.msg import JointState

pytestmark = pytest.mark.ros
COUNT = 1000
#: Who reads a topic.
READERS = {JOINT_STATES: 'controller', COMMANDS: 'plant', REFERENCE: 'controller',
           CLOCK: 'reference'}
#: By what a topic's messages are refused when there is only one publisher.
REFUSALS = {
    JOINT_STATES: {'undecodable', 'joints', 'length', 'not_finite', 'stamp', 'repeated',
                   'backward', 'jump', 'stale', 'overflow'},
    COMMANDS: {'undecodable', 'joints', 'length', 'not_finite'},
    REFERENCE: {'undecodable', 'joints', 'length', 'not_finite', 'stamp', 'times'},
    CLOCK: {'undecodable'}}


def undecodable(kind: Kind, messages: list[bytes]) -> int:
    """Return how many are no messages at all."""
    count = 0
    for data in messages:
        try:
            read_stamp(data) if kind.topic == CLOCK else deserialize_message(data, kind.type)
        except Exception:
            count += 1
    return count


def is_huge(data: bytes) -> bool:
    """Return whether these are torques from which no motion can be computed: such a run ends."""
    try:
        values = deserialize_message(data, KINDS[COMMANDS].type).data
    except Exception:
        return False
    return any(math.isfinite(x) and abs(x) > 1e6 for x in values)


def reports_of_refusals(it: Probe, node: str, topic: str) -> list[float]:
    """Return when a node said that it refuses messages of a topic [s]."""
    head = re.compile(rf'\[{node}\] \[WARN\] \[([0-9.]+)\] .*: {topic}: refused: ')
    return [float(found[1]) for line in it.lines if (found := head.match(line))]


def send(it: Probe, publisher: Any, messages: list[bytes]) -> None:
    """Publish in batches that no queue drops."""
    for i, data in enumerate(messages):
        publisher.publish(data)
        if i % 50 == 49:
            it.executor.spin_once(timeout_sec=0.01)


#: What a node must have beside a topic to answer it.
BESIDE = {JOINT_STATES: (JOINT_STATES, REFERENCE), REFERENCE: (REFERENCE, JOINT_STATES)}


@pytest.mark.parametrize(('topic', 'pacing'), [
    (JOINT_STATES, ''), *(pytest.param(*x, marks=pytest.mark.slow) for x in (
        (REFERENCE, ''), (CLOCK, ''), (COMMANDS, 'lockstep'), (COMMANDS, 'real_time')))])
def test_a_node_alone_refuses_counts_and_runs_on(topic: str, pacing: str) -> None:
    kind, name = KINDS[topic], READERS[topic]
    # Each time that goes back or leaps has the reference publish its motion again.
    messages = [data for data in malformed(kind, COUNT // 5 if topic == CLOCK else COUNT)
                if topic != COMMANDS or not is_huge(data)]
    answer = {'plant': JOINT_STATES, 'controller': COMMANDS, 'reference': REFERENCE}[name]
    with probe() as it:
        diagnostics = Diagnostics(it)
        answers = it.listen(KINDS[answer].type, answer, raw=True)
        publisher = it.node.create_publisher(kind.type, topic, 1000)
        child = it.start(name, *(('-p', f'pacing:={pacing}') if pacing else ()))
        diagnostics.until(
            name, lambda r: r.values.get(f'{topic}: publishers') == '/probe', 'a connection')
        it.until(publisher.get_subscription_count, 'the reader')  # Each finds the other.
        send(it, publisher, messages)
        bad = undecodable(kind, messages)
        report = diagnostics.until(
            name, lambda r: r.refused(topic).get('undecodable') == bad, f'{bad} undecodable')
        refused = report.refused(topic)
        assert set(refused) <= REFUSALS[topic]
        assert sum(refused.values()) == report.count(f'{topic}: refused') < COUNT
        said = reports_of_refusals(it, name, topic)
        assert len(said) <= 2.0 + said[-1] - said[0]  # Once a second at the most.

        publishers = {x: publisher if x == topic else it.node.create_publisher(
            KINDS[x].type, x, 10) for x in BESIDE.get(topic, (topic,))}
        it.until(lambda: all(x.get_subscription_count() for x in publishers.values()), 'the node')
        answers.clear()
        count = itertools.count(1)

        def answered() -> bool:
            """Send good messages until one is answered."""
            good = {CLOCK: clock(next(count), 0), COMMANDS: kind.valid, JOINT_STATES: state(
                JOINTS, [[0.1, 0.2]] * 3, divmod(time.time_ns(), 10 ** 9)), REFERENCE: chunk(
                    JOINTS, [([[0.1, 0.2]] * 3, 0, 0)], (1, 0))}
            for x, on in publishers.items():
                on.publish(good[x])
            return bool(answers) if topic != COMMANDS else any(
                list(deserialize_message(x, JointState).effort) == [0.2, 0.1] for x in answers)

        it.until(answered, 'an answer')
        assert child.status is None
        assert not any('Traceback' in line for line in it.lines)


def test_a_second_publisher_of_everything_changes_nothing_in_lockstep(tmp_path: Path) -> None:
    """The run waits until it has left, equals the simulation, and the bag can be read."""
    bag, file = tmp_path / 'bag', tmp_path / 'params.yaml'
    file.write_text((CONFIG / 'friction.yaml').read_text().replace(
        'pacing: lockstep', 'pacing: lockstep\n    hold_at: 0.5'))
    messages = {topic: malformed(kind, COUNT // 5, 2) for topic, kind in KINDS.items()}
    # One that speaks of our joints from the first message on is no publisher of other joints.
    messages[JOINT_STATES].insert(0, state(JOINTS[:1], [[0.1]] * 3, (0, 0)))
    bad = {topic: undecodable(kind, messages[topic]) for topic, kind in KINDS.items()}
    with bringup('--params-file', str(file), '--duration', '0.8', '--record',
                 str(bag)) as process:
        it = Probe()
        try:
            diagnostics = Diagnostics(it)
            diagnostics.until('plant', lambda r: r.message.startswith('held'), 'the hold')
            publishers = {topic: it.node.create_publisher(kind.type, topic, 1000)
                          for topic, kind in KINDS.items()}
            for topic, node in READERS.items():
                said = f'{topic} has several publishers, none is obeyed: '
                diagnostics.until(
                    node, lambda r, said=said: said in r.message, 'contention')  # type: ignore
            assert it.set('plant', 'hold_at', 0.0).successful
            for topic, publisher in publishers.items():
                send(it, publisher, messages[topic])
            for topic, node in READERS.items():
                report = diagnostics.until(
                    node, lambda r, topic=topic:  # type: ignore[misc]
                    r.refused(topic).get('undecodable') == bad[topic], f'{bad[topic]} undecodable')
                assert report.refused(topic)['second_publisher'] > 40
            report = diagnostics.next('plant')
            assert float(report.values['time of the run [s]']) == 0.5
            for publisher in publishers.values():
                it.node.destroy_publisher(publisher)
            output, _ = process.communicate(timeout=PATIENCE)
        finally:
            it.close()
    assert process.returncode == 0, output
    assert 'Traceback' not in output
    run = read_bag(bag).run
    expected = simulate(parameter_file.load(file, {'plant': {'duration': 0.8}})).run
    assert_equal(run, expected, ['tau'])
    # Of the last torque there is no state that says that it was applied.
    assert np.array_equal(run.tau[:-1], expected.tau[:-1])

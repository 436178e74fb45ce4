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

from pathlib import Path
import time
from typing import Any

from bags import chunk, state
from controller_process import ControllerUnderTest
from ctc_chattering.analysis.result import simulate
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.topics import CLOCK, COMMANDS, JOINT_STATES, REFERENCE
from ctc_chattering.ros.messages import read_stamp
from faults import CONTESTED, Diagnostics, JOINTS, Kind, KINDS, malformed
import numpy as np
from processes import bringup, CONFIG, PATIENCE, Probe, probe
import pytest
from rclpy.serialization import deserialize_message
from recorded_runs import assert_equal

pytestmark = pytest.mark.ros
COUNT = 1000
#: Who reads a topic.
READERS = {JOINT_STATES: 'controller', COMMANDS: 'plant', REFERENCE: 'controller',
           CLOCK: 'reference'}
#: By what states are refused when there is only one publisher.
REFUSALS = {'undecodable', 'joints', 'length', 'not_finite', 'stamp', 'repeated', 'backward',
            'jump', 'stale', 'overflow'}


def undecodable(kind: Kind, messages: list[bytes]) -> int:
    """Return how many are no messages at all."""
    count = 0
    for data in messages:
        try:
            read_stamp(data) if kind.topic == CLOCK else deserialize_message(data, kind.type)
        except Exception:
            count += 1
    return count


def send(it: Probe, publisher: Any, messages: list[bytes]) -> None:
    """Publish in batches that no queue drops."""
    for i, data in enumerate(messages):
        publisher.publish(data)
        if i % 50 == 49:
            it.executor.spin_once(timeout_sec=0.01)


def test_a_controller_alone_refuses_counts_and_runs_on() -> None:
    """The states that do not fit are counted by what is wrong; the others are answered."""
    kind, topic = KINDS[JOINT_STATES], JOINT_STATES
    messages = malformed(kind, COUNT)
    bad = undecodable(kind, messages)
    with probe() as it:
        diagnostics, controller = Diagnostics(it), ControllerUnderTest(it, simulated=False)
        diagnostics.until('controller', lambda r: r.values.get(
            f'{topic}: publishers') == '/probe', 'a connection')
        send(it, controller.states, messages)
        report = diagnostics.until(
            'controller', lambda r: r.refused(topic).get('undecodable') == bad, f'{bad} bad ones')
        refused = report.refused(topic)
        assert set(refused) <= REFUSALS
        assert sum(refused.values()) == report.count(f'{topic}: refused') < COUNT

        def answered() -> bool:
            """Send good messages until one is answered."""
            now = divmod(time.time_ns(), 10 ** 9)
            controller.states.publish(state(JOINTS, [[0.1, 0.2]] * 3, now))
            controller.references.publish(chunk(JOINTS, [([[0.1, 0.2]] * 3, 0, 0)], now))
            return bool(controller.commands)

        it.until(answered, 'an answer')
        assert controller.child.status is None
        assert not any('Traceback' in line for line in it.lines)


@pytest.mark.slow
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
            diagnostics.until('plant', lambda r: 'is held at' in r.message, 'the hold')
            publishers = {topic: it.node.create_publisher(kind.type, topic, 1000)
                          for topic, kind in KINDS.items()}
            for topic, node in READERS.items():
                said = f'{topic} {CONTESTED}: '
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
    assert_equal(run, expected, ['tau', 'v'])
    # Which torque answers a state is known where the controller publishes it: every tenth stamp.
    for found, wanted in ((run.tau, expected.tau), (run.v, expected.v)):
        known = np.isfinite(found).all(axis=1)
        assert known.sum() > 70 and np.array_equal(found[known], wanted[known])

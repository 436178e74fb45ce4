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

"""What a graph recorded, and `ctc replay` of it on a real graph."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
import signal
import subprocess
import sys
from typing import Any

from ctc_chattering import replay
from ctc_chattering.analysis.result import simulate
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.compilation import compile_setups
from ctc_chattering.ros.messages import read_stamp
from ctc_chattering.ros.process import STOP
from ctc_chattering.ros.subscription import with_info
from domains import own_domain
from made_once import made_once
from mcap.writer import Writer
from motion_bags import made, serialized, STORE, string, write
from processes import CONFIG, PATIENCE, probe, run_bringup, Stopwatch
import pytest
import rclpy
from recorded_runs import assert_equal, counts, metadata, reports_of
from rosbags.typesys import get_types_from_msg
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

pytestmark = pytest.mark.ros
SETUP = parameter_file.load(CONFIG / 'friction.yaml', {'plant': {'duration': 0.5}})


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_once(tmp_path_factory, 'half_a_second', record)


def record(path: Path) -> None:
    compile_setups([SETUP], print)
    status, output = run_bringup('--params-file', str(CONFIG / 'friction.yaml'), '--duration',
                                 '0.5', '--record', str(path), '--ros-args', '-p',
                                 'state_decimation:=1')
    assert status == 0, output
    assert 'were dropped' not in output


def test_half_a_second_at_1_khz_holds_every_sample_and_equals_the_simulation(bag: Path) -> None:
    """Both are computed by machine code."""
    assert_equal(read_bag(bag).run, simulate(SETUP).run)
    found = counts(bag)
    with closing(open_bag(bag)) as reader:
        stamps = [read_stamp(data) for connection, _, data in reader.messages()
                  if connection.topic == '/joint_states']
    # A state whose answer took long is sent again, and so is the answer.
    assert stamps == sorted(stamps) and sorted(set(stamps)) == [10 ** 6 * k for k in range(501)]
    assert len(stamps) == found['/joint_states']
    assert found['/effort_controller/commands'] >= 501
    assert found['/clock'] >= 51
    for topic in ('tracking', 'filter', 'torques'):
        assert found[f'/controller/{topic}'] == 501
    assert metadata(bag)['custom_data'] == {'dropped': '{}'}
    said = reports_of(bag, 'recorder')
    assert said and {report['dropped'] for report in said} == {'0'}
    for node in ('plant', 'controller'):
        assert reports_of(bag, node)[-1]['computed by'] == 'machine code'


def test_everything_comes_again_with_its_own_timing(bag: Path) -> None:
    rate = 1.0
    # A state whose answer took long was sent again, and so was the answer.
    with closing(open_bag(bag)) as reader:
        recorded_states, recorded_commands = ([
            bytes(data) for _, _, data in reader.messages(reader.named(topic))]
            for topic in ('/joint_states', '/effort_controller/commands'))
    with probe() as it:
        states = it.listen(JointState, 'joint_states', 10_000, raw=True)
        commands = it.listen(Float64MultiArray, 'effort_controller/commands', 10_000, raw=True)
        clocks = it.listen(Clock, '/clock')
        sent: list[int] = []

        def note(message: Any, info: Any = None) -> None:
            sent.append((info or message[1])['source_timestamp'])

        it.node.create_subscription(JointState, 'joint_states', with_info(note), 10_000)
        process = subprocess.Popen(
            [sys.executable, '-m', 'ctc_chattering.cli.ctc', 'replay', str(bag), '--rate',
             str(rate), '--delay', '3'], text=True, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT)
        try:
            watch = Stopwatch(process.pid)
            it.until(lambda: process.poll() is not None
                     or len(states) + len(commands)
                     == len(recorded_states + recorded_commands), 'all messages')
            waited = watch.waited()
            it.until(lambda: len(states) == len(sent) == len(recorded_states)
                     and len(commands) == len(recorded_commands)
                     and clocks and clocks[-1].clock.nanosec == 500_000_000, 'the last messages')
            output, _ = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
        assert process.returncode == 0, output
        took = 1e-9 * (sent[-1] - sent[0])
        assert 0.3 / rate < took < 0.6 / rate + 0.5 + waited  # Shorter if the first one was late.
        assert states == recorded_states
        assert commands == recorded_commands


def test_topics_whose_types_are_not_installed_are_named_and_passed_over(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As in many a bag of `ros2 bag record -a`; nodes and signals of a script are as before."""
    topics = {'/thing': 'my_msgs/msg/Thing', '/other': 'my_msgs/msg/Other'}
    for kind in topics.values():
        STORE.register(get_types_from_msg('string data', kind))
    bag = write(tmp_path / 'bag', [('/news', 1, string('')), *(
        (topic, 1, made(kind, data='')) for topic, kind in topics.items())])
    handlers = [signal.getsignal(x) for x in STOP]
    with own_domain():
        context = rclpy.Context()
        rclpy.init(context=context)
        try:
            assert replay(str(bag), rate=10.0, delay=0.0) == 1
            assert context.ok()
        finally:
            context.try_shutdown()
    assert [signal.getsignal(x) for x in STOP] == handlers
    assert capsys.readouterr().err.splitlines() == [
        f'{topic} ({topics[topic]}) is not replayed, because its message type is not installed'
        for topic in topics]


def test_messages_of_other_encodings_and_types_of_a_topic_are_not_published(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / 'file.mcap'
    with file.open('wb') as stream:
        writer: Any = Writer(stream)
        writer.start('ros2')
        news, number = serialized(string('hi')), b'\0\1\0\0' + bytes(8)
        for topic, encoding, schema, data in (
                ('/news', 'cdr', ('std_msgs/msg/String', 'ros2msg', b'string data'), news),
                ('/news', 'cdr', ('std_msgs/msg/Float64', 'ros2msg', b'float64 data'), number),
                ('/news', 'json', ('std_msgs/msg/String', 'jsonschema', b'{}'), b'{}'),
                ('/raw', 'json', None, b'{}')):
            channel = writer.register_channel(
                topic, encoding, writer.register_schema(*schema) if schema else 0)
            writer.add_message(channel, 1, data, 1)
        writer.finish()
    with probe() as it:
        heard = it.listen(String, 'news', 10)
        assert replay(file, rate=10.0, delay=1.0) == 1
        it.until(lambda: heard, 'the message')
    assert [x.data for x in heard] == ['hi']
    assert capsys.readouterr().err.splitlines() == [
        '/news (std_msgs/msg/Float64) is not replayed, because the topic also has messages of '
        'another type',
        '/news (std_msgs/msg/String) is not replayed, because its messages are json, not of ROS 2',
        '/raw () is not replayed, because its messages are json, not of ROS 2']

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

"""Files that are no pure ROS 2 bag: other encodings beside ours, other profiles, other endings."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
import shlex
import subprocess
import sys
from typing import Any

from bags import entries, write_bag
from ctc_chattering.analysis.result import simulate
from ctc_chattering.bags.bag_files import UnsupportedBag
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.bags.repair import open_bag, repair
from ctc_chattering.cli.ctc import main
from ctc_chattering.configuration import parameter_file
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.bag_motion import read_motion
from identified_robots import record
from mcap.reader import make_reader
from mcap.writer import Writer
import numpy as np
import pytest
from recorded_runs import assert_equal
from rosbags.rosbag1 import Writer as WriterOfRos1
from rosbags.typesys import get_typestore, Stores
import zstandard

SETUP = parameter_file.load(None, {
    'plant': {'duration': 0.2, 'experiment': 'trial'}, 'controller': {'law': 'compensation'}})
RESULT = simulate(SETUP)
#: Topic, encoding, and schema by name, encoding and data, of what other programs log.
OTHERS = (('/camera', 'protobuf', ('foxglove.Image', 'protobuf', b'\x0a\x03abc')),
          ('/notes', 'json', ('Note', 'jsonschema', b'{"type": "object"}')),
          ('/joint_states', 'json', ('sensor_msgs/msg/JointState', 'jsonschema', b'{}')),
          ('/raw', 'json', None))
#: What their messages have, the last of them as zstd begins.
OTHER_DATA = (b'\x08\x96\x01', b'{"a": 1}', b'', b'\x28\xb5\x2f\xfd?')


def copy(path: Path, others: bool = False, profile: str = 'ros2',
         schema_of: Callable[[Any], Any] = lambda schema: schema) -> Path:
    """Write the run as another program writes MCAP, in several chunks."""
    write_bag(path / 'source', entries(RESULT, SETUP.plant))
    numbers: dict[str, int] = {}
    target = path / 'file.mcap'
    with (path / 'source' / 'source_0.mcap').open('rb') as source, target.open('wb') as stream:
        writer: Any = Writer(stream, chunk_size=4000)
        writer.start(profile)
        more = [writer.register_channel(topic, encoding, (
            writer.register_schema(*schema) if schema else 0), {'mine': topic})
            for topic, encoding, schema in OTHERS if others]
        for k, (schema, channel, message) in enumerate(make_reader(source).iter_messages()):
            if channel.topic not in numbers:
                numbers[channel.topic] = writer.register_channel(
                    channel.topic, 'cdr', writer.register_schema(*schema_of(schema)),
                    channel.metadata)
            writer.add_message(numbers[channel.topic], message.log_time, message.data,
                               message.publish_time)
            for number in more:
                writer.add_message(number, message.log_time, OTHER_DATA[k % 4],
                                   message.log_time + 7, k)
        writer.finish()
    return target


def record_of(schema: Any) -> tuple[str, str, bytes]:
    return schema.name, schema.encoding, schema.data


def rows_of_others(file: Path) -> list[tuple[object, ...]]:
    """Return all that a file has of messages that are not ours."""
    with file.open('rb') as stream:
        return [(channel.topic, channel.message_encoding, channel.metadata,
                 schema and record_of(schema), message.log_time, message.publish_time,
                 message.sequence, message.data)
                for schema, channel, message in make_reader(stream).iter_messages()
                if channel.message_encoding != 'cdr']


@pytest.mark.parametrize('profile', ['ros2', '', 'foxglove'])
def test_protobuf_and_json_beside_our_topics(tmp_path: Path, profile: str) -> None:
    file = copy(tmp_path, True, profile, record_of)
    assert_equal(read_bag(file).run, RESULT.run)
    with closing(open_bag(file)) as bag:
        with pytest.raises(CtcError, match=r"/camera are of format 'protobuf'; allowed: cdr"):
            list(bag.read(bag.named('/camera')))
        found = [data for x, _, data in bag.messages() if x.topic == '/raw']
    assert found[:4] == list(OTHER_DATA)


def test_repair_keeps_other_encodings_to_the_byte(tmp_path: Path) -> None:
    file = copy(tmp_path, True, '', record_of)
    whole = rows_of_others(file)
    data = file.read_bytes()
    file.write_bytes(data[:len(data) // 2])
    assert repair(file) is not None
    found = rows_of_others(file)
    assert 0.3 * len(whole) < len(found) < 0.9 * len(whole)
    assert found == whole[:len(found)]
    q = read_bag(file).run.q
    np.testing.assert_array_equal(q, RESULT.run.q[:len(q)])


@pytest.mark.parametrize('encoding', ['ros2msg', 'ros2idl', 'unknown', ''])
def test_definitions_that_are_empty_or_no_definitions(tmp_path: Path, encoding: str) -> None:
    """What a type is that ROS 2 brings along is known without them."""
    for name, text in (('empty', b''), ('comment', b'# nothing'), ('wrong', b'\xff\xfe')):
        folder = tmp_path / name
        folder.mkdir()
        file = copy(folder, schema_of=lambda schema: (schema.name, encoding, text))
        assert_equal(read_bag(file).run, RESULT.run)


def test_a_file_packed_by_zstd(tmp_path: Path) -> None:
    packed = tmp_path / 'packed' / 'file.mcap.zstd'
    packed.parent.mkdir()
    packed.write_bytes(zstandard.ZstdCompressor().compress(
        copy(tmp_path, schema_of=record_of).read_bytes()))
    for path in (packed, packed.parent):
        assert_equal(read_bag(path).run, RESULT.run)
        assert repair(path) is None
    packed.write_bytes(packed.read_bytes()[:-500])
    with pytest.raises(CtcError, match=r'file\.mcap\.zstd: damaged, or not a bag: .*[^"]$'):
        repair(packed)


def bag_of_ros_1(file: Path) -> Path:
    """Write joint states and efforts of ROS 1."""
    store = get_typestore(Stores.ROS1_NOETIC)
    motion = record('two_link', 1, 0.5).recording
    assert motion.command is not None
    with WriterOfRos1(file) as writer:
        connection = writer.add_connection(
            '/joint_states', 'sensor_msgs/msg/JointState', typestore=store)
        for k, (t, q, effort) in enumerate(zip(motion.t, motion.q, motion.command)):
            at = 10 ** 9 + round(1e9 * t)
            head = store.types['std_msgs/msg/Header'](k, store.types[
                'builtin_interfaces/msg/Time'](at // 10 ** 9, at % 10 ** 9), '')
            message = store.types[connection.msgtype](
                head, list(motion.joints), q, np.zeros(0), effort)
            writer.write(connection, at, store.serialize_ros1(message, connection.msgtype))
    return file


def test_a_bag_of_ros_1_is_read_after_the_command_that_the_refusal_names(tmp_path: Path) -> None:
    file = bag_of_ros_1(tmp_path / 'old run.bag')
    for path in (file, tmp_path):
        with pytest.raises(UnsupportedBag, match='a bag of ROS 1') as error:
            read_motion(path)
        with pytest.raises(UnsupportedBag, match='a bag of ROS 1'):
            repair(path)
    _, _, command = str(error.value).partition('convert it: ')
    program, *arguments = shlex.split(command)
    assert program == 'rosbags-convert'
    subprocess.run([Path(sys.executable).with_name(program), *arguments], check=True)
    motion = record('two_link', 1, 0.5).recording
    found = read_motion(tmp_path / 'old run_ros2').recording
    assert found.q == pytest.approx(motion.q)
    assert found.effort == pytest.approx(motion.command)


def test_a_state_that_is_no_cdr_is_refused_by_its_format(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / 'file.mcap'
    with file.open('wb') as stream:
        writer: Any = Writer(stream)
        writer.start()
        channel = writer.register_channel('/joint_states', 'json', writer.register_schema(
            'sensor_msgs/msg/JointState', 'jsonschema', b'{}'))
        writer.add_message(channel, 1, b'{"position": [1.0]}', 1)
        writer.finish()
    assert main(['identify', str(file)]) == 1
    assert "messages on /joint_states are of format 'json'; allowed: cdr" in (
        capsys.readouterr().err)

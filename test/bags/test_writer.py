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

"""Bags as the mcap library reads them, their metadata, log times, and messages that are lost."""

from __future__ import annotations

from collections import Counter
from contextlib import closing
import errno
from pathlib import Path
import random
import resource
import threading
import time
import tracemalloc
from unittest.mock import Mock

from bags import entries, Entry, write_bag
from ctc_chattering.analysis.result import simulate
from ctc_chattering.bags.repair import open_bag, recover, repair
from ctc_chattering.bags.writer import BagWriter, offered_qos
from ctc_chattering.configuration import parameter_file
from ctc_chattering.errors import CtcError
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import breakup_chunk, StreamReader
from motion_bags import serialized
import pytest
from recorded_runs import metadata

SETUP = parameter_file.load(None, {'plant': {'duration': 0.2}, 'bringup': {
    'events': ['0.1 controller law compensation']}})
COUNTS = {'/joint_states': 201, '/effort_controller/commands': 201, '/reference': 9,
          '/plant/parameters': 1, '/controller/parameters': 2}
SEQUENCES = {'/joint_states': 'sensor_msgs/msg/JointState', '/reference':
             'trajectory_msgs/msg/JointTrajectory'}


@pytest.fixture(scope='module')
def messages() -> list[Entry]:
    return entries(simulate(SETUP), SETUP.plant)


@pytest.fixture(scope='module')
def bag(messages: list[Entry], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('bags') / 'below' / 'run'
    assert write_bag(path, messages) == COUNTS
    return path


def test_mcap_reads_every_message(bag: Path, messages: list[Entry]) -> None:
    """
    Check topics, counts, log times and bytes, in the order in which they were written.

    Each chunk has a checksum, and the message definitions are there with those they are made of.
    """
    (file,) = bag.glob('*.mcap')
    with file.open('rb') as stream:
        read = [(channel.topic, schema and schema.name, message.log_time, message.data)
                for schema, channel, message in make_reader(stream).iter_messages(
                    log_time_order=False)]
        stream.seek(0)
        summary = make_reader(stream).get_summary()
        stream.seek(0)
        chunks = [record for record in StreamReader(stream, emit_chunks=True).records
                  if isinstance(record, Chunk)]
    assert Counter(topic for topic, *_ in read) == COUNTS
    assert read == [(topic, message.__msgtype__, t, serialized(message))
                    for topic, t, message in messages]
    for chunk in chunks:
        assert chunk.uncompressed_crc != 0
        assert breakup_chunk(chunk, validate_crc=True)
    assert summary is not None and summary.statistics is not None
    assert summary.statistics.message_count == sum(COUNTS.values())
    assert summary.statistics.message_end_time == 200_000_000
    assert {x.compression for x in summary.chunk_indexes} == {'zstd'}
    schemas = {x.name: x for x in summary.schemas.values()}
    assert len(schemas) == 4
    assert {x.encoding for x in schemas.values()} == {'ros2msg'}
    text = schemas['trajectory_msgs/msg/JointTrajectory'].data.decode()
    for part in ('JointTrajectoryPoint[] points', 'MSG: std_msgs/Header',
                 'MSG: builtin_interfaces/Duration', 'float64[] accelerations'):
        assert part in text
    assert {x.message_encoding for x in summary.channels.values()} == {'cdr'}


def test_metadata(bag: Path) -> None:
    """Check what `ros2 bag info` and `play` read: counts, types, duration, QoS."""
    info = metadata(bag)
    assert (info['version'], info['storage_identifier']) == (9, 'mcap')
    assert info['message_count'] == sum(COUNTS.values())
    assert info['duration']['nanoseconds'] in (200_000_000, 200_000_001)
    assert info['relative_file_paths'] == [x.name for x in bag.glob('*.mcap')]
    topics = {x['topic_metadata']['name']: x for x in info['topics_with_message_count']}
    assert {name: x['message_count'] for name, x in topics.items()} == COUNTS
    for name, topic in topics.items():
        (qos,) = topic['topic_metadata']['offered_qos_profiles']
        assert (qos['reliability'], qos['history'], qos['depth']) == ('reliable', 'keep_last', 100)
        assert qos['durability'] == (
            'transient_local' if name.endswith('/parameters') else 'volatile')
        assert topic['topic_metadata']['serialization_format'] == 'cdr'
    for name, kind in SEQUENCES.items():
        assert topics[name]['topic_metadata']['type'] == kind


@pytest.mark.parametrize('limit', [8, *random.Random(1).sample(range(40_000), 12)])
def test_a_disk_that_is_full_at_any_moment(
        limit: int, messages: list[Entry], tmp_path: Path) -> None:
    """
    Check that what was flushed before the error is kept.

    A limit on the size of files simulates the full disk.
    """
    recording, found, flushed = BagWriter(tmp_path / 'bag'), 0, 0
    data = [(topic, message.__msgtype__, t, serialized(message), '')
            for topic, t, message in messages]
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
    try:
        for i, message in enumerate(data, 1):
            recording.write(*message)
            if i % 20 == 0:
                recording.flush()
                flushed = i
        recording.close()
    except OSError as error:
        found = error.errno or 0
        recording.abandon()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert found == errno.EFBIG * (not (tmp_path / 'bag' / 'metadata.yaml').exists())
    assert {x.name for x in (tmp_path / 'bag').iterdir()} <= {'bag_0.mcap', 'metadata.yaml'}
    if found and not flushed:
        return
    assert flushed <= recover(tmp_path / 'bag/bag_0.mcap', tmp_path / 'new.mcap') <= len(messages)


def test_empty_bag_is_a_bag(tmp_path: Path) -> None:
    BagWriter(tmp_path / 'bag').close()
    with closing(open_bag(tmp_path / 'bag')) as reader:
        assert list(reader.messages()) == []
    assert metadata(tmp_path / 'bag')['message_count'] == 0


@pytest.mark.parametrize('below', ['', 'file', 'file/bag'])
def test_impossible_place(tmp_path: Path, below: str) -> None:
    """Check that nothing is overwritten, and the error."""
    (tmp_path / 'file').write_text('mine')
    with pytest.raises(CtcError) as error:
        BagWriter(tmp_path / below)
    assert str(tmp_path / below) in str(error.value)
    assert len(str(error.value).splitlines()) == 1
    assert (tmp_path / 'file').read_text() == 'mine'


#: A serialized String.
NEWS = b'\0\1\0\0\1\0\0\0\0'


def test_a_long_recording_has_several_files(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """
    Check 479 flushes, one every 15 s: a file has 40 of them. They cost no memory.

    QoS is that of the first message. Files without an end are recovered.
    """
    sizes, t, bag = [], 0, tmp_path / 'bag'
    monkeypatch.setattr('time.monotonic', lambda: 15.0 * t)
    recording = BagWriter(bag)
    tracemalloc.start()
    for t in range(1, 480):
        recording.write('/news', 'std_msgs/msg/String', t, NEWS, offered_qos(2 + t, False))
        recording.flush()
        if t % 160 == 20:
            sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    monkeypatch.undo()
    recording.close()
    assert sizes[2] - sizes[1] < 50 * 160  # The index of a chunk has 100 bytes or more.
    info = metadata(bag)
    names = [f'bag_{i}.mcap' for i in range(12)]
    assert info['relative_file_paths'] == names
    assert [(x['path'], x['message_count'], x['starting_time']['nanoseconds_since_epoch'])
            for x in info['files']] == list(zip(names, [*[40] * 11, 39], range(1, 480, 40)))
    assert (info['message_count'], info['duration']['nanoseconds']) == (479, 478)
    (topic,) = info['topics_with_message_count']
    assert topic['topic_metadata']['offered_qos_profiles'][0]['depth'] == 3
    with closing(open_bag(bag)) as reader:
        assert [t for _, t, _ in reader.messages()] == list(range(1, 480))
    (bag / 'metadata.yaml').unlink()
    file = bag / 'bag_11.mcap'
    file.write_bytes(file.read_bytes()[:file.stat().st_size // 4])
    assert repair(bag) is not None
    with closing(open_bag(bag)) as reader:
        found = [t for _, t, _ in reader.messages()]
    assert 441 < len(found) < 479
    assert found == list(range(1, len(found) + 1))


def flushed(recording: BagWriter, count: int) -> None:
    """Write messages, with a flush after each."""
    for t in range(count):
        recording.write('/news', 'std_msgs/msg/String', t, NEWS, '')
        recording.flush()


def test_a_slow_disk_holds_nothing_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Check that what was flushed can be read while fsync is still at work."""
    go = threading.Event()
    sync = Mock(side_effect=lambda _: go.wait(60.0))
    monkeypatch.setattr('os.fsync', sync)
    recording = BagWriter(tmp_path / 'bag')
    flushed(recording, 3)
    assert recover(tmp_path / 'bag/bag_0.mcap', tmp_path / 'new.mcap') == 3
    sync.assert_called_once()
    go.set()
    recording.close()
    assert metadata(tmp_path / 'bag')['message_count'] == 3


def test_an_error_of_the_disk_is_reported(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('os.fsync', Mock(side_effect=OSError(errno.EIO, 'Input/output error')))
    recording = BagWriter(tmp_path / 'closed')
    flushed(recording, 1)
    with pytest.raises(OSError, match='Input/output error'):
        recording.close()
    recording.abandon()
    recording = BagWriter(tmp_path / 'flushed')
    end = time.monotonic() + 60.0
    with pytest.raises(OSError, match='Input/output error'):
        while time.monotonic() < end:
            flushed(recording, 1)
    recording.abandon()
    assert recover(tmp_path / 'flushed/flushed_0.mcap', tmp_path / 'new.mcap') > 0

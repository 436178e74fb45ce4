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

"""Bags that are truncated or have wrong bytes, and what is recovered of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
import os
from pathlib import Path
import random
import re
import resource
import shutil
import signal
import struct
import time
from typing import Any

from bags import entries, write_bag
from ctc_chattering.analysis.result import simulate
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.bags.repair import open_bag, recover, repair
from ctc_chattering.bags.writer import BagWriter, offered_qos
from ctc_chattering.cli.ctc import main
from ctc_chattering.configuration import parameter_file
from ctc_chattering.errors import CtcError
from faults import nodes_of
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import Writer as McapWriter
import numpy as np
from processes import bringup, CONFIG, PATIENCE, run_bringup, Stopwatch, wait_for
import pytest
from rosbags.rosbag2 import Writer
from rosbags.typesys import get_typestore, Stores
import yaml


def is_whole(bag: Path) -> bool:
    try:
        open_bag(bag).close()
    except CtcError:
        return False
    return True


def messages(bag: Path) -> list[tuple[str, int, bytes]]:
    with closing(open_bag(bag)) as reader:
        return [(connection.topic, t, bytes(data)) for connection, t, data in reader.messages()]


@pytest.fixture(scope='module')
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag of many chunks."""
    source = tmp_path_factory.mktemp('source') / 'bag'
    setup = parameter_file.load(CONFIG / 'friction.yaml', {'plant': {'duration': 0.3}})
    write_bag(source, entries(simulate(setup), setup.plant))
    target = tmp_path_factory.mktemp('whole') / 'bag'
    recording = BagWriter(target)
    with closing(open_bag(source)) as reader:
        for i, (connection, t, data) in enumerate(reader.messages()):
            recording.write(connection.topic, connection.msgtype, t, bytes(data),
                            offered_qos(100, False))
            if i % 40 == 39:
                recording.flush()
    recording.close()
    return target


def cut(whole: Path, target: Path, size: int) -> Path:
    """Copy the first `size` bytes of a bag, without metadata, as a killed recorder leaves it."""
    target.mkdir()
    data = (whole / f'{whole.name}_0.mcap').read_bytes()
    (target / f'{whole.name}_0.mcap').write_bytes(data[:size])
    return target


def test_a_repaired_bag_is_read_by_the_mcap_library_and_has_the_run(
        whole: Path, tmp_path: Path) -> None:
    size = (whole / f'{whole.name}_0.mcap').stat().st_size
    bag = cut(whole, tmp_path / 'bag', size * 3 // 4)
    with pytest.raises(CtcError, match=f'metadata.yaml.*; "ctc repair {bag}" recovers the rest$'):
        read_bag(bag)
    done = repair(bag)
    assert done is not None
    count, aside = done
    assert aside == tmp_path / 'bag.damaged' and aside.exists()
    found = messages(bag)
    assert found == messages(whole)[:count] and count > 0
    with (bag / 'bag_0.mcap').open('rb') as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None and summary.statistics is not None
    assert summary.statistics.message_count == count
    run, complete = read_bag(bag).run, read_bag(whole).run
    n = len(run.t)
    assert 0 < n < len(complete.t)
    assert np.array_equal(run.q, complete.q[:n])
    assert np.array_equal(run.tau[:-1], complete.tau[:n - 1])


@pytest.mark.parametrize('size', [0, 4, 8, 30])
def test_a_bag_without_a_readable_message_is_refused(
        whole: Path, tmp_path: Path, size: int) -> None:
    bag = cut(whole, tmp_path / 'bag', size)
    with pytest.raises(CtcError, match='no message in a whole chunk'):
        repair(bag)
    assert [path.name for path in tmp_path.iterdir()] == ['bag']


def test_what_is_no_bag_cannot_be_repaired(whole: Path, tmp_path: Path) -> None:
    with pytest.raises(CtcError, match='no such bag'):
        repair(tmp_path / 'bag')
    (tmp_path / 'bag').mkdir()
    with pytest.raises(CtcError, match=r'not a bag: .*metadata\.yaml'):
        repair(tmp_path / 'bag')
    shutil.copytree(whole, tmp_path / 'good')
    (tmp_path / 'good' / 'metadata.yaml').unlink()
    (tmp_path / 'good.damaged').mkdir()
    with pytest.raises(CtcError, match='exists already'):
        repair(tmp_path / 'good')


def test_a_whole_bag_is_left_as_it_is(
        whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Check this after a repair, and with a bag of another writer, too."""
    bag = tmp_path / 'bag'
    shutil.copytree(whole, bag)
    before = {path.name: (path.stat().st_ino, path.read_bytes()) for path in bag.iterdir()}
    assert main(['repair', str(bag)]) == 0
    assert capsys.readouterr().out == f'{bag}: nothing to repair\n'
    assert {path.name: (path.stat().st_ino, path.read_bytes())
            for path in bag.iterdir()} == before
    (bag / 'metadata.yaml').unlink()
    assert repair(bag) is not None
    assert repair(bag) is None
    assert sorted(path.name for path in tmp_path.iterdir()) == ['bag', 'bag.damaged']
    with Writer(tmp_path / 'theirs', version=8) as writer:
        connection = writer.add_connection(
            '/news', 'std_msgs/msg/String', typestore=get_typestore(Stores.ROS2_JAZZY))
        writer.write(connection, 1, b'\0\1\0\0\1\0\0\0\0')
    assert repair(tmp_path / 'theirs') is None


def wrong_bytes(file: Path, places: Sequence[int], dice: random.Random) -> Iterator[int]:
    """Change one byte of a file at a time; restore it at the end."""
    data = file.read_bytes()
    for place in places:
        wrong = bytes([data[place] ^ dice.randint(1, 255)])
        file.write_bytes(data[:place] + wrong + data[place + 1:])
        yield place
    file.write_bytes(data)


@pytest.mark.parametrize('name, count, least', [('bag_0.mcap', 30, 10), ('metadata.yaml', 30, 4)])
def test_a_bag_with_a_wrong_byte_is_not_whole_or_holds_the_same(
        whole: Path, tmp_path: Path, name: str, count: int, least: int) -> None:
    bag, complete = tmp_path / 'bag', messages(whole)
    shutil.copytree(whole, bag)
    dice = random.Random(1)
    places = dice.sample(range((bag / name).stat().st_size), count)
    found = 0
    for _ in wrong_bytes(bag / name, places, dice):
        if is_whole(bag):
            assert messages(bag) == complete
        else:
            found += 1
    assert found > least  # What stands twice does no harm where it is wrong once.
    assert is_whole(bag)


def test_a_wrong_byte_in_a_chunk_is_found_and_costs_no_other(whole: Path, tmp_path: Path) -> None:
    """Check chunks without definitions of topics, which the first one has."""
    bag, complete = tmp_path / 'bag', messages(whole)
    shutil.copytree(whole, bag)
    file, dice = bag / 'bag_0.mcap', random.Random(2)
    with file.open('rb') as stream:
        chunks = [(stream.tell(), len(record.data))
                  for record in StreamReader(stream, emit_chunks=True).records
                  if isinstance(record, Chunk) and record.message_end_time][1:]
    # Not in the first bytes of the compressed data, of which not every bit has a meaning.
    places = [dice.randrange(end - length + 20, end) for end, length in chunks]
    for _ in wrong_bytes(file, places[::2], dice):
        assert not is_whole(bag)
    assert is_whole(bag)
    next(wrong_bytes(file, places[5:], dice))
    error = f'^{bag}: damaged, .*; "ctc repair {bag}" recovers the rest$'
    with pytest.raises(CtcError, match=error):
        read_bag(bag)
    done = repair(bag)
    assert done is not None
    assert messages(bag) == complete[:240] + complete[280:]


def test_a_wrong_topic_in_the_index_is_found(whole: Path, tmp_path: Path) -> None:
    """Check a byte because of which a reader of one topic would skip the chunk."""
    bag = tmp_path / 'bag'
    shutil.copytree(whole, bag)
    file = bag / 'bag_0.mcap'
    with file.open('rb') as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    channel, offset = next(iter(summary.chunk_indexes[3].message_index_offsets.items()))
    place = file.read_bytes().rindex(struct.pack('<HQ', channel, offset))
    next(wrong_bytes(file, [place], random.Random(1)))
    with pytest.raises(CtcError, match=r'damaged, .*: the index has a wrong checksum'):
        read_bag(bag)
    done = repair(bag)
    assert done is not None
    assert messages(bag) == messages(whole)


def test_types_and_qos_of_other_recorders_are_recovered(tmp_path: Path) -> None:
    """Check a type that is not installed, and policies as numbers, as in bags of ROS 2 Humble."""
    (tmp_path / 'bag').mkdir()
    forever = {'sec': 1, 'nsec': 2}
    profile = {'history': 1, 'depth': 5, 'reliability': 2, 'durability': 1, 'deadline': forever,
               'lifespan': forever, 'liveliness': 1, 'liveliness_lease_duration': forever,
               'avoid_ros_namespace_conventions': False}
    with (tmp_path / 'bag' / 'bag_0.mcap').open('wb') as stream:
        writer: Any = McapWriter(stream)
        writer.start('ros2')
        schema = writer.register_schema('my_msgs/msg/Thing', 'ros2msg', b'float64 x')
        service = writer.register_schema('std_srvs/srv/Trigger_Event', 'unknown', b'what it is')
        for topic, text, kind in (('/a', yaml.safe_dump([profile]), schema), (
                '/b', 'a: [', schema), ('/c', '', service)):
            channel = writer.register_channel(topic, 'cdr', kind, {'offered_qos_profiles': text})
            writer.add_message(channel, 7, b'\0\1\0\0' + bytes(8), 7)
        writer.flush()
    assert recover(tmp_path / 'bag', tmp_path / 'whole') == 3
    assert is_whole(tmp_path / 'whole')
    with (tmp_path / 'whole' / 'whole_0.mcap').open('rb') as stream:
        rows = [(channel.topic, schema and (schema.name, schema.data), message.data)
                for schema, channel, message in make_reader(stream).iter_messages()]
    thing = 'my_msgs/msg/Thing', b'float64 x'
    assert rows == [(topic, kind, b'\0\1\0\0' + bytes(8)) for topic, kind in (
        ('/a', thing), ('/b', thing), ('/c', ('std_srvs/srv/Trigger_Event', b'')))]
    text = (tmp_path / 'whole' / 'metadata.yaml').read_text(encoding='utf-8')
    topics = [x['topic_metadata'] for x in yaml.safe_load(text)['rosbag2_bagfile_information'][
        'topics_with_message_count']]
    assert [x['offered_qos_profiles'] for x in topics[1:]] == [[], []]
    (found,) = topics[0]['offered_qos_profiles']
    assert found == {**profile, 'history': 'keep_last', 'reliability': 'best_effort',
                     'durability': 'transient_local', 'liveliness': 'automatic'}


@pytest.mark.ros
def test_a_killed_recorder_leaves_all_but_the_last_second(tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    with bringup('--params-file', str(CONFIG / 'friction.yaml'), '--pacing', 'real_time',
                 '--duration', '0', '--record', str(bag)) as process:
        wait_for(lambda: (bag / 'bag_0.mcap').exists()
                 and (bag / 'bag_0.mcap').stat().st_size > 100_000, 'a part of the bag')
        nodes = nodes_of(process.pid)
        watch = Stopwatch(*nodes.values())
        wait_for(lambda: (bag / 'bag_0.mcap').stat().st_size > 300_000, 'more of it')
        waited = watch.waited()
        os.kill(nodes['recorder'], signal.SIGKILL)
        killed = time.time()
        process.communicate(timeout=PATIENCE)
    done = repair(bag)
    assert done is not None
    with closing(open_bag(bag)) as reader:
        assert reader.end_time / 1e9 > killed - 1.0 - waited
    assert read_bag(bag).run.t[-1] > 1.0


@pytest.mark.ros
def test_a_full_disk_ends_the_recording_and_not_the_run(tmp_path: Path) -> None:
    """Check with a limit on the size of files instead of a full disk."""
    bag = tmp_path / 'bag'
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, hard))
    try:
        status, output = run_bringup('--params-file', str(CONFIG / 'friction.yaml'), '--record',
                                     str(bag), '--duration', '1.5')
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert 'the experiment has ended at t = 1.5 s after 1501 samples' in output
    assert re.search(r'recording has stopped: File too large', output)
    assert status == 1
    assert 'Traceback' not in output
    assert repair(bag) is not None
    run = read_bag(bag).run
    expected = simulate(parameter_file.load(
        CONFIG / 'friction.yaml', {'plant': {'duration': 1.5}})).run
    assert 100 < len(run.t) < len(expected.t)
    assert np.array_equal(run.q, expected.q[:len(run.t)])

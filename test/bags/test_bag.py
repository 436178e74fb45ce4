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

"""Opening bags of all kinds and of other libraries, and what is wrong in one line."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
import struct

from ctc_chattering.bags.repair import open_bag
from ctc_chattering.errors import CtcError
from motion_bags import joint_state, write_defined
from motion_bags import write as write_bag
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

PLUGINS = {'mcap': StoragePlugin.MCAP, 'db3': StoragePlugin.SQLITE3}
#: Compressions that `rosbags` knows.
PACKED = ('message', 'file', 'storage')


def made(path: Path, ending: str, compression: str = '') -> Path:
    """Return a bag with 50 states, a millisecond apart."""
    messages = [('/joint_states', t, joint_state(t, ('a', 'b'), np.full(2, t), None, None))
                for t in range(0, 50_000_000, 1_000_000)]
    return write_bag(path / 'bag', messages, PLUGINS[ending], compression)


@pytest.mark.parametrize(('ending', 'compression'), [
    ('mcap', ''), ('db3', ''), *(('mcap', x) for x in PACKED), ('db3', 'file')])
def test_a_directory_and_a_single_file(tmp_path: Path, ending: str, compression: str) -> None:
    bag = made(tmp_path, ending, compression)
    for path in (bag, *([] if compression else [bag / f'bag.{ending}'])):
        with closing(open_bag(path)) as reader:
            found = [(t, message.position.tolist())
                     for t, message in reader.read(reader.named('joint_states'))]
            assert found == [(t, [t, t]) for t in range(0, 50_000_000, 1_000_000)]
            assert (reader.start_time, reader.end_time, reader.message_count) == (
                0, 49_000_000, 50)


@pytest.mark.parametrize(('ending', 'content', 'message'), [
    ('mcap', b'', 'not a bag: the file is cut off; "ctc repair'),
    ('mcap', b'hello' * 99, 'not a bag: the file is cut off; "ctc repair'),
    ('db3', b'', 'bag.db3 or database missing tables'),
    ('db3', b'hello' * 99, 'not a bag: ReaderError: Cannot open database'),
    ('yaml', b'rosbag2_bagfile_information: [1, 2', 'not a bag: ParserError: '),
    ('yaml', b'rosbag2_bagfile_information: {version: 10}', 'version 10; known: 1 to 9'),
    ('yaml', b'rosbag2_bagfile_information: {version: 9}', "KeyError: 'relative_file_paths'"),
    ('yaml', b'\xff\xfe\0', 'not a bag: '), ('yaml', b'a: !x 1', 'not a bag: '),
    ('yaml', b'7', 'not a bag: TypeError: ')])
def test_what_cannot_be_read_is_said_in_one_line(
        tmp_path: Path, ending: str, content: bytes, message: str) -> None:
    bag = made(tmp_path, 'db3' if ending == 'db3' else 'mcap')
    (bag / ('metadata.yaml' if ending == 'yaml' else f'bag.{ending}')).write_bytes(content)
    with pytest.raises(CtcError) as error:
        open_bag(bag)
    assert message in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_names_of_files_that_are_refused(tmp_path: Path) -> None:
    """Check names that sqlite3 would take for a URI, and another kind of file."""
    for name in ('we%41', 'what?', 'first#'):
        with pytest.raises(CtcError, match=r'has one of % \? #'):
            open_bag(made(tmp_path, 'db3').rename(tmp_path / name))
    (tmp_path / 'notes.txt').write_text('hi')
    with pytest.raises(CtcError, match=r"unknown storage '\.txt'; known: \.mcap, \.db3"):
        open_bag(tmp_path / 'notes.txt')


IDL = """module my_msgs { module msg { struct Thing {
  std_msgs::msg::Header header; sequence<double> x; }; }; };"""


@pytest.mark.parametrize(('encoding', 'definition'), [
    ('ros2msg', 'std_msgs/Header header\nfloat64[] x'),
    ('ros2idl', f'{"=" * 80}\nIDL: my_msgs/msg/Thing\n{IDL}')])
def test_a_type_that_only_the_bag_defines(
        tmp_path: Path, encoding: str, definition: str) -> None:
    """Check both kinds of definitions; what they lack is known of ROS 2 Jazzy."""
    data = struct.pack('<4siIIIIIdd', b'\0\1\0\0', 1, 2, 1, 0, 2, 0, 1.5, -2.5)
    write_defined(tmp_path / 'file.mcap', '/thing', definition, {7: data}, encoding)
    with closing(open_bag(tmp_path / 'file.mcap')) as reader:
        ((t, found),) = reader.read(reader.named('thing'))
    assert (t, found.header.stamp.sec, found.x.tolist()) == (7, 1, [1.5, -2.5])


def test_a_type_that_a_bag_defines_in_another_way_is_that_of_no_other_bag(tmp_path: Path) -> None:
    """A header of another distribution has a number in front; types are kept between bags."""
    rule = '=' * 80 + '\nMSG: std_msgs/Header\n'
    definition = f'std_msgs/Header header\nstring data\n{rule}uint32 seq\nstring frame_id\n'
    data = struct.pack('<4sII4sI2s', b'\0\1\0\0', 7, 2, b'f', 2, b'x')
    write_defined(tmp_path / 'other.mcap', '/note', definition, {5: data})
    bag = made(tmp_path, 'mcap')
    for _ in range(2):
        with closing(open_bag(bag)) as reader:
            ((_, state), *_) = reader.read(reader.named('joint_states'))
            assert state.header.stamp.nanosec == 0
        with closing(open_bag(tmp_path / 'other.mcap')) as reader:
            ((_, note),) = reader.read(reader.named('note'))
            assert (note.header.seq, note.header.frame_id, note.data) == (7, 'f', 'x')

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

"""Opening bags, and recovering the messages of damaged ones."""

from __future__ import annotations

from collections.abc import Collection, Generator
from contextlib import closing
from pathlib import Path
import shutil
import sys
import tempfile
from typing import Any
import weakref

from ctc_chattering.arguments import checked
from ctc_chattering.bags.index_checksum import check_index
from ctc_chattering.bags.recovery import recover, Recovery
from ctc_chattering.errors import CtcError
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader
from rosbags.typesys import get_typestore, Stores


def is_damaged(bag: Path) -> bool:
    """Return whether `bag` is a directory with MCAP files and without metadata."""
    return bag.is_dir() and not (bag / 'metadata.yaml').exists() and any(bag.glob('*.mcap'))


class BagReader(Reader):
    """
    The reader of rosbags, with errors that name the bag and what to do; close it after use.

    Parameters
    ----------
    path : Path
        What errors say.
    place : Path
        Directory or file to read.

    """

    def __init__(self, path: Path, place: Path) -> None:
        super().__init__(place)
        self._bag = path
        self._typestore = get_typestore(Stores.ROS2_JAZZY)

    def messages(self, connections: Collection[Connection] = (), start: int | None = None,
                 stop: int | None = None) -> Generator[tuple[Connection, int, bytes], None, None]:
        """
        Yield connection, log time [ns] and data.

        Raises
        ------
        CtcError
            Where the bag is damaged, and if it has not as many messages as its metadata count.

        """
        found, counted = 0, sum(x.msgcount for x in connections or self.connections)
        messages = super().messages(connections, start, stop)
        while True:
            try:
                message = next(messages, None)
            except Exception as error:  # Damaged chunks may raise any exception.
                raise _damaged(self._bag, error) from None
            if message is None:
                break
            found += 1
            yield message
        if start is None and stop is None and found != counted:
            topics = ', '.join(x.topic for x in connections) or 'all topics'
            raise _damaged(self._bag, ValueError(
                f'{found} messages of {topics}, {counted} according to its metadata'))

    def deserialize(self, data: bytes, kind: str) -> Any:
        """Return a message of one of the types that ROS 2 Jazzy brings along."""
        return self._typestore.deserialize_cdr(data, kind)


def open_bag(path: Path) -> BagReader:
    """
    Return an open reader of the bag at `path`.

    Raises
    ------
    CtcError
        If there is no bag, or it cannot be read.

    """
    if not path.exists():
        raise CtcError(f'{path}: no such bag')
    scratch = None
    place = path
    if is_damaged(path):
        scratch = tempfile.TemporaryDirectory()
        place = Path(scratch.name) / 'bag'
        print(f'{path}: not closed properly: {recover(path, place)}', file=sys.stderr)
    try:
        for file in place.glob('*.mcap'):
            check_index(file)
        reader = BagReader(path, place)
        reader.open()
    except Exception as error:  # Damaged YAML or MCAP may raise any exception.
        if any(place.glob('*.mcap')):
            raise _damaged(path, error) from None
        raise CtcError(f'{path}: not a bag: {" ".join(str(error).split())}') from None
    if scratch is not None:
        weakref.finalize(reader, scratch.cleanup)
    return reader


def _damaged(path: Path, error: Exception) -> CtcError:
    """Return an error that names the bag and what to do."""
    advice = (f'; "ctc repair {path}" recovers the rest' if any(path.glob('*.mcap')) else
              f'; "ros2 bag reindex {path}" may help')
    return CtcError(f'{path}: damaged: {" ".join(str(error).split()).rstrip(".")}{advice}')


def is_whole(bag: Path) -> bool:
    """Return whether all messages that the metadata of a bag count can be read."""
    if is_damaged(bag):
        return False
    try:
        with closing(open_bag(bag)) as reader:
            return sum(1 for _ in reader.messages()) == reader.message_count
    except CtcError:
        return False


@checked(bag=(str, Path))
def repair(bag: str | Path) -> tuple[Recovery, Path] | None:
    """
    Replace a damaged bag by one with all messages that can be read; keep the damaged one.

    Parameters
    ----------
    bag : str or Path
        Directory of the bag.

    Returns
    -------
    (Recovery, Path) or None
        What was recovered, and the new path of the damaged bag; None if the bag is not damaged.

    Raises
    ------
    CtcError
        If there is no bag, or nothing can be recovered.

    """
    bag = Path(bag)
    if not bag.exists():
        raise CtcError(f'{bag}: no such bag')
    if is_whole(bag):
        return None
    if not any(bag.glob('*.mcap')):
        raise CtcError(f'{bag}: not a bag: it holds no MCAP file')
    aside = bag.with_name(bag.name + '.damaged')
    if aside.exists():
        raise CtcError(f'{aside}: exists already, not overwritten')
    with tempfile.TemporaryDirectory(dir=bag.resolve().parent) as scratch:
        whole = Path(scratch) / bag.resolve().name
        found = recover(bag, whole)
        bag.rename(aside)
        shutil.move(whole, bag)
    return found, aside

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

from contextlib import closing
from pathlib import Path
import shutil
import sys
import tempfile
import weakref

from ctc_chattering.arguments import checked
from ctc_chattering.bags.bag_reader import BagReader, damaged
from ctc_chattering.bags.recovery import recover, Recovery
from ctc_chattering.errors import CtcError


def is_damaged(bag: Path) -> bool:
    """Return whether `bag` is a directory with MCAP files and without metadata."""
    return bag.is_dir() and not (bag / 'metadata.yaml').exists() and any(bag.glob('*.mcap'))


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
        reader = BagReader(path, place)
    except CtcError as error:
        raise CtcError(f'{path}: {error}') from None
    except Exception as error:  # Damaged YAML or MCAP may raise any exception.
        if any(place.glob('*.mcap')):
            raise damaged(path, error) from None
        raise CtcError(f'{path}: not a bag: {" ".join(str(error).split())}') from None
    if scratch is not None:
        weakref.finalize(reader, scratch.cleanup)
    return reader


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

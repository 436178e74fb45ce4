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

"""
Files of a bag, by its metadata or their names.

`bag.py` lists the files of a bag here, and `repair.py` those of a damaged one. A recorder that
splits a recording numbers its files, ``run_0.mcap``, ``run_1.mcap``, and each goes on where the
one before ends. Other files of a directory are not one bag.
"""

from __future__ import annotations

from ast import literal_eval
from collections.abc import Mapping, Sequence
import dataclasses
from itertools import pairwise
from pathlib import Path, PurePath
import re
from typing import Any, NamedTuple

from ctc_chattering.errors import CtcError, shorten
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
import yaml

METADATA = 'metadata.yaml'
#: Endings of the files that are read. ``.zstd`` may follow.
ENDINGS = ('.mcap', '.db3')
#: Newest version of the metadata that is known.
_NEWEST_VERSION = 9
_NUMBERED = re.compile(r'(.*)_(\d+)\.\w+')
#: Longest overlap of two files of a recording, as two threads log.
_MAX_OVERLAP_NS = NANOSECONDS
#: Longest pause between them, as where a damaged end of a file is missing.
_MAX_PAUSE_NS = 10 * NANOSECONDS


class UnsupportedBag(CtcError):
    """Refusal of a bag that no repair would change."""


class BagFiles(NamedTuple):
    """
    The files of a bag.

    Attributes
    ----------
    paths : tuple of Path
        In the order of their times.
    metadata : dict or None
        Content of the metadata; None without metadata.

    """

    paths: tuple[Path, ...]
    metadata: dict[str, Any] | None = None


@dataclasses.dataclass
class Span:
    """Number of messages, first and last log time [ns]."""

    count: int = 0
    begin: int = 2 ** 63 - 1  # As rosbag2 has it for a bag without messages.
    end: int = 0


def list_files(path: Path) -> BagFiles:
    """
    Return the files of a bag, a directory or one file.

    Raises
    ------
    UnsupportedBag
        If a directory without metadata has files of several recordings.
    Exception
        Of any kind, if metadata are damaged or there is no file.

    """
    if not path.is_dir():
        return BagFiles((path,))
    if not (path / METADATA).exists():
        return BagFiles(find_recording(path))
    metadata = read_metadata(path)
    names = [PurePath(x).name for x in metadata['relative_file_paths']]
    return BagFiles(tuple(path / name for name in names), metadata)


def read_metadata(bag: Path) -> dict[str, Any]:
    """
    Return the content of a bag's metadata.

    Raises
    ------
    UnsupportedBag
        If they are of a newer version.
    Exception
        Of any kind, if they are damaged.

    """
    content = yaml.safe_load((bag / METADATA).read_text(encoding='utf-8'))
    information: dict[str, Any] = content['rosbag2_bagfile_information']
    if information['version'] > _NEWEST_VERSION:
        raise UnsupportedBag(f'{bag}: metadata of version {information["version"]}; known: 1 to '
                             f'{_NEWEST_VERSION}')
    return information


def count_dropped(bag: Path, topics: Sequence[str]) -> int:
    """Return how many messages on topics our recorder lost."""
    return _count_dropped(_read_notes(bag), topics)


def is_complete(bag: Path, topics: Sequence[str]) -> bool:
    """Return whether our recorder says that it lost no message on topics."""
    notes = _read_notes(bag)
    return 'dropped' in notes and 'repaired' not in notes and not _count_dropped(notes, topics)


def _read_notes(bag: Path) -> Mapping[str, Any]:
    """Return the remarks of our recorder on a bag, empty if there are none."""
    try:
        return dict(read_metadata(bag)['custom_data'])
    except Exception:  # Without metadata, or of another recorder.
        return {}


def _count_dropped(notes: Mapping[str, Any], topics: Sequence[str]) -> int:
    """Return how many messages on topics were lost according to remarks."""
    try:
        counts = literal_eval(notes.get('dropped', '{}'))
        names = [x for x in counts if x.endswith(tuple(topics))]
        return sum(int(counts[x]) for x in names)
    except Exception:  # Arbitrary text may raise any exception.
        return 0


def find_recording(folder: Path) -> tuple[Path, ...]:
    """
    Return the files of a directory's only recording.

    Raises
    ------
    UnsupportedBag
        If the names are those of several recordings.
    CtcError
        If there is no file.

    """
    endings = (*ENDINGS, '.bag')
    files = [x for x in folder.iterdir() if x.is_file() and storage_of(x) in endings]
    if not files:
        raise CtcError(f'no {METADATA} in it, and no file {" or ".join(ENDINGS)}')
    if len(files) == 1:
        return tuple(files)
    numbered: dict[int, Path] = {}
    series: set[tuple[str, str]] = set()
    for file in files:
        match = _NUMBERED.fullmatch(file.name.removesuffix('.zstd'))
        if match:
            numbered[int(match[2])] = file
            series.add((match[1], storage_of(file)))
    first = min(numbered, default=0)
    expected = range(first, first + len(files))
    if len(series) != 1 or numbered.keys() != set(expected):
        raise several_recordings(folder, sorted(files))
    return tuple(numbered[k] for k in sorted(numbered))


def storage_of(file: Path) -> str:
    """Return a file's ending, without that of its compression."""
    return Path(file.stem).suffix if file.suffix == '.zstd' else file.suffix


def check_one_recording(folder: Path, spans: Mapping[Path, Span]) -> None:
    """
    Raise unless numbered files follow each other in time.

    Raises
    ------
    UnsupportedBag
        If one begins long before, or long after, the one before it ends.

    """
    recorded = [(path, span) for path, span in spans.items() if span.count]
    for (earlier, first), (later, second) in pairwise(recorded):
        pause = second.begin - first.end
        if not -_MAX_OVERLAP_NS <= pause <= _MAX_PAUSE_NS:
            order = 'after' if pause > 0 else 'before'
            raise several_recordings(
                folder,
                tuple(spans),
                f': {later.name} begins {abs(seconds(pause)):.3g} s {order} the end of '
                f'{earlier.name}')


def several_recordings(folder: Path, files: Sequence[Path], reason: str = '') -> UnsupportedBag:
    """Return the refusal of a directory with several recordings."""
    names = shorten([x.name for x in files])
    return UnsupportedBag(
        f'{folder}: several recordings and no {METADATA}: {names}{reason}. Name one of the files, '
        'or give each recording a directory of its own')

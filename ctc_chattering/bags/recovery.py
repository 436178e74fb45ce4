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

"""What can be read of a damaged bag, written as a new one; and what is missing."""

from __future__ import annotations

from collections import Counter
import dataclasses
from pathlib import Path
from typing import Any

from ctc_chattering.bags.mcap_file import McapFile
from ctc_chattering.bags.writer import BagWriter, Span
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import seconds
import yaml


@dataclasses.dataclass
class Recovery:
    """
    What was found in a damaged bag.

    Attributes
    ----------
    span : Span
        Of the messages recovered.
    lost : int
        Bytes that could not be read: damaged chunks, the ends of truncated files, and messages
        without a type or a valid time.
    missing : dict
        Number of messages by topic that were written and not recovered.
    is_counted : bool
        Whether metadata or index tell how many messages were written. Otherwise more may be
        missing at the end.
    repeated : int
        Chunks that were left out because they stood there before.

    """

    span: Span = dataclasses.field(default_factory=Span)
    lost: int = 0
    missing: dict[str, int] = dataclasses.field(default_factory=dict)
    is_counted: bool = False
    repeated: int = 0

    def __str__(self) -> str:
        """Return a summary on one line."""
        count, missing = self.span.count, sum(self.missing.values())
        duration = seconds(self.span.end - self.span.begin) if count else 0.0
        topics = ', '.join(f'{topic} {number}' for topic, number in sorted(self.missing.items()))
        return (f'{count} messages over {duration:.3f} s recovered, {missing} of '
                f'{"" if self.is_counted else "at least "}{count + missing} missing'
                + (f' ({topics})' if topics else '') + f', {self.lost} bytes unreadable'
                + (f', {self.repeated} duplicate chunks skipped' if self.repeated else ''))


def recover(bag: Path, target: Path) -> Recovery:
    """
    Write all that can be read of a damaged bag as a new bag.

    Parameters
    ----------
    bag : Path
        Directory with MCAP files.
    target : Path
        Directory to create.

    Raises
    ------
    CtcError
        If there is no message left, or the new bag cannot be written.

    """
    found, seen = Recovery(), set[bytes]()
    recording = BagWriter(target)
    written, custom = _metadata(bag)
    numbers, indexed, is_indexed = Counter[str](), Counter[str](), True
    try:
        for path in sorted(bag.glob('*.mcap'), key=lambda x: (len(x.name), x.name)):
            file = McapFile(path)
            for topic, kind, t, data, number in file.messages(seen):
                if topic not in recording.counts:
                    recording.add_topic(topic, kind)
                recording.add_message(topic, t, data)
                numbers[topic] = max(numbers[topic], number)
            found.lost, found.repeated = found.lost + file.lost, found.repeated + file.repeated
            indexed.update(file.counts or {})
            is_indexed &= file.counts is not None
        found.is_counted = is_indexed or written is not None
        found.missing = dict(
            (numbers | indexed | (written or Counter())) - Counter(recording.counts))
        found.span = recording.span
        for key, value in {**custom, 'repaired': str(found)}.items():
            recording.note(key, value)
        recording.close()
    except OSError as error:
        raise CtcError(f'{error.filename or target}: {error.strerror or error}') from None
    if not found.span.count:
        raise CtcError(f'{bag}: no message in it can be recovered')
    return found


def _metadata(bag: Path) -> tuple[Counter[str] | None, dict[str, str]]:
    """Return number of messages by topic, None if not known, and custom data, of the metadata."""
    try:
        tree: Any = yaml.safe_load((bag / 'metadata.yaml').read_text(encoding='utf-8'))
        info = tree['rosbag2_bagfile_information']
        counts = Counter[str]()
        for topic in info['topics_with_message_count']:
            counts[str(topic['topic_metadata']['name'])] += int(topic['message_count'])
        custom = {str(key): str(x) for key, x in (info.get('custom_data') or {}).items()}
        sums = {counts.total(), *(
            [sum(int(x['message_count']) for x in info['files'])] if 'files' in info else [])}
        return (counts if sums == {info['message_count']} else None), custom
    except Exception:  # Of damaged metadata, anything may be wrong.
        return None, {}

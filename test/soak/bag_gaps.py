"""What is in the bags of a soak test, and what is not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader

from ctc_chattering.core.grid import NANOSECONDS, seconds
from ctc_chattering.errors import CtcError
from ctc_chattering.graph import JOINT_STATES
from ctc_chattering.ros.serialization import StateWriter
from ctc_chattering.salvage import is_damaged, open_bag
from ctc_chattering.soak import Gap, gaps, Outage

#: Where the stamp of a header stands in a serialized message, and how long it is.
_STAMP, _SIZE = 4, 8


def examine(bags: Sequence[Path], names: Sequence[str], outages: Sequence[Outage]
            ) -> dict[str, Any]:
    """
    Open every bag and look for gaps in the stamps of the plant's states.

    Parameters
    ----------
    bags : sequence of Path
        Directories.
    names : sequence of str
        The plant's joints.
    outages : sequence of Outage
        Of plant and recorder.

    """
    found: list[Gap] = []
    unreadable = []
    messages = states = salvaged = 0
    for bag in bags:
        salvaged += is_damaged(bag)
        try:
            with closing(open_bag(bag)) as reader:
                stamps = list(_stamps(reader, names))
                count, end = reader.message_count, reader.end_time
        except CtcError as error:
            unreadable.append(str(error))
            continue
        messages += count
        states += len(stamps)
        # The bag's end, after the last of them.
        found += gaps([*stamps, max(end, stamps[-1] + 1)] if stamps else [], outages)
    return {'count': len(bags), 'salvaged': salvaged, 'messages': messages, 'states': states,
            'gaps': len(found), 'unexplained_gaps': sum(not gap.explained for gap in found),
            'longest_gap_s': seconds(max((abs(b - a) for a, b, _ in found), default=0)),
            'unexplained': [[a, b] for a, b, explained in found if not explained],
            'unreadable': unreadable}


def _stamps(reader: AnyReader, names: Sequence[str]) -> Iterator[int]:
    """Yield the stamps [ns] of the states that the plant itself sent; it names no frame."""
    row = (0.0,) * len(names)
    sample = StateWriter(names).write(0, row, row, row)
    begin, end = _STAMP + _SIZE, len(sample) - 3 * (8 * len(names)) - 16
    connections = [x for x in reader.connections if x.topic.endswith('/' + JOINT_STATES)]
    for _, _, data in reader.messages(connections) if connections else ():
        if len(data) == len(sample) and data[begin:end] == sample[begin:end]:
            sec = int.from_bytes(data[_STAMP:_STAMP + 4], 'little', signed=True)
            yield sec * NANOSECONDS + int.from_bytes(data[_STAMP + 4:begin], 'little')

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
Recorder node: writes every message of the graph, as it was received, into a bag.

It subscribes to all `TOPICS` of `configuration/topics.py`. `bags.writer` puts them into files.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
import dataclasses
from operator import itemgetter
from pathlib import Path
import time
from typing import Any

from ctc_chattering.bags.arrivals import LogTime, SequenceTracker
from ctc_chattering.bags.writer import BagWriter, offered_qos
from ctc_chattering.configuration.loop_setup import Values
from ctc_chattering.configuration.node_parameters import RecorderConfig
from ctc_chattering.configuration.topics import CLOCK, JOINT_STATES, Topic, TOPICS
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.ros.messages import message_type, read_stamp
from ctc_chattering.ros.node import BaseNode
from ctc_chattering.ros.parameters import NodeParameters
from ctc_chattering.ros.reports import ERROR, OK, Status
from ctc_chattering.ros.spinning import NAP
from ctc_chattering.ros.subscription import MatchingSubscription, qos, ValidatedSubscription

#: Messages that DDS keeps while this process or the disk sleeps.
_DEPTH = 100_000
#: Time between two flushes to the disk [s].
FLUSH_PERIOD = 0.3
#: Time for which a message may still be on its way at the end [s].
_DELIVERY_S = 0.02
#: Messages that wait until a state or a clock tells the time.
_MAX_WAITING = 500
#: Time for which messages are taken at the end, while more are to come [ns].
_DRAIN_NS = NANOSECONDS // 5


@dataclasses.dataclass
class _Recorded:
    """
    Topic that is recorded.

    Attributes
    ----------
    name, message_type : str
        Full name and type.
    offered : str
        Quality of service that its publishers offer.
    matching : MatchingSubscription
        Source of its messages.
    timing : ValidatedSubscription or None
        Reader of the time in them, where they have it.
    sequence : SequenceTracker
        Count of missing messages.

    """

    name: str
    message_type: str
    offered: str
    matching: MatchingSubscription
    timing: ValidatedSubscription[int] | None
    sequence: SequenceTracker


class RecorderNode(BaseNode):
    """
    Recorder of all `TOPICS` of `configuration/topics.py`.

    With a publisher of ``clock`` the log time is the simulated time of the last state received, so
    that a lockstep run plays back with its own timing. Otherwise it is the time of reception.
    Publishers number their messages. A missing number is a message that was dropped on the way,
    and the bag has their count.

    Messages are taken from the middleware in batches and sorted by arrival: an executor that calls
    back for each takes longer.
    """

    def __init__(self, values: Values | None = None) -> None:
        super().__init__('recorder', values)
        self._recording = BagWriter(Path(NodeParameters(self, RecorderConfig).config.bag))
        self.tick = NAP
        self._received = 0
        self._reported_count = 0
        #: Time of sending of the last message recorded, by the system's clock [ns].
        self._sent = 0
        self._dropped: Counter[str] = Counter()
        self._note_dropped()
        self._flushed = self._reported = time.monotonic()
        self._time = LogTime()
        self._clock_topic = self.resolve_topic_name(CLOCK)
        #: None until it is known.
        self._simulated: bool | None = None
        #: Messages to write, with their times of reception [ns].
        self._waiting: list[tuple[_Recorded, int, bytes]] = []
        #: Messages that came after the batch began: arrival [ns], topic, data, information.
        self._pending: list[tuple[int, _Recorded, bytes, Mapping[str, Any]]] = []
        self._topics = [self._subscribe(topic) for topic in TOPICS.values()]

    def introduction(self) -> str:
        """Return the path of the bag."""
        return f'records {len(TOPICS)} topics to {self._recording.path}; waits for messages'

    @property
    def subscriptions(self) -> Iterator[Any]:
        """Subscriptions that an executor serves, without those that `_take` serves."""
        recorded = [topic.matching.current for topic in self._topics]
        return (x for x in super().subscriptions if x not in recorded)

    def _subscribe(self, topic: Topic) -> _Recorded:
        """Subscribe to a topic."""
        name = self.resolve_topic_name(topic.name)
        message_class = message_type(topic.kind)
        profile = qos(_DEPTH, topic.latched)
        timing = None
        if topic.name in (JOINT_STATES, CLOCK):
            timing = ValidatedSubscription(
                self, message_class, topic.name,
                lambda stamp, _now: self._time.note(name, stamp), profile, read_stamp)
        matching = timing.subscription if timing else MatchingSubscription(
            self, message_class, topic.name, lambda _: None, profile)
        return _Recorded(name, topic.kind, offered_qos(topic.depth, topic.latched), matching,
                         timing, SequenceTracker())

    def _record(self, topic: _Recorded, data: bytes, info: Mapping[str, Any]) -> None:
        """Record a message, once it is known whether time is simulated."""
        if number := info.get('publication_sequence_number'):
            self._count_dropped(topic, number)
        if topic.timing is not None:
            topic.timing.receive(data, info)
        received = info.get('received_timestamp') or self.get_clock().now().nanoseconds
        self._waiting.append((topic, received, data))
        if self._simulated is None and (topic.timing or len(self._waiting) > _MAX_WAITING):
            self._simulated = (
                topic.name == self._clock_topic or self.count_publishers(CLOCK) > 0)
        if self._simulated is not None:
            self._write_waiting()

    def _write_waiting(self) -> None:
        """Write the messages that wait."""
        for topic, received, data in self._waiting:
            self._attempt(
                self._recording.write,
                topic.name,
                topic.message_type,
                self._time.now if self._simulated else received,
                data,
                topic.offered)
        self._waiting.clear()

    def _count_dropped(self, topic: _Recorded, number: int) -> None:
        """Count the missing messages before one with this number."""
        count = topic.sequence.lost(number, lambda: self.count_publishers(topic.name))
        if count:
            self._dropped[topic.name] += count
            self._note_dropped()
            self.get_logger().error(
                f'{topic.name}: {count} messages were dropped', throttle_duration_sec=1.0)

    def _note_dropped(self) -> None:
        """Say in the bag what was lost, also if it is nothing."""
        self._recording.notes['dropped'] = str(dict(self._dropped))

    def status(self) -> Status:
        """Return the counts of messages, and the problem if there is one."""
        now = time.monotonic()
        elapsed = max(now - self._reported, 1e-3)
        rate = (self._received - self._reported_count) / elapsed
        self._reported_count = self._received
        self._reported = now
        dropped = self._dropped.total()
        values = {
            'messages': self._recording.counts.total(),
            'rate [Hz]': rate,
            'dropped': dropped,
            **{f'dropped, {topic}': count for topic, count in self._dropped.items()}}
        problem = self.failure or (f'{dropped} messages were dropped' if dropped else '')
        if problem:
            return Status(ERROR, problem, values)
        return Status(OK, f'recording to {self._recording.path}', values)

    def spin(self, executor: Any) -> None:
        """Serve parameters and timers, then record what has come."""
        super().spin(executor)
        self._take()

    def _take(self) -> None:
        """Record all that has arrived, in the order of arrival."""
        begin = time.time_ns()
        pending = self._pending
        for topic in self._topics:
            current = topic.matching.current
            take, message_class = current.handle.take_message, current.msg_type
            while (message := take(message_class, True)) is not None:
                data, info = message
                arrival = info.get('received_timestamp') or 0
                pending.append((arrival, topic, data, info))
                self._received += 1
                if arrival > begin:
                    break
        pending.sort(key=itemgetter(0))
        taken = bisect_right(pending, begin, key=itemgetter(0))
        self._pending = pending[taken:]
        for _, topic, data, info in pending[:taken]:
            self._sent = info.get('source_timestamp') or 0
            self._record(topic, data, info)

    def _drain(self) -> None:
        """Record what was sent before now, within a limit of time."""
        begin = time.time_ns()
        received = -1
        while received < self._received or self._pending:
            received = self._received
            self._take()
            if self._sent > begin:
                return
            # When the others have ended, there is time for all that they have sent.
            if time.time_ns() - begin > _DRAIN_NS and self.count_publishers(JOINT_STATES):
                return
            time.sleep(_DELIVERY_S)

    def idle(self) -> None:
        """Flush the bag to the disk every so often."""
        if time.monotonic() - self._flushed > FLUSH_PERIOD:
            self._attempt(self._recording.flush)
            self._flushed = time.monotonic()

    def _attempt(self, action: Callable[..., None], *arguments: Any) -> None:
        """Write to the disk, and where that fails, end the recording alone."""
        if self.failure is not None:
            return
        try:
            action(*arguments)
        except OSError as error:
            self._recording.abandon()
            self.failure = (f'the recording has stopped: {error.strerror or error}; `ctc repair` '
                            'recovers the messages written before')
            self.get_logger().error(self.failure)

    def finish(self) -> None:
        """Close the bag."""
        self._drain()
        self._write_waiting()
        self._attempt(self._recording.close)
        if self.failure is None:
            counts = self._recording.counts
            dropped = self._dropped.total()
            text = f'{counts.total()} messages on {len(counts)} topics'
            self.get_logger().info(f'{text}, {dropped} dropped' if dropped else text)

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

"""The recorder as a node: every message of the graph, as it was received, into a bag."""

from __future__ import annotations

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
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.ros.messages import message_type, read_stamp
from ctc_chattering.ros.node import BaseNode
from ctc_chattering.ros.parameters import NodeParameters
from ctc_chattering.ros.reports import ERROR, OK, Status
from ctc_chattering.ros.spinning import NAP
from ctc_chattering.ros.subscription import MatchingSubscription, qos, ValidatedSubscription
from ctc_chattering.ros.topics import CLOCK, JOINT_STATES, Topic, TOPICS

#: Messages that DDS keeps for us while we sleep, or the disk does.
_DEPTH = 100_000
#: Time between two flushes to the disk [s].
FLUSH_PERIOD = 0.3
#: How long a message may still be on its way at the end [s].
_SLICE = 0.02
#: So many messages wait until a state or a clock tells what the time is.
_EARLY = 500
#: How long it takes messages that came before the end, while more are to come [ns].
_DRAIN = NANOSECONDS // 5


@dataclasses.dataclass
class _Recorded:
    """
    A topic that is recorded.

    Attributes
    ----------
    name, kind : str
        Full name and message type.
    offered : str
        What its publishers offer.
    matching : MatchingSubscription
        Whence its messages are taken.
    timing : ValidatedSubscription or None
        What reads the time out of them, where they tell it.
    sequence : SequenceTracker
        What finds missing messages.

    """

    name: str
    kind: str
    offered: str
    matching: MatchingSubscription
    timing: ValidatedSubscription[int] | None
    sequence: SequenceTracker


class RecorderNode(BaseNode):
    """
    Records all topics of `ros.topics.TOPICS`.

    The log time is the simulated time of the last state received where there is a publisher of
    ``clock``, so that a lockstep run plays back with its own timing, and the node clock's time
    of reception otherwise. Publishers number their messages; what is missing in the numbers was
    dropped on the way, and the bag says how much.

    Messages are taken from the middleware in batches and put in the order of their arrival: an
    executor that calls back for each takes longer for a message.
    """

    def __init__(self, values: Values | None = None) -> None:
        super().__init__('recorder', values)
        self._recording = BagWriter(Path(NodeParameters(self, RecorderConfig).config.bag))
        self.tick = NAP
        self._received = 0
        #: When the last message recorded was sent [ns], by the system's clock.
        self._sent = 0
        self._dropped: Counter[str] = Counter()
        self._flushed = self._reported = time.monotonic()
        self._received_before = 0
        self._time = LogTime()
        self._clock_topic = self.resolve_topic_name(CLOCK)
        self._simulated: bool | None = None
        self._early: list[tuple[_Recorded, int, bytes]] = []
        #: What was taken and came after the batch began: arrival [ns], topic, data, information.
        self._pending: list[tuple[int, _Recorded, bytes, Mapping[str, Any]]] = []
        self._topics: list[_Recorded] = []
        for topic in TOPICS.values():
            self._topics.append(self._subscribe(topic))

    def introduction(self) -> str:
        """Return where the bag is."""
        return f'records {len(TOPICS)} topics to {self._recording.path}; waits for messages'

    @property
    def subscriptions(self) -> Iterator[Any]:
        """Yield those that an executor serves; `_take` serves the others."""
        taken = [topic.matching.current for topic in self._topics]
        return (x for x in super().subscriptions if x not in taken)

    def _subscribe(self, topic: Topic) -> _Recorded:
        name, kind = self.resolve_topic_name(topic.name), message_type(topic.kind)
        profile = qos(_DEPTH, topic.latched)
        timing = None
        if topic.name in (JOINT_STATES, CLOCK):
            timing = ValidatedSubscription(
                self, kind, topic.name, lambda stamp, _now: self._time.note(name, stamp),
                profile, read_stamp)
        return _Recorded(
            name, topic.kind, offered_qos(topic.depth, topic.latched),
            timing.subscription if timing else MatchingSubscription(
                self, kind, topic.name, lambda _: None, profile), timing, SequenceTracker())

    def _record(self, topic: _Recorded, data: bytes, info: Mapping[str, Any]) -> None:
        """Record a message."""
        number = info.get('publication_sequence_number')
        if number:
            self._lose(topic.name, topic.sequence.lost(
                number, lambda: self.count_publishers(topic.name)))
        if topic.timing is not None:
            topic.timing.receive(data, info)
        if self._simulated is None and (topic.timing or len(self._early) >= _EARLY):
            self._begin(topic.name == self._clock_topic or self.count_publishers(CLOCK) > 0)
        t = self._time.now if self._simulated else (
            info.get('received_timestamp') or self.get_clock().now().nanoseconds)
        if self._simulated is None:
            self._early.append((topic, t, data))
        else:
            self._write(topic, t, data)

    def _begin(self, simulated: bool) -> None:
        """Write what came before it could be known whether time is simulated."""
        self._simulated = simulated
        early, self._early = self._early, []
        for topic, t, data in early:
            self._write(topic, self._time.now if simulated else t, data)

    def _write(self, topic: _Recorded, t: int, data: bytes) -> None:
        self._attempt(
            self._recording.write, topic.name, topic.kind, t, data, topic.offered)

    def _lose(self, topic: str, count: int) -> None:
        """Count messages that never came."""
        if not count:
            return
        self._dropped[topic] += count
        self._recording.notes['dropped'] = str(dict(self._dropped))
        self.get_logger().error(
            f'{topic}: {count} messages were dropped', throttle_duration_sec=1.0)

    def status(self) -> Status:
        """Return what was recorded."""
        now, lost = time.monotonic(), sum(self._dropped.values())
        rate = (self._received - self._received_before) / max(now - self._reported, 1e-3)
        self._received_before, self._reported = self._received, now
        level, message = OK, f'recording to {self._recording.path}'
        if self.failure is not None:
            level, message = ERROR, self.failure
        elif lost:
            level, message = ERROR, f'{lost} messages were dropped'
        return Status(level, message, {
            'messages': sum(self._recording.counts.values()), 'rate [Hz]': rate, 'dropped': lost,
            **{f'dropped, {topic}': count for topic, count in self._dropped.items()}})

    def spin(self, executor: Any) -> None:
        """Serve parameters and timers, then record what has come."""
        super().spin(executor)
        self._take()

    def _take(self) -> None:
        """Record what had arrived when this was called, in the order of arrival."""
        begin = time.time_ns()
        pending = self._pending
        for topic in self._topics:
            current = topic.matching.current
            take, kind = current.handle.take_message, current.msg_type
            while (taken := take(kind, True)) is not None:
                data, info = taken
                arrival = info.get('received_timestamp') or 0
                pending.append((arrival, topic, data, info))
                self._received += 1
                if arrival > begin:
                    break
        pending.sort(key=itemgetter(0))
        self._pending = [x for x in pending if x[0] > begin]
        for _, topic, data, info in pending[:len(pending) - len(self._pending)]:
            self._sent = info.get('source_timestamp') or 0
            self._record(topic, data, info)

    def _drain(self) -> None:
        """Take all that was sent before now, but not for ever."""
        begin = time.time_ns()
        before = -1
        while before < self._received or self._pending:
            before = self._received
            self._take()
            if self._sent > begin:
                return
            # When the others have ended, there is time for all that they have sent.
            if time.time_ns() - begin > _DRAIN and self.count_publishers(JOINT_STATES):
                return
            time.sleep(_SLICE)

    def idle(self) -> None:
        """Put what was received onto the disk every so often."""
        now = time.monotonic()
        if now - self._flushed > FLUSH_PERIOD:
            self._attempt(self._recording.flush)
            self._flushed = time.monotonic()

    def _attempt(self, action: Callable[..., None], *arguments: Any) -> None:
        """Call what writes to the disk; where that takes no more, let the control loop go on."""
        if self.failure is not None:
            return
        try:
            action(*arguments)
        except OSError as error:
            self._recording.abandon()
            self.failure = (f'recording has stopped: {error.strerror or error}; what was written '
                            'before is kept, see ctc repair')
            self.get_logger().error(self.failure)

    def finish(self) -> None:
        """Close the bag."""
        self._drain()
        self._begin(bool(self._simulated))
        self._attempt(self._recording.close)
        if self.failure is None:
            total, lost = sum(self._recording.counts.values()), sum(self._dropped.values())
            self.get_logger().info(f'{total} messages on {len(self._recording.counts)} topics'
                                   + (f', {lost} dropped' if lost else ''))

"""The recorder as a node: every message of the graph, as it was received, into a bag."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from operator import itemgetter
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from ctc_chattering.core.arbiter import Arbiter
from ctc_chattering.core.grid import NANOSECONDS
from ctc_chattering.core.log_time import LogTime
from ctc_chattering.core.numbering import Numbering
from ctc_chattering.graph import CLOCK, JOINT_STATES, Topic, TOPICS
from ctc_chattering.middleware import enlarge_receive_buffers
from ctc_chattering.nodes.inbox import LAPSE, PATIENCE
from ctc_chattering.nodes.matching import MatchingSubscription
from ctc_chattering.nodes.parameters import NodeParameters
from ctc_chattering.nodes.runtime import NAP, qos, Shell, Status
from ctc_chattering.recording import offered_qos, Recording
from ctc_chattering.ros.messages import message_type, read_stamp
from ctc_chattering.settings import RecorderSettings

#: Messages that DDS keeps for us while we sleep, or the disk does.
_DEPTH = 100_000
#: What the kernel keeps for us while the middleware's thread has no processor, if
#: ``net.core.rmem_max`` allows it [bytes]: some thousand messages.
_RECEIVE_BUFFER = 1 << 22
#: Between two flushes to the disk [s].
_FLUSH = 0.3
#: How long a message may still be on its way at the end [s].
_SLICE = 0.02
#: How far states may be behind the clock [ns].
_BEHIND = NANOSECONDS // 50
#: So many messages wait until a state or a clock tells what the time is.
_EARLY = 500
#: Without a state of those who publish them, for so long, something is worth a word [ns].
_SILENCE = 3 * NANOSECONDS
#: How long it takes messages that came before the end, while more are to come [ns].
_DRAIN = NANOSECONDS // 5


def _no_callback(_data: bytes) -> None:
    """Mark a subscription whose messages `RecorderNode` takes itself."""


class RecorderNode(Shell):
    """
    Records all topics of `graph.TOPICS`.

    The log time is the simulated time of the last state received where somebody publishes
    ``clock``, so that a lockstep run plays back with its own timing, and the node clock's time
    of reception otherwise. Publishers number their messages; what is missing in the numbers was
    dropped on the way, and the bag says how much.

    Messages are taken from the middleware in batches and put in the order of their arrival: an
    executor that calls back for each takes longer for a message.
    """

    def __init__(self) -> None:
        super().__init__('recorder')
        tuning = NodeParameters(self, (RecorderSettings,), lambda: None)
        self._recording = Recording(Path(tuning.get(RecorderSettings).bag))
        self.tick = NAP
        self._received = 0
        #: When the last message recorded was sent [ns], by the system's clock.
        self._sent = 0
        self._dropped: Counter[str] = Counter()
        self._flushed = self._reported = time.monotonic()
        self._heard = time.monotonic_ns()
        self._received_before = 0
        self._time = LogTime()
        self._simulated: bool | None = None
        self._early: list[tuple[str, str, int, bytes, str]] = []
        #: What was taken and came after the batch began: arrival [ns], handler, data, information.
        self._pending: list[tuple[int, Callable[..., None], bytes, Mapping[str, Any]]] = []
        self._topics = [
            (MatchingSubscription(self, message_type(topic.kind), topic.name, _no_callback,
                                  qos(_DEPTH, topic.latched)), self._handler(topic))
            for topic in TOPICS.values()]
        enlarge_receive_buffers(_RECEIVE_BUFFER)

    def introduction(self) -> str:
        """Return where the bag is."""
        return f'records {len(TOPICS)} topics to {self._recording.path}; waits for messages'

    @property
    def subscriptions(self) -> Iterator[Any]:
        """Yield those that an executor serves; `_take` serves the others."""
        return (x for x in super().subscriptions if x.callback is not _no_callback)

    def _handler(self, topic: Topic) -> Callable[[bytes, Mapping[str, Any]], None]:
        name = self.resolve_topic_name(topic.name)
        offered = offered_qos(100 if topic.latched else 1000, topic.latched)
        is_state, is_clock = topic.name == JOINT_STATES, topic.name == CLOCK
        numbering = Numbering()
        arbiter = Arbiter(PATIENCE if is_clock else LAPSE, trusting=True)

        def alone() -> bool:
            return bool(self.count_publishers(topic.name) <= 1)

        def on_message(data: bytes, info: Mapping[str, Any]) -> None:
            number = info.get('publication_sequence_number')
            if number and not numbering.follows(number):
                lost = numbering.lost(number, self.count_publishers(topic.name))
                if lost:
                    self._lose(name, lost)
            if is_state or is_clock:
                instant, said = time.monotonic_ns(), read_stamp(data)
                if is_state:
                    self._heard = instant
                if said is None:
                    arbiter.reject(number, instant, alone)
                elif arbiter.admits(number, instant, alone,
                                    lambda: -_BEHIND <= said - self._time.now <= NANOSECONDS):
                    self._time.note(name, said)
                if self._simulated and is_state:
                    arbiter.lapse = PATIENCE
            if self._simulated is None and (
                    is_state or is_clock or len(self._early) >= _EARLY):
                self._begin(is_clock or self.count_publishers(CLOCK) > 0)
            t = self._time.now if self._simulated else (
                info.get('received_timestamp') or self.get_clock().now().nanoseconds)
            if self._simulated is None:
                self._early.append((name, topic.kind, t, data, offered))
            else:
                self._attempt(self._recording.write, name, topic.kind, t, data, offered)

        return on_message

    def _begin(self, simulated: bool) -> None:
        """Write what came before it could be known whether time is simulated."""
        self._simulated = simulated
        early, self._early = self._early, []
        for name, kind, t, data, offered in early:
            self._attempt(self._recording.write, name, kind,
                          self._time.now if simulated else t, data, offered)

    def _lose(self, topic: str, count: int) -> None:
        """Count messages that never came."""
        self._dropped[topic] += count
        self._recording.note('dropped', str(dict(self._dropped)))
        self.get_logger().error(
            f'{topic}: {count} messages were dropped', throttle_duration_sec=1.0)

    def status(self) -> Status:
        """Return what was recorded."""
        now, lost = time.monotonic(), sum(self._dropped.values())
        rate = (self._received - self._received_before) / max(now - self._reported, 1e-3)
        self._received_before, self._reported = self._received, now
        level, message = DiagnosticStatus.OK, f'recording to {self._recording.path}'
        if self.failure is not None:
            level, message = DiagnosticStatus.ERROR, self.failure
        elif (time.monotonic_ns() - self._heard > _SILENCE and not self._simulated
              and self.count_publishers(JOINT_STATES)):
            level = DiagnosticStatus.WARN
            message = f'{JOINT_STATES}: nothing comes, though it is published'
        elif lost:
            level, message = DiagnosticStatus.ERROR, f'{lost} messages were dropped'
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
        for subscription, handler in self._topics:
            current = subscription.current
            take, kind = current.handle.take_message, current.msg_type
            while (taken := take(kind, True)) is not None:
                data, info = taken
                arrival = info.get('received_timestamp') or 0
                pending.append((arrival, handler, data, info))
                self._received += 1
                if arrival > begin:
                    break
        pending.sort(key=itemgetter(0))
        self._pending = [x for x in pending if x[0] > begin]
        for _, handler, data, info in pending[:len(pending) - len(self._pending)]:
            self._sent = info.get('source_timestamp') or 0
            if self.failure is None:
                handler(data, info)

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
                self.get_logger().warning('asked to end while more came than could be recorded')
                return
            time.sleep(_SLICE)

    def idle(self) -> None:
        """Put what was received onto the disk every so often."""
        now = time.monotonic()
        if self.failure is None and now - self._flushed > _FLUSH:
            self._attempt(self._recording.flush)
            self._flushed = time.monotonic()

    def _attempt(self, action: Callable[..., None], *arguments: Any) -> None:
        """Call what writes to the disk; where that takes no more, let the control loop go on."""
        try:
            action(*arguments)
        except OSError as error:
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


#: What the executable runs.
NODE = RecorderNode

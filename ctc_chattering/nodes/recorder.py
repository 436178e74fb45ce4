"""The recorder as a node: every message of the graph, as it came over the wire, into a bag."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rosbags.interfaces import Qos

from ctc_chattering.core.arbiter import Arbiter
from ctc_chattering.core.grid import NANOSECONDS
from ctc_chattering.core.log_time import LogTime
from ctc_chattering.core.numbering import Numbering
from ctc_chattering.graph import CLOCK, JOINT_STATES, Topic, TOPICS
from ctc_chattering.nodes.inbox import LAPSE, PATIENCE, with_info
from ctc_chattering.nodes.matching import MatchingSubscription
from ctc_chattering.nodes.parameters import NodeParameters
from ctc_chattering.nodes.runtime import NAP, qos, Shell, Status
from ctc_chattering.recording import offered_qos, Recording
from ctc_chattering.settings import RecorderSettings
from ctc_chattering.wire import message_type, read_stamp

#: Messages that DDS keeps for us while we sleep, or the disk does.
_DEPTH = 100_000
#: Between two flushes to the disk [s].
_FLUSH = 0.3
#: Longest time for which messages keep the disk waiting [s].
_BATCH = 0.1
#: How long a message may still be on its way at the end [s].
_SLICE = 0.001
#: How far states may be behind the clock [ns].
_BEHIND = NANOSECONDS // 50
#: So many messages wait until a state or a clock tells what the time is.
_EARLY = 500
#: Without a state of those who publish them, for so long, something is worth a word [ns].
_SILENCE = 3 * NANOSECONDS
#: How long it takes messages that came before the end, while more are to come [ns].
_DRAIN = NANOSECONDS // 5


class RecorderNode(Shell):
    """
    Records all topics of `graph.TOPICS`.

    The log time is the simulated time of the last state received where somebody publishes
    ``clock``, so that a lockstep run plays back with its own timing, and the node clock's time
    of reception otherwise. Publishers number their messages; what is missing in the numbers was
    dropped on the way, and the bag says how much.
    """

    def __init__(self) -> None:
        super().__init__('recorder')
        tuning = NodeParameters(self, (RecorderSettings,), lambda: None)
        self._recording = Recording(Path(tuning.get(RecorderSettings).bag))
        self._received = 0
        #: Whether there was more than could be taken at once.
        self._more = False
        #: When the last message taken was sent [ns], by the system's clock.
        self._sent = 0
        #: When the signal to end was seen, by the same clock.
        self._asked = 0
        self._dropped: Counter[str] = Counter()
        self._flushed = self._reported = time.monotonic()
        self._heard = time.monotonic_ns()
        self._received_before = 0
        self._time = LogTime()
        self._simulated: bool | None = None
        self._early: list[tuple[str, str, int, bytes, list[Qos]]] = []
        for topic in TOPICS.values():
            MatchingSubscription(
                self, message_type(topic.kind), topic.name, self._callback(topic),
                qos(_DEPTH, topic.latched))

    def introduction(self) -> str:
        """Return where the bag is."""
        return f'records {len(TOPICS)} topics to {self._recording.path}; waits for messages'

    def _callback(self, topic: Topic) -> Callable[..., None]:
        name = self.resolve_topic_name(topic.name)
        offered = [offered_qos(100 if topic.latched else 1000, topic.latched)]
        write = self._recording.write
        is_state, is_clock = topic.name == JOINT_STATES, topic.name == CLOCK
        numbering = Numbering()
        arbiter = Arbiter(PATIENCE if is_clock else LAPSE, trusting=True)

        def alone() -> bool:
            return bool(self.count_publishers(topic.name) <= 1)

        def on_message(data: bytes, info: Mapping[str, Any]) -> None:
            self._received += 1
            self._sent = info.get('source_timestamp') or 0
            if self.failure is not None:
                return
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
            t = self._time.now if self._simulated else self.get_clock().now().nanoseconds
            if self._simulated is None:
                self._early.append((name, topic.kind, t, data, offered))
                return
            try:
                write(name, topic.kind, t, data, offered)
            except OSError as error:
                self._give_up(error)

        return with_info(on_message)

    def _begin(self, simulated: bool) -> None:
        """Write what came before it could be known whether time is simulated."""
        self._simulated = simulated
        early, self._early = self._early, []
        try:
            for name, kind, t, data, offered in early:
                self._recording.write(
                    name, kind, self._time.now if simulated else t, data, offered)
        except OSError as error:
            self._give_up(error)

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

    def heed(self) -> None:
        """Leave it to `spin`, which has something to do yet."""

    def spin(self, executor: Any) -> None:
        """Take all that has come, in batches; at the end, all that was sent before it."""
        if not self._more:
            time.sleep(NAP)
        self._more = False
        due = time.monotonic() + _BATCH
        before = -1
        while before < self._received and not self._has_enough():
            before = self._received
            if self.stop:
                self.serve(executor, _SLICE)
            elif time.monotonic() < due:
                executor.spin_once(0.0)
            else:
                self._more = True
                return

    def _has_enough(self) -> bool:
        """Return whether, once asked to end, nothing is left that was sent before, or too much."""
        if not self.stop:
            return False
        now = time.time_ns()
        self._asked = self._asked or now
        if self._sent > self._asked:
            return True
        # When the others have ended, there is time for all that they have sent.
        if now - self._asked < _DRAIN or not self.count_publishers(JOINT_STATES):
            return False
        self.get_logger().warning('asked to end while more came than could be recorded')
        return True

    def idle(self) -> None:
        """Put what was received onto the disk every so often."""
        now = time.monotonic()
        if self.failure is None and now - self._flushed > _FLUSH:
            try:
                self._recording.flush()
            except OSError as error:
                self._give_up(error)
            self._flushed = time.monotonic()

    def _give_up(self, error: OSError) -> None:
        """Stop recording, keep what is on the disk, and let the control loop go on."""
        self.failure = (f'recording has stopped: {error.strerror or error}; what was written '
                        'before is kept, see ctc repair')
        self.get_logger().error(self.failure)
        self._recording.abandon()

    def finish(self) -> None:
        """Close the bag."""
        if self.failure is None:
            self._begin(bool(self._simulated))
        if self.failure is None:
            try:
                self._recording.close()
            except OSError as error:
                self._give_up(error)
        total = sum(self._recording.counts.values())
        lost = sum(self._dropped.values())
        self.get_logger().info(f'{total} messages on {len(self._recording.counts)} topics'
                               + (f', {lost} dropped' if lost else ''))


#: What the executable runs.
NODE = RecorderNode

"""A node that does to a graph what should not be done to it, and listens to what it says."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
import math
import random
import time
from typing import Any

from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ctc_chattering.core.grid import NANOSECONDS
from ctc_chattering.graph import CLOCK, COMMANDS, DIAGNOSTICS, JOINT_STATES, REFERENCE, TOPICS
from ctc_chattering.nodes.runtime import Executor, qos, Shell
from ctc_chattering.ros.messages import message_type, nanoseconds_of, stamp
from ctc_chattering.soak import FLAVOURS, PROCESSES, Report, ROUTE

#: By which the messages of a saboteur are known in a bag.
FRAME = 'saboteur'
#: Messages sent at a time.
_BURST = 4
_MS = 1_000_000


class SaboteurNode(Shell):
    """
    Listens to /diagnostics, publishes what nobody wants, and calls services.

    Parameters
    ----------
    heard : callable
        Called with the name of a process and each of its reports.

    """

    def __init__(self, heard: Callable[[str, Report], None]) -> None:
        super().__init__('saboteur')
        self._heard = heard
        # Raw, because there may be messages that are none.
        self.create_subscription(DiagnosticArray, DIAGNOSTICS, self._on_report, qos(100), raw=True)
        self._setters = {node: self.create_client(SetParameters, f'{node}/set_parameters')
                         for node in PROCESSES}
        self._enabler = self.create_client(SetBool, 'controller/enable')
        self._resetter = self.create_client(Trigger, 'controller/reset')

    def _on_report(self, data: bytes) -> None:
        try:
            message = deserialize_message(data, DiagnosticArray)
            t = nanoseconds_of(message.header.stamp)
            for status in message.status:
                name = status.name.lstrip('/')
                if name in PROCESSES and status.hardware_id == status.name:
                    self._heard(name, Report(
                        t, status.message, {x.key: x.value for x in status.values}))
        except Exception:  # Whatever random bytes lead to.
            return

    def set(self, node: str, name: str, value: object) -> Any:
        """Ask a node to set a parameter; return the future, None without a service."""
        return _call(self._setters[node], SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]))

    def enable(self, value: bool) -> Any:
        """Ask the controller to be enabled or disabled."""
        return _call(self._enabler, SetBool.Request(data=value))

    def reset(self) -> Any:
        """Ask the controller to be reset."""
        return _call(self._resetter, Trigger.Request())

    def intrude(self, topic: str) -> Publisher:
        """Return one more publisher on a topic."""
        return self.create_publisher(message_type(TOPICS[topic].kind), topic, qos(100))


class Saboteur:
    """
    A `SaboteurNode` in this process, spun between other work.

    Parameters
    ----------
    heard : callable
        As `SaboteurNode` takes it.
    names : sequence of str
        The joints.

    """

    def __init__(self, heard: Callable[[str, Report], None], names: Sequence[str]) -> None:
        rclpy.init(args=['saboteur'], signal_handler_options=SignalHandlerOptions.NO)
        self._names = list(names)
        self.node = SaboteurNode(heard)
        self._executor = Executor()
        self._executor.add_node(self.node)
        self._attack: tuple[Publisher, str, tuple[str, ...], random.Random] | None = None

    def look(self) -> None:
        """Serve the graph for a moment, and send some messages of an attack."""
        self.node.spin_in_batches(self._executor)
        if self._attack is not None:
            publisher, topic, flavours, rng = self._attack
            if publisher.get_subscription_count():
                for _ in range(_BURST):
                    message = spoiled(
                        topic, rng.choice(flavours), rng, time.time_ns(), self._names)
                    with suppress(RuntimeError):  # Too long for a type of fixed size.
                        publisher.publish(message)

    def begin(self, topic: str, flavour: str, seed: int) -> None:
        """Send messages of a flavour, of any if it is empty, until `end`."""
        self._attack = (self.node.intrude(topic), topic,
                        (flavour,) if flavour else FLAVOURS[topic], random.Random(seed))

    def end(self) -> None:
        """End the attack."""
        if self._attack is not None:
            self.node.destroy_publisher(self._attack[0])
            self._attack = None

    def close(self) -> None:
        """Leave the graph."""
        self._executor.remove_node(self.node)
        self.node.destroy_node()
        rclpy.try_shutdown()


def spoiled(topic: str, flavour: str, rng: random.Random, now: int, names: Sequence[str]) -> Any:
    """
    Return a message that is wrong in one way, or serialized in no way at all.

    Parameters
    ----------
    topic, flavour : str
        As in `soak.FLAVOURS`, or `soak.PLAUSIBLE`.
    rng : random.Random
        For all that is random.
    now : int
        [ns].
    names : sequence of str
        The joints.

    """
    message = _MAKERS[topic](rng, now, names)
    if flavour == 'bytes':
        return _noise(rng, message, topic != ROUTE)
    spoil = _SPOILERS.get((topic, flavour))
    if spoil is not None:
        spoil(message, rng)
    return message


def _call(client: Any, request: Any) -> Any:
    return client.call_async(request) if client.service_is_ready() else None


def _row(rng: random.Random, n: int, scale: float = 1.0) -> array[float]:
    return array('d', [rng.uniform(-scale, scale) for _ in range(n)])


def _state(rng: random.Random, now: int, names: Sequence[str]) -> JointState:
    n = len(names)
    message = JointState(name=list(names), position=_row(rng, n), velocity=_row(rng, n),
                         effort=_row(rng, n))
    message.header.stamp = stamp(now)
    message.header.frame_id = FRAME
    return message


def _command(rng: random.Random, _now: int, names: Sequence[str]) -> Float64MultiArray:
    message = Float64MultiArray(data=_row(rng, len(names), 50.0))
    message.layout.dim = [MultiArrayDimension(label=x, size=1, stride=1) for x in names]
    return message


def _piece(rng: random.Random, now: int, names: Sequence[str]) -> JointTrajectory:
    n = len(names)
    message = JointTrajectory(joint_names=list(names), points=[
        JointTrajectoryPoint(
            positions=_row(rng, n), velocities=_row(rng, n), accelerations=_row(rng, n),
            time_from_start=Duration(nanosec=k * _MS)) for k in range(10)])
    message.header.stamp = stamp(now)
    message.header.frame_id = FRAME
    return message


def _clock(_rng: random.Random, now: int, _names: Sequence[str]) -> Clock:
    return Clock(clock=stamp(now))


def _report(_rng: random.Random, now: int, _names: Sequence[str]) -> DiagnosticArray:
    message = DiagnosticArray()
    message.header.stamp = stamp(now)
    return message


_MAKERS: Mapping[str, Callable[..., Any]] = {
    JOINT_STATES: _state, COMMANDS: _command, REFERENCE: _piece, ROUTE: _piece, CLOCK: _clock,
    DIAGNOSTICS: _report}


def _wild(rng: random.Random) -> Any:
    """Return a stamp that is not now."""
    now = time.time_ns()
    return stamp(rng.choice((
        0, 1, (2 ** 31 - 1) * NANOSECONDS, -(2 ** 31) * NANOSECONDS, now - 3600 * NANOSECONDS,
        now + 3600 * NANOSECONDS, now + rng.randrange(NANOSECONDS),
        rng.randrange(2 ** 31) * NANOSECONDS)))


def _spoil_rows(*rows: str, bad: Sequence[float] = (math.nan, math.inf, -math.inf)
                ) -> Callable[[Any, random.Random], None]:
    def spoil(message: Any, rng: random.Random) -> None:
        value = rng.choice(bad)
        for name in rows:
            row = getattr(message, name)
            row[rng.randrange(len(row))] = value
    return spoil


def _shorten(*rows: str) -> Callable[[Any, random.Random], None]:
    def spoil(message: Any, rng: random.Random) -> None:
        name = rng.choice(rows)
        setattr(message, name, _row(rng, rng.choice((0, 1, 3, 50))))
    return spoil


def _misname(field: str) -> Callable[[Any, random.Random], None]:
    def spoil(message: Any, rng: random.Random) -> None:
        names = getattr(message, field)
        setattr(message, field, rng.choice((
            [], names[:1], [names[0]] * len(names), ['x', *names[1:]], ['', ''], ['é' * 300])))
    return spoil


def _of_a_point(spoil: Callable[[Any, random.Random], None]
                ) -> Callable[[Any, random.Random], None]:
    return lambda message, rng: spoil(rng.choice(message.points), rng)


def _mislabel(message: Float64MultiArray, rng: random.Random) -> None:
    if rng.random() < 0.5:
        message.layout.dim = message.layout.dim[:1]
    else:
        rng.choice(message.layout.dim).label = 'x'


def _misstamp(message: Any, rng: random.Random) -> None:
    message.header.stamp = _wild(rng)


def _misclock(message: Clock, rng: random.Random) -> None:
    message.clock = _wild(rng)


def _shuffle(message: JointTrajectory, rng: random.Random) -> None:
    rng.shuffle(message.points)


_ROWS = ('positions', 'velocities', 'accelerations')
_SPOILERS: Mapping[tuple[str, str], Callable[[Any, random.Random], None]] = {
    (JOINT_STATES, 'nan'): _spoil_rows(
        'position', 'velocity', bad=(math.nan, math.inf, -math.inf, 1e308)),
    (JOINT_STATES, 'length'): _shorten('position', 'velocity'),
    (JOINT_STATES, 'names'): _misname('name'),
    (JOINT_STATES, 'stamp'): _misstamp,
    (COMMANDS, 'nan'): _spoil_rows('data'),
    (COMMANDS, 'length'): _shorten('data'),
    (COMMANDS, 'names'): _mislabel,
    (REFERENCE, 'nan'): _of_a_point(_spoil_rows(*_ROWS)),
    (REFERENCE, 'length'): _of_a_point(_shorten(*_ROWS)),
    (REFERENCE, 'names'): _misname('joint_names'),
    (REFERENCE, 'stamp'): _misstamp,
    (REFERENCE, 'times'): _shuffle,
    (ROUTE, 'nan'): _of_a_point(_spoil_rows(*_ROWS)),
    (ROUTE, 'length'): _of_a_point(_shorten('positions')),
    (ROUTE, 'names'): _misname('joint_names'),
    (ROUTE, 'times'): _shuffle,
    (CLOCK, 'stamp'): _misclock,
}


def _noise(rng: random.Random, message: Any, changes: bool) -> bytes:
    """Return random bytes, or a message that is cut off, or one with some bytes changed."""
    data = bytearray(serialize_message(message))
    choice = rng.randrange(3 if changes else 2)
    if choice == 0:
        return rng.randbytes(rng.randrange(1, 400))
    if choice == 1:
        return bytes(data[:rng.randrange(1, len(data))])
    for _ in range(rng.randint(1, 8)):
        data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data)

"""
Reading and writing serialized messages of the control loop without message objects.

Converting an object field by field between Python and C takes longer than a control step. The
bytes of the messages (see `cdr`; ``n:`` is a count)::

    JointState         00 01 00 00 | sec nanosec | frame_id | n: name ...
                       | n: position ... | n: velocity ... | n: effort ...
    Float64MultiArray  00 01 00 00 | n: (label | size stride) ... | data_offset | n: data ...
    JointTrajectory    00 01 00 00 | sec nanosec | frame_id | n: joint_names ...
                       | n: (n: positions ... | n: velocities ... | n: accelerations ...
                             | n: effort ... | sec nanosec) ...

A reader has the template of the last message and parses again when strings or counts differ. A
writer has the template of a message that ROS serialized. Nothing is checked but that a message is
as long as its counts say.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from builtin_interfaces.msg import Duration
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.ros.cdr import DOUBLES, STRING, Template, TIME
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

#: Position, velocity and acceleration.
Point = tuple[Sequence[float], Sequence[float], Sequence[float]]


class StateMessage(NamedTuple):
    """A `JointState`: stamp [ns], joint names, positions, velocities and efforts."""

    t: int
    names: tuple[str, ...]
    position: Sequence[float]
    velocity: Sequence[float]
    effort: Sequence[float]


class Efforts(NamedTuple):
    """A `Float64MultiArray` of torques: labels of its dimensions (possibly none) and values."""

    names: tuple[str, ...]
    values: Sequence[float]


class TrajectoryChunk(NamedTuple):
    """A `JointTrajectory`: joint names, times [ns], and (position, velocity, acceleration)."""

    names: tuple[str, ...]
    times: list[int]
    points: list[Point]
    #: Stamp of the message; 0 for now [ns].
    start: int = 0


class StateReader(Template):
    """Deserializes `JointState` messages."""

    layout = TIME, STRING, [STRING], DOUBLES, DOUBLES, DOUBLES

    def read(self, data: bytes) -> StateMessage:
        """Return the content of a message; raise `CtcError` if it is malformed."""
        x = self.unpack(data)
        time, _, names, position, velocity, effort = self.fields
        sec, nanosec = x[time]
        return StateMessage(
            sec * NANOSECONDS + nanosec, names, x[position], x[velocity], x[effort])


class EffortReader(Template):
    """Deserializes `Float64MultiArray` messages."""

    layout = [(STRING, 8)], 4, DOUBLES

    def read(self, data: bytes) -> Efforts:
        """Return the content of a message; raise `CtcError` if it is malformed."""
        x = self.unpack(data)
        names, values = self.fields
        return Efforts(names, x[values])


class TrajectoryReader(Template):
    """Deserializes `JointTrajectory` messages; missing velocities and accelerations are empty."""

    layout = TIME, STRING, [STRING], [
        (DOUBLES, DOUBLES, DOUBLES, DOUBLES, TIME)]

    def read(self, data: bytes) -> TrajectoryChunk:
        """Return the content of a message; raise `CtcError` if it is malformed."""
        x = self.unpack(data)
        time, _, names, points = self.fields
        sec, nanosec = x[time]
        start = sec * NANOSECONDS + nanosec
        times = [start + x[at.start] * NANOSECONDS + x[at.start + 1] for *_, at in points]
        return TrajectoryChunk(names, times, [(x[q], x[dq], x[ddq]) for q, dq, ddq, *_ in points],
                               start)


class _Writer(Template):
    """Serializes messages that differ from `message` in stamp and doubles only."""

    def __init__(self, message: Any) -> None:
        super().__init__()
        self._values = self.parse(bytes(serialize_message(message)))

    def _write(self, rows: Sequence[Sequence[float]], t: int | None = None) -> bytes:
        values = list(self._values)
        if t is not None:
            values[self.fields[0]] = divmod(t, NANOSECONDS)
        for place, row in zip(self.rows, rows):
            values[place] = row
        return self._struct.pack(*values)


class StateWriter(_Writer):
    """Serializes `JointState` messages that have `names` and `fields`, of position to effort."""

    layout = StateReader.layout

    def __init__(self, names: Sequence[str],
                 fields: Sequence[str] = ('position', 'velocity', 'effort')) -> None:
        zeros = [0.0] * len(names)
        super().__init__(JointState(name=list(names), **dict.fromkeys(fields, zeros)))

    def write(self, t: int, *rows: Sequence[float]) -> bytes:
        """Return the message with stamp `t` [ns] and `rows`, each of shape (n,)."""
        return self._write(rows, t)


class EffortWriter(_Writer):
    """Serializes `Float64MultiArray` messages with `names` as labels of the dimensions."""

    layout = EffortReader.layout

    def __init__(self, names: Sequence[str]) -> None:
        message = Float64MultiArray(data=[0.0] * len(names))
        message.layout.dim = [MultiArrayDimension(label=x, size=1, stride=1) for x in names]
        super().__init__(message)

    def write(self, values: Sequence[float]) -> bytes:
        """Return the message with `values`, shape (n,)."""
        return self._write((values,))


class TrajectoryWriter(_Writer):
    """Serializes `JointTrajectory` messages of `count` points, one every `period` [ns]."""

    layout = TrajectoryReader.layout

    def __init__(self, names: Sequence[str], count: int, period: int) -> None:
        zeros = [0.0] * len(names)
        times = [divmod(k * period, NANOSECONDS) for k in range(count)]
        super().__init__(JointTrajectory(joint_names=list(names), points=[
            JointTrajectoryPoint(positions=zeros, velocities=zeros, accelerations=zeros,
                                 time_from_start=Duration(sec=sec, nanosec=nanosec))
            for sec, nanosec in times]))

    def write(self, t: int, points: Sequence[Point]) -> bytes:
        """Return the message whose first point is at `t` [ns]."""
        return self._write([row for point in points for row in point], t)

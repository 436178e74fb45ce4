"""
The desired motion: a sinusoid on every joint, or waypoints, with a smooth start or without.

The sinusoid is the paper's, q_d = center + amplitude sin(2π f t + phase).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from math import cos, pi, sin
from typing import ClassVar

from ctc_chattering.core.blend import Blend, Motion
from ctc_chattering.core.grid import period_ns, seconds
from ctc_chattering.core.model import Vector
from ctc_chattering.core.parameters import Config, parameter
from ctc_chattering.core.trajectory import Point
from ctc_chattering.core.waypoints import Route, Waypoints
from ctc_chattering.errors import CtcError, ParameterError


@dataclasses.dataclass(frozen=True)
class ReferenceConfig(Config):
    """Parameters of the desired motion."""

    title: ClassVar[str] = 'reference'

    joint_names: tuple[str, ...] = parameter(
        'joint_names', 'str[]', ('joint1', 'joint2'), 'Joints of the desired motion.',
        read_only=True)
    center: tuple[float, ...] = parameter(
        'center', 'float[]', (pi, 0.5 * pi), 'Centre of the sinusoid.', unit='rad', shape='n',
        read_only=True)
    amplitude: tuple[float, ...] = parameter(
        'amplitude', 'float[]', 0.5, 'Amplitude of the sinusoid.', unit='rad', shape='n',
        read_only=True)
    frequency: tuple[float, ...] = parameter(
        'frequency', 'float[]', 1.0, 'Frequency of the sinusoid.', unit='Hz', minimum=0.0,
        shape='n', read_only=True)
    phase: tuple[float, ...] = parameter(
        'phase', 'float[]', 0.0, 'Phase of the sinusoid at t = 0.', unit='rad', shape='n',
        read_only=True)
    trajectory_file: str = parameter(
        'trajectory_file', 'str', '',
        'YAML file of waypoints, laid out as trajectory_msgs/JointTrajectory, in place of the '
        'sinusoid; empty for none.', read_only=True)
    start_duration: float = parameter(
        'start_duration', 'float', 0.0,
        'Time over which a smooth start leads from where the robot is into the motion; 0 for '
        'none, as in the paper.', unit='s', minimum=0.0, read_only=True)
    control_period: float = parameter(
        'control_period', 'float', 1e-3, 'Spacing of the points.', unit='s', minimum=0.0,
        exclusive=True, maximum=10.0, read_only=True)

    def validate(self) -> None:
        """Check the period."""
        period_ns(self.control_period)


class Sinusoid:
    """
    The desired motion as a function of time.

    Parameters
    ----------
    config : ReferenceConfig

    """

    def __init__(self, config: ReferenceConfig) -> None:
        self._joints = [
            (c, a, 2.0 * pi * f, p) for c, a, f, p in zip(
                config.center, config.amplitude, config.frequency, config.phase)]

    def at(self, t: float) -> tuple[Vector, Vector, Vector]:
        """Return q_d [rad], dq_d [rad/s] and ddq_d [rad/s²], each of shape (n,), at `t` [s]."""
        q_d, dq_d, ddq_d = [], [], []
        for center, amplitude, omega, phase in self._joints:
            angle = omega * t + phase
            x = amplitude * sin(angle)
            q_d.append(center + x)
            dq_d.append(omega * amplitude * cos(angle))
            ddq_d.append(-omega * omega * x)
        return q_d, dq_d, ddq_d


class _InNanoseconds:
    """A sinusoid over integer nanoseconds."""

    def __init__(self, motion: Sinusoid) -> None:
        self._motion = motion

    def at(self, t: int) -> Point:
        return self._motion.at(seconds(t))


def make_motion(config: ReferenceConfig, route: Route | None = None,
                start: Mapping[str, tuple[float, float]] | None = None, t0: int = 0) -> Motion:
    """
    Return the desired motion that a configuration describes.

    Parameters
    ----------
    config : ReferenceConfig
        Sinusoid or file, and the smooth start.
    route : Route, optional
        The waypoints of its `trajectory_file`, or others in place of the sinusoid.
    start : mapping, optional
        Position [rad] and velocity [rad/s] of the robot at `t0` by joint: where a smooth start
        begins, and the way to a first waypoint after `t0`. A joint that is left out begins on
        the motion.
    t0 : int
        Instant of the start [ns].

    Returns
    -------
    Motion
        Its joints are in the order of `config.joint_names`.

    Raises
    ------
    CtcError
        If the waypoints are not allowed or not given, or `start` is needed and not given.

    """
    names = config.joint_names
    motion: Motion
    if route is not None:
        route = route.ordered(names)
        rest = (0.0,) * len(names)
        first = (route.points[0][0], rest, rest)
        motion = Waypoints(route.times, route.points, None if start is None else (
            t0, _begin(names, start, first)))
    elif config.trajectory_file:
        raise CtcError(f'trajectory_file: {config.trajectory_file} has not been read')
    else:
        motion = _InNanoseconds(Sinusoid(config))
    if not config.start_duration:
        return motion
    if start is None:
        raise ParameterError('start_duration', config.start_duration,
                             '0 where it is not known where the robot is')
    q, dq, ddq = _begin(names, start, motion.at(t0))
    return Blend(motion, t0, q, dq, config.start_duration, ddq)


def _begin(names: Sequence[str], start: Mapping[str, tuple[float, float]], there: Point) -> Point:
    """Return the robot's state, without acceleration, and `there` of joints it does not have."""
    rows = [(*start[name], 0.0) if name in start else row
            for name, row in zip(names, zip(*there))]
    return tuple(zip(*rows))  # type: ignore[return-value]

"""The controller as a node: a joint state in, the torque that answers it out."""

from __future__ import annotations

from math import isfinite
import sys

from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from ctc_chattering import wire
from ctc_chattering.core.controller import Controller, ControllerConfig, Sample
from ctc_chattering.core.grid import period_ns
from ctc_chattering.core.model import Vector
from ctc_chattering.core.trajectory import Trajectory
from ctc_chattering.graph import (
    CLOCK,
    COMMANDS,
    FILTER,
    JOINT_STATES,
    REFERENCE,
    TORQUES,
    TRACKING,
)
from ctc_chattering.nodes.joints import Joints
from ctc_chattering.nodes.parameters import NodeParameters
from ctc_chattering.nodes.runtime import qos, run, Shell
from ctc_chattering.settings import ControllerSettings


class ControllerNode(Shell):
    """
    Answers every joint state with a torque, by the law (2) or (6).

    A state for which there is no reference yet waits for it. A state that comes again is passed
    over; one with an earlier stamp than the last begins a new run.
    """

    def __init__(self) -> None:
        super().__init__('controller')
        self._tuning = NodeParameters(
            self, (ControllerConfig, ControllerSettings), self._on_change)
        config = self._tuning.get(ControllerConfig)
        self._settings = self._tuning.get(ControllerSettings)
        self._controller = Controller(config)
        names = config.joint_names
        self._trajectory = Trajectory()
        period = period_ns(config.control_period)
        self._lags = [period * (i + 1) for i in range(config.input_delay)]
        self._state_joints, self._reference_joints = Joints(names), Joints(names)
        self._state_reader, self._reference_reader = wire.StateReader(), wire.TrajectoryReader()
        self._writer = wire.EffortWriter(names)
        self._tracking_writer = wire.StateWriter(
            [f'{j}/{x}' for x in ('desired', 'error') for j in names], ('position', 'velocity'))
        self._filter_writer = wire.StateWriter(names, ('velocity',))
        self._torque_writer = wire.StateWriter(
            [*(f'{j}/{x}' for x in ('inverse_dynamics', 'compensation', 'chattering')
               for j in names), 'V'], ('effort',))
        self._commands = self.create_publisher(Float64MultiArray, COMMANDS, qos())
        self._tracking, self._filter, self._torques = (
            self.create_publisher(JointState, f'~/{name}', qos())
            for name in (TRACKING, FILTER, TORQUES))
        self._last = -1
        self._count = 0
        self._heard = False
        self._waiting: tuple[int, Vector, Vector] | None = None
        self.create_subscription(
            JointTrajectory, REFERENCE, self._on_reference, qos(), raw=True)
        self.create_subscription(JointState, JOINT_STATES, self._on_state, qos(), raw=True)

    def idle(self) -> None:
        """Answer the state that waits for those who are to hear the answer."""
        if self._waiting is not None:
            self._answer(*self._waiting)

    def _on_change(self) -> None:
        self._settings = self._tuning.get(ControllerSettings)
        self._controller.configure(self._tuning.get(ControllerConfig))

    def _on_reference(self, data: bytes) -> None:
        piece = self._reference_reader.read(data)
        pick = self._reference_joints.pick(piece.names)
        n = len(piece.names)
        if pick is None or not all(len(row) == n for point in piece.points for row in point):
            self.get_logger().warning(
                f'{REFERENCE}: refused a trajectory of joints {list(piece.names)}; needed: '
                'every joint of the controller once, and position, velocity and acceleration',
                throttle_duration_sec=1.0)
            return
        self._trajectory.extend(
            piece.times, [(pick(q), pick(dq), pick(ddq)) for q, dq, ddq in piece.points])
        if self._waiting is not None:
            self._answer(*self._waiting)

    def _on_state(self, data: bytes) -> None:
        t, names, position, velocity, _ = self._state_reader.read(data)
        pick = self._state_joints.pick(names)
        if pick is not None and len(names) == len(position) == len(velocity):
            q, dq = pick(position), pick(velocity)
            if isfinite(sum(q) + sum(dq)):
                if t < self._last:
                    self._restart()
                if t != self._last:
                    self._answer(t, q, dq)
                return
        self.get_logger().warning(
            f'{JOINT_STATES}: refused {list(position)}, {list(velocity)} for joints '
            f'{list(names)}; needed: every joint of the controller once, a finite position and '
            'velocity for each', throttle_duration_sec=1.0)

    def _restart(self) -> None:
        """
        Forget the run before: time has gone back.

        The trajectory stays: what the reference says of the new run may have come first, and has
        replaced what was known from its first instant on.
        """
        self._controller.reset()
        self._last = -1
        self._count = 0
        self._tuning.news = True

    def _answer(self, t: int, q: Vector, dq: Vector) -> None:
        point = self._trajectory.at(t)
        if not self._heard:
            self._heard = self.heard(
                (self._commands, self._tracking, self._filter, self._torques),
                self._settings.wait_for)
        if point is None or not self._heard or self._must_wait(t):
            self._waiting = (t, q, dq)
            return
        self._waiting = None
        self._last = t
        ahead = [x for lag in self._lags if (x := self._trajectory.at(t + lag)) is not None]
        sample = self._controller.step(q, dq, *point, ahead)
        self._commands.publish(self._writer.write(sample.tau))
        if self._count % self._settings.state_decimation == 0:
            self._publish_terms(t, q, sample, point)
            self._trajectory.forget(t)
        self._count += 1
        if self._tuning.news:
            self._tuning.announce(t)

    def _must_wait(self, t: int) -> bool:
        """Return whether the reference lags behind, and time, being simulated, can wait."""
        end = self._trajectory.end
        needed = t + self._lags[-1] if self._lags else t
        return end is not None and needed > end and self.count_publishers(CLOCK) > 0

    def _publish_terms(self, t: int, q: Vector, s: Sample,
                       point: tuple[Vector, Vector, Vector]) -> None:
        self._tracking.publish(self._tracking_writer.write(
            t, (*point[0], *s.e), (*point[1], *s.de)))
        self._filter.publish(self._filter_writer.write(t, s.v))
        self._torques.publish(self._torque_writer.write(t, (
            *s.inverse_dynamics, *(-x for x in s.compensation), *(-x for x in s.chattering),
            self._controller.lyapunov(q, s.v))))


def main() -> int:
    """Run the node."""
    return run(ControllerNode, 'controller')


if __name__ == '__main__':
    sys.exit(main())

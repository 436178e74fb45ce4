"""The simulated robot as a node: torques in, joint states out."""

from __future__ import annotations

from math import isfinite
import sys

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from ctc_chattering import wire
from ctc_chattering.core.grid import NANOSECONDS, period_ns, samples, seconds
from ctc_chattering.core.model import Vector
from ctc_chattering.core.plant import Plant, PlantConfig
from ctc_chattering.graph import CLOCK, COMMANDS, JOINT_STATES
from ctc_chattering.nodes.joints import Joints
from ctc_chattering.nodes.parameters import NodeParameters
from ctc_chattering.nodes.runtime import qos, run, Shell
from ctc_chattering.settings import PlantSettings

#: Periods that one tick of the real-time clock makes good at the most.
_CATCH_UP = 100


class PlantNode(Shell):
    """
    Publishes the robot's state and holds the torques it is sent.

    In lockstep a state is followed by the next one as soon as its answer has come, and time is
    simulated. In real time the node's clock paces it; the robot stands still until the first
    torque comes.
    """

    def __init__(self) -> None:
        super().__init__('plant')
        self._tuning = NodeParameters(self, (PlantConfig, PlantSettings), self._on_change)
        config, self._settings = self._tuning.get(PlantConfig), self._tuning.get(PlantSettings)
        self._plant = Plant(config)
        self._period = period_ns(config.control_period)
        self._last = samples(config.duration, self._period)
        self._clock_every = max(1, round(
            self._settings.clock_period * NANOSECONDS / self._period))
        self._joints = Joints(config.joint_names)
        self._names = config.joint_names
        self._n = len(self._names)
        self._latest: Vector = (0.0,) * self._n
        self._writer = wire.StateWriter(config.joint_names)
        self._reader = wire.EffortReader()
        self._states = self.create_publisher(JointState, JOINT_STATES, qos())
        self._begun = self._held = False
        self._subscribers = [0, 0]
        self._start = 0
        if config.pacing == 'lockstep':
            self._ticker = self.create_publisher(Clock, CLOCK, qos())
            self.create_subscription(
                Float64MultiArray, COMMANDS, self._on_answer, qos(), raw=True)
        else:
            self._ticker = None
            self.create_subscription(
                Float64MultiArray, COMMANDS, self._on_command, qos(), raw=True)
            self.create_timer(seconds(self._period), self._on_tick)

    def idle(self) -> None:
        """Begin once all are there; repeat the last message for those who came late."""
        if self._ticker is None:
            return
        counts = [p.get_subscription_count() for p in (self._states, self._ticker)]
        if not self._begun:
            if counts[0] and self.heard((self._states, self._ticker), self._settings.wait_for):
                self._begun = True
                self._publish_sample()
        else:
            if counts[1] > self._subscribers[1]:
                self._publish_clock()
            if counts[0] > self._subscribers[0] and not self._held:
                self._publish_state()
        self._subscribers = counts

    def _on_change(self) -> None:
        self._settings = self._tuning.get(PlantSettings)
        self._plant.configure(self._tuning.get(PlantConfig))
        if self._held:
            self._held = False
            self._publish_sample()

    # Lockstep.

    def _on_answer(self, data: bytes) -> None:
        tau = self._torques(data)
        if tau is None or not self._begun or self._held:
            return
        if self._plant.k == self._last and self._last:
            self._end()
            return
        self._plant.step(tau)
        self._publish_sample()

    def _publish_sample(self) -> None:
        hold = self._settings.hold_at
        if hold and self._plant.t >= hold:
            self._held = True
            self._publish_clock()
            return
        self._publish_state()
        if self._plant.k % self._clock_every == 0 or self._plant.k == self._last:
            self._publish_clock()
        if self._tuning.news:
            self._tuning.announce(self._plant.k * self._period)

    def _publish_clock(self) -> None:
        assert self._ticker is not None
        self._ticker.publish(Clock(clock=wire.stamp(self._plant.k * self._period)))

    # Real time.

    def _on_command(self, data: bytes) -> None:
        tau = self._torques(data)
        if tau is None:
            return
        if not self._begun:
            self._begun = True
            self._start = self.get_clock().now().nanoseconds
            self._tuning.announce(self._start)
        self._latest = tau

    def _on_tick(self) -> None:
        now = self.get_clock().now().nanoseconds
        if not self._begun:
            self._start = now
        else:
            due = (now - self._start) // self._period - self._plant.k
            for _ in range(min(due, _CATCH_UP)):
                if self._plant.k == self._last and self._last:
                    self._end()
                    return
                self._plant.step(self._latest)
            if due > _CATCH_UP:
                self._start = now - self._plant.k * self._period
            if self._tuning.news:
                self._tuning.announce(self._start + self._plant.k * self._period)
            if due < 1:
                return
        self._publish_state()

    # Both.

    def _publish_state(self) -> None:
        plant = self._plant
        self._states.publish(self._writer.write(
            self._start + plant.k * self._period, *plant.measured, plant.applied))

    def _torques(self, data: bytes) -> Vector | None:
        """Return the torques of a message in our order; None for one that is no answer."""
        names, values = self._reader.read(data)
        names = names or self._names
        pick = self._joints.pick(names)
        if pick is not None and len(values) == len(names):
            tau = pick(values)
            if isfinite(sum(tau)):
                return tau
        self.get_logger().warning(
            f'{COMMANDS}: refused {list(values)} for joints {list(names)}; needed: '
            f'{self._n} finite torques, labelled with the joint names or not at all',
            throttle_duration_sec=1.0)
        return None

    def _end(self) -> None:
        if not self.done.done():
            self.get_logger().info(
                f'the experiment has ended at t = {self._plant.t:g} s after '
                f'{self._plant.k + 1} samples')
            self.done.set_result(None)


def main() -> int:
    """Run the node."""
    return run(PlantNode, 'plant')


if __name__ == '__main__':
    sys.exit(main())

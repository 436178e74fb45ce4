"""The tests' own node keeps up with what it listens to."""

from processes import probe
import pytest
from sensor_msgs.msg import JointState


@pytest.mark.ros
def test_what_waits_is_heard_in_few_turns() -> None:
    """By itself an executor takes one message a turn."""
    turns = 0
    with probe() as it:
        heard = it.listen(JointState, 'joint_states')
        publisher = it.node.create_publisher(JointState, 'joint_states', 1000)
        it.until(publisher.get_subscription_count, 'the subscription')

        def all_heard() -> bool:
            nonlocal turns
            turns += 1
            return len(heard) == 500

        for _ in range(500):
            publisher.publish(JointState(name=['joint1']))
        it.until(all_heard, 'all')
    assert turns < 100

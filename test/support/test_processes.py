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

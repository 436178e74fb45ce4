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

"""The services of the reference: stop and hold, and home."""

from __future__ import annotations

from controller_process import ReferenceUnderTest
import numpy as np
from processes import CONFIG, probe
import pytest
from ros_messages import MS
from std_srvs.srv import Trigger

pytestmark = pytest.mark.ros
S = 1000 * MS
PANDA = ('--params-file', str(CONFIG / 'panda.yaml'), '-p', 'start_duration:=0.0')


def test_a_stop_holds_where_the_motion_comes_to_rest_and_home_leads_to_its_start() -> None:
    """Home asks for a stop first. Links are checked, and joints stay within 0.5 rad/s."""
    with probe() as it:
        node = ReferenceUnderTest(it, *PANDA)
        refused = it.call(Trigger, '/reference/stop', Trigger.Request())
        assert not refused.success and 'has not begun' in refused.message
        node.run_to(2 * S)
        home = list(node.points[0].positions)
        stop = it.call(Trigger, '/reference/stop', Trigger.Request())
        assert stop.success and 'It rests in 0.' in stop.message
        node.run_to(4 * S)
        held = node.points[max(node.points)]
        assert not any(held.velocities) and list(held.positions) != home
        going = it.call(Trigger, '/reference/home', Trigger.Request())
        assert going.success and 'The nearest approach' in going.message, going.message
        begin = node.now
        node.run_to(begin + 6 * S)
        times = sorted(t for t in node.points if t >= begin)
        dq = np.array([node.points[t].velocities for t in times])
        assert list(node.points[times[-1]].positions) == pytest.approx(home, abs=1e-12)
        assert not dq[-1].any()
        assert 0.02 < np.abs(dq).max() <= 0.5 * 1.001


def test_home_from_a_motion_stops_it_first() -> None:
    with probe() as it:
        node = ReferenceUnderTest(it, '-p', 'control_period:=0.01')
        node.run_to(2 * S)
        home = list(node.points[0].positions)
        response = it.call(Trigger, '/reference/home', Trigger.Request())
        assert response.success and response.message.endswith('Then it goes home.')
        node.run_to(9 * S)
        assert list(node.points[max(node.points)].positions) == pytest.approx(home, abs=1e-12)
        it.until_said('The motion goes home.', 'Links were not checked for collisions')

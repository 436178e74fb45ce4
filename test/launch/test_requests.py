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

"""Events of bringup on a real graph, with the test as the node that is asked."""

from __future__ import annotations

from ctc_chattering.launch.requests import graph_monitor
from ctc_chattering.simulation.closed_loop import Event
from processes import probe
import pytest
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

pytestmark = pytest.mark.ros


def test_an_event_is_asked_for_again_where_no_answer_comes() -> None:
    """The middleware drops an answer to a client that the server has not met yet."""
    asked: list[tuple[str, object]] = []

    async def answer(request: SetParameters.Request, response: SetParameters.Response
                     ) -> SetParameters.Response:
        asked.extend((x.name, parameter_value_to_python(x.value)) for x in request.parameters)
        if len(asked) == 1:
            await Future()  # For ever.
        response.results = [SetParametersResult(successful=True) for _ in request.parameters]
        return response

    with probe() as it:
        it.node.create_service(SetParameters, '/controller/set_parameters', answer,
                               callback_group=ReentrantCallbackGroup())
        events = [Event(0.0, 'controller', {'lambda': x}) for x in (7.0, 8.0)]
        with graph_monitor(events, lockstep=False, ros_args=()) as monitor:
            def carried_out() -> bool:
                monitor.look()
                return len(asked) == 3
            it.until(carried_out, 'the events')
    assert asked == [('lambda', 7.0), ('lambda', 7.0), ('lambda', 8.0)]

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

"""
Learning filters for the law of the controller.

The controller announces its parameters, and a filter follows from them. That takes up to a second,
so that another thread computes it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from ctc_chattering.configuration.topics import PARAMETERS, ROBOT_DESCRIPTION
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import as_ctc_error
from ctc_chattering.learning.design import filter_for
from ctc_chattering.learning.learned_file import LIMITS, read_correction
from ctc_chattering.learning.learner import MAX_MOTIONS
from ctc_chattering.learning.learning_filter import LearningFilter
from ctc_chattering.learning.motion import RepeatedMotion
from ctc_chattering.ros.parameters import CHANGES
from ctc_chattering.ros.subscription import qos
from ctc_chattering.trajectory.reference import ReferenceConfig
from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from std_msgs.msg import String

#: Parameters after whose change what was learned is still a good beginning.
_PAYLOAD = {'payload_mass', 'payload_center'}


class ControllerLaw:
    """
    Learning filters for the controller's law.

    Parameters
    ----------
    node : Node
        The reference node.
    reference : ReferenceConfig
        Its parameters.
    waits : callable
        Returns whether `filter_of` may block until the filter is ready, as in simulated time.
    on_change : callable
        Called when the law has become another one.

    """

    def __init__(self, node: Node, reference: ReferenceConfig, waits: Callable[[], bool],
                 on_change: Callable[[], None]) -> None:
        self._reference = reference
        self._waits = waits
        self._on_change = on_change
        #: Parameters of the law, empty before they are known, and the robot's description.
        self._values: Mapping[str, Any] = {}
        self._description = ''
        #: Filters by the motion's name.
        self._filters: dict[str, Future[LearningFilter]] = {}
        self._worker = ThreadPoolExecutor(1)
        #: Name of the motion whose correction is from a file for the present law, or ''.
        self.learned_motion = ''
        node.create_subscription(
            ParameterEvent, f'controller/{PARAMETERS}', self._on_parameters,
            qos(CHANGES, latched=True))
        node.create_subscription(
            String, f'controller/{ROBOT_DESCRIPTION}',
            lambda message: self._update(self._values, message.data), qos(1, latched=True))

    def refusal(self, motion: RepeatedMotion) -> str:
        """
        Start the computation of a motion's filter.

        Returns why it failed, '' if it has not.
        """
        future = self._start(motion)
        error = future.exception() if future and future.done() else None
        return str(error or '')

    def filter_of(self, motion: RepeatedMotion) -> LearningFilter | None:
        """
        Return the filter for a motion.

        It is None while it is computed, or the law is not known.
        """
        future = self._start(motion)
        return future.result() if future and (self._waits() or future.done()) else None

    def _start(self, motion: RepeatedMotion) -> Future[LearningFilter] | None:
        """Have a filter computed, once the law is known."""
        if self._values and motion.name not in self._filters:
            if len(self._filters) == MAX_MOTIONS:
                self._filters.pop(next(iter(self._filters))).cancel()
            self._filters[motion.name] = self._worker.submit(
                self._compute, motion, self._values, self._description)
        return self._filters.get(motion.name)

    def _compute(self, motion: RepeatedMotion, values: Mapping[str, Any], description: str
                 ) -> LearningFilter:
        """
        Return a filter, or raise `CtcError`.

        Values that name code are refused.
        """
        config = ControllerConfig.received(values)
        if motion.name == self.learned_motion:
            path = Path(self._reference.learning_file)
            read_correction(path, motion, self._reference, config, description)
        with as_ctc_error('learning'):
            return filter_for(motion, self._reference, config, model_of(config, description))

    def _on_parameters(self, event: ParameterEvent) -> None:
        of_law = ControllerConfig.parameters().keys() - LIMITS
        values = {item.name: parameter_value_to_python(item.value)
                  for item in (*event.new_parameters, *event.changed_parameters)
                  if item.name in of_law}
        self._update(values if event.new_parameters else {**self._values, **values},
                     self._description)

    def _update(self, values: Mapping[str, Any], description: str) -> None:
        """Take the law, and forget filters of another one."""
        before, described = self._values, self._description
        if (before, described) == (values, description):
            return
        self._values, self._description = values, description
        for future in self._filters.values():
            future.cancel()
        self._filters.clear()
        is_other = any(value != values.get(name) for name, value in before.items()
                       if name not in _PAYLOAD)
        if is_other or (described and described != description):
            self.learned_motion = ''
            self._on_change()

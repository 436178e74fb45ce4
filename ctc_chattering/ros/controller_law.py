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
The controller's law as the reference node needs it: the learning filters for it.

The law is that of the controller's parameters in force, which it announces. A filter takes up to a
second, and another thread computes it.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from ctc_chattering.configuration.topics import PARAMETERS, ROBOT_DESCRIPTION
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import as_ctc_error, CtcError
from ctc_chattering.learning.design import filter_for
from ctc_chattering.learning.learning_filter import LearningFilter
from ctc_chattering.learning.motion import RepeatedMotion
from ctc_chattering.ros.parameters import CHANGES
from ctc_chattering.ros.subscription import qos
from ctc_chattering.trajectory.reference import ReferenceConfig
from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from std_msgs.msg import String

#: Parameters that change neither the law nor what its filter is computed from.
_OF_LIMITS = ('effort_limit', 'effort_rate_limit', 'anti_windup', 'error_limit')


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
        Tells whether `filter_of` waits for a filter, as in simulated time.
    on_change : callable
        Called when the law has become another one.

    """

    def __init__(self, node: Node, reference: ReferenceConfig, waits: Callable[[], bool],
                 on_change: Callable[[], None]) -> None:
        self._reference = reference
        self._waits = waits
        self._on_change = on_change
        self._values: dict[str, Any] = {}
        self._config: ControllerConfig | None = None
        #: Why the parameters are not those of a law that is known.
        self._problem = ''
        self._description = ''
        #: Filters by the motion's name.
        self._filters: dict[str, Future[LearningFilter]] = {}
        self._worker = ThreadPoolExecutor(1)
        node.create_subscription(
            ParameterEvent, f'controller/{PARAMETERS}', self._on_parameters,
            qos(CHANGES, latched=True))
        node.create_subscription(
            String, f'controller/{ROBOT_DESCRIPTION}', self._on_description,
            qos(1, latched=True))

    def refusal(self, motion: RepeatedMotion | None) -> str:
        """Have the filter for a motion computed, and return why there is none, if so."""
        future = None if motion is None else self._start(motion)
        if future is None or not future.done():
            return self._problem
        error = future.exception()
        return '' if error is None else str(error)

    def filter_of(self, motion: RepeatedMotion) -> LearningFilter | None:
        """Return the filter for a motion, None while it is not known."""
        future = self._start(motion)
        if future is None or not (self._waits() or future.done()):
            return None
        return future.result()

    def _start(self, motion: RepeatedMotion) -> Future[LearningFilter] | None:
        """Have a filter computed, if the law is known."""
        config = self._config
        if config is None or (config.described and not self._description):
            return None
        if motion.name not in self._filters:
            self._filters[motion.name] = self._worker.submit(
                self._compute, motion, config, self._description)
        return self._filters[motion.name]

    def _compute(self, motion: RepeatedMotion, config: ControllerConfig, description: str
                 ) -> LearningFilter:
        with as_ctc_error('learning'):
            return filter_for(motion, self._reference, config, model_of(config, description))

    def _on_parameters(self, event: ParameterEvent) -> None:
        previous, self._config, self._problem = self._config, None, ''
        values = {} if event.new_parameters else self._values
        changes = {item.name: parameter_value_to_python(item.value)
                   for item in (*event.new_parameters, *event.changed_parameters)
                   if item.name in ControllerConfig.parameters()}
        self._values = values | changes
        try:
            self._config = ControllerConfig.received(self._values)
        except CtcError as error:
            self._problem = f'learning: {error}'
        if previous is not None and (
                self._config is None or not _is_same_law(previous, self._config)):
            self._forget()

    def _on_description(self, message: String) -> None:
        previous, self._description = self._description, message.data
        if previous not in ('', message.data):
            self._forget()

    def _forget(self) -> None:
        """Forget the filters of another law."""
        self._filters.clear()
        self._on_change()


def _is_same_law(one: ControllerConfig, other: ControllerConfig) -> bool:
    """Return whether two configurations give the same law."""
    values = other.as_mapping()
    return all(value == values[name] for name, value in one.as_mapping().items()
               if name == 'law' or (name not in _OF_LIMITS and other.takes(name)))

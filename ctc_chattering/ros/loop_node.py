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
The base of plant, controller and reference.

They have the parameters of a `NodeConfig`, and begin with the robot's description, from a file or
from its topic.
"""

from __future__ import annotations

from typing import Any, cast, Generic, TypeVar

from ctc_chattering.configuration.loop_setup import Values
from ctc_chattering.configuration.node_parameters import NODES
from ctc_chattering.configuration.package_share import read_description
from ctc_chattering.configuration.topics import ROBOT_DESCRIPTION, TOPICS
from ctc_chattering.errors import CtcError
from ctc_chattering.parameters import Config
from ctc_chattering.ros.node import BaseNode
from ctc_chattering.ros.parameters import NodeParameters
from ctc_chattering.ros.subscription import compatible, MatchingSubscription, qos
from rclpy.publisher import Publisher
from std_msgs.msg import String

C = TypeVar('C', bound=Config)


class LoopNode(BaseNode, Generic[C]):
    """
    A node with the parameters of `C`, a `NodeConfig`.

    A subclass calls `find_description` at the end of its construction.

    Parameters
    ----------
    name : str
        Of the executable.
    values : mapping, optional
        As `BaseNode` takes them.

    Attributes
    ----------
    parameters : NodeParameters
        Of the node.
    problem : str
        Problem with the robot's description: it has not come, or was refused. '' if all is well.

    """

    def __init__(self, name: str, values: Values | None) -> None:
        super().__init__(name, values)
        self.parameters = NodeParameters(self, NODES[name])
        self.problem = ''

    @property
    def config(self) -> C:
        """Return the configuration in force."""
        config: C = self.parameters.config
        return config

    def begin(self, description: str) -> None:
        """Begin with a robot, whose description may be empty."""

    def matched(self, *publishers: Publisher) -> bool:
        """
        Return whether all readers of `publishers` are matched.

        Those are the subscribers, and the nodes in the parameter `wait_for` that read the topic,
        by `TOPICS`.
        """
        for publisher in publishers:
            infos = [
                info for info in self.get_subscriptions_info_by_topic(publisher.topic_name)
                if compatible(publisher.qos_profile, info.qos_profile)]
            if publisher.get_subscription_count() < len(infos):
                return False
            awaited = set(cast(Any, self.config).wait_for) - {info.node_name for info in infos}
            for topic in TOPICS.values():
                if publisher.topic_name.endswith('/' + topic.name) and awaited & set(
                        topic.readers):
                    return False
        return True

    def find_description(self) -> None:
        """
        Call `begin` once the description is known.

        It comes from a file, or on its topic.

        A text from the topic that is refused is reported, and the next one waited for.

        Raises
        ------
        CtcError
            If the file cannot be read or is refused.

        """
        config = cast(Any, self.config)
        if not config.described or config.description:
            self.begin(read_description(config.description) if config.described else '')
            return
        self.problem = f'waiting for {ROBOT_DESCRIPTION}'
        self.get_logger().info(self.problem)
        MatchingSubscription(self, String, ROBOT_DESCRIPTION, self._on_description,
                             qos(1, latched=True), raw=False)

    def _on_description(self, message: String) -> None:
        if not self.problem:
            return
        try:
            self.begin(message.data)
        except CtcError as error:
            self.problem = f'{ROBOT_DESCRIPTION}: {error}'
            self.get_logger().error(self.problem)
            return
        self.problem = ''
        self.get_logger().info(f'{ROBOT_DESCRIPTION} has come')

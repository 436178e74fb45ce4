"""The robot's description for a node: from a file at once, from a topic when it comes."""

from __future__ import annotations

from collections.abc import Callable

from ctc_chattering.configuration.robot_description import read_description
from ctc_chattering.errors import CtcError
from ctc_chattering.ros.matching import MatchingSubscription
from ctc_chattering.ros.node import qos
from ctc_chattering.ros.topics import ROBOT_DESCRIPTION
from rclpy.node import Node
from std_msgs.msg import String


class Description:
    """
    Hands over the description once.

    Parameters
    ----------
    node : Node
        Who needs it.
    needed : bool
        Whether it does; if not, an empty text is handed over.
    location : str
        As `read_description` takes it; empty for the topic.
    use : callable
        Called with the text; from the topic, a text that it refuses with `CtcError` is reported,
        and the next one waited for.

    Attributes
    ----------
    problem : str
        What is wrong: that it has not come, or why it was refused; empty when all is well.

    Raises
    ------
    CtcError
        If the file cannot be read or is refused.

    """

    def __init__(self, node: Node, needed: bool, location: str, use: Callable[[str], None]
                 ) -> None:
        self.problem = ''
        self._node, self._use = node, use
        if not needed or location:
            use(read_description(location) if needed else '')
            return
        self.problem = f'waiting for {ROBOT_DESCRIPTION}'
        node.get_logger().info(self.problem)
        MatchingSubscription(node, String, ROBOT_DESCRIPTION, self._on_description,
                             qos(1, latched=True), raw=False)

    def _on_description(self, message: String) -> None:
        if not self.problem:
            return
        try:
            self._use(message.data)
        except CtcError as error:
            self.problem = f'{ROBOT_DESCRIPTION}: {error}'
            self._node.get_logger().error(self.problem)
            return
        self.problem = ''
        self._node.get_logger().info(f'{ROBOT_DESCRIPTION} has come')

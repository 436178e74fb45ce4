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
The base of all nodes: parameters and reports.

`ros/spinning.py` serves a node, `ros/run_node.py` runs it as a process.
"""

from __future__ import annotations

from collections.abc import Mapping
import signal
from typing import Any

from ctc_chattering.configuration.loop_setup import Values
from ctc_chattering.configuration.parameter_file import OF_ROS
from ctc_chattering.configuration.topics import DIAGNOSTICS, TOPICS
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.ros.parameters import TolerantParameterService
from ctc_chattering.ros.reports import diagnostics, ENDED, ERROR, full_report, OK, Status
from ctc_chattering.ros.spinning import SpinningNode
from ctc_chattering.ros.subscription import qos, ValidatedSubscription
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.parameter import Parameter as RosParameter

#: Time between two messages on /diagnostics [ns].
_REPORT_PERIOD_NS = NANOSECONDS


class BaseNode(SpinningNode):
    """
    A node with parameters that reports on ``/diagnostics``.

    Parameters
    ----------
    name : str
    values : mapping, optional
        Values of its parameters. The others have their defaults.

    Attributes
    ----------
    given : mapping
        `values`.
    inputs : list of ValidatedSubscription
        The topics that it obeys, for the report.
    failure : str or None
        Set it to have the process end with status 1.
    urgent : list of Service
        Services whose requests are served before any for parameters.
    parameter_service : TolerantParameterService
        Takes requests to set parameters.

    """

    def __init__(self, name: str, values: Values | None = None) -> None:
        self.given = dict(values or {})
        super().__init__(name, start_parameter_services=False, parameter_overrides=[
            RosParameter(x, value=self.given[x]) for x in OF_ROS if x in self.given])
        self.urgent: list[Any] = []
        self.parameter_service = TolerantParameterService(self)
        self.failure: str | None = None
        self.inputs: list[ValidatedSubscription[Any]] = []
        self._report_due = 0
        self._diagnostics = self.create_publisher(
            DiagnosticArray, DIAGNOSTICS, qos(TOPICS[DIAGNOSTICS].depth))

    def on_change(self) -> None:
        """Take the parameters that have been set."""

    def check(self, config: Any) -> None:
        """Raise `CtcError` if a configuration is not allowed."""

    def completed(self, _values: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return parameters that are set with others, by name."""
        return {}

    def status(self) -> Status:
        """Return the node's own report, without statistics and refused messages."""
        return Status(OK, 'running', {})

    def introduction(self) -> str:
        """Return the node's first line in the log."""
        return 'runs'

    def report(self, now: int) -> None:
        """Publish a report once a second, at `now` [ns]."""
        if now < self._report_due:
            return
        self._report_due = max(
            self._report_due + _REPORT_PERIOD_NS, now + _REPORT_PERIOD_NS // 2)
        self.statistics.rotate(now)
        self._diagnostics.publish(diagnostics(self, self._full_report()))

    def report_soon(self) -> None:
        """Have the next turn publish a report."""
        self._report_due = 0

    def report_end(self, why: str = '') -> None:
        """
        Publish on ``/diagnostics`` that the node ends, and why.

        By default that is its failure, the signal that has come, or the result of `done`.
        """
        signals = [signal.Signals(number).name for number in self.stop]
        result = self.done.result() if self.done.done() else None
        why = why or self.failure or ', '.join(signals) or str(result or 'done')
        level = ERROR if self.failure else OK
        values = {**self._full_report().values, ENDED: why}
        status = Status(level, f'the node ended: {why}', values)
        self._diagnostics.publish(diagnostics(self, status))

    def _full_report(self) -> Status:
        return full_report(self, self.status(), self.statistics, self.inputs)

    def finish(self) -> None:
        """Do what must be done before the node goes."""

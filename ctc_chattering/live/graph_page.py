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

"""The page of a running graph."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
import os
from pathlib import Path
from queue import Empty, SimpleQueue
import time
from typing import Any

from ctc_chattering.analysis.markup import fragment, Markup
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import CtcError
from ctc_chattering.live.arm_view import View
from ctc_chattering.live.controls import Controls
from ctc_chattering.live.graph_arm import GraphArm
from ctc_chattering.live.graph_commands import GraphCommands
from ctc_chattering.live.graph_plots import GraphPlots
from ctc_chattering.live.graph_reader import GraphReader
from ctc_chattering.live.health import counted, light, NodeReport, SILENT
from ctc_chattering.live.law_panel import LawPanel
from ctc_chattering.live.page import Page
from ctc_chattering.live.samples import table
from ctc_chattering.ros.exit_deadline import end_after
from ctc_chattering.ros.fastdds import use_profile
from ctc_chattering.ros.node import Executor
from ctc_chattering.ros.security import check_security
import rclpy
from rclpy.signals import SignalHandlerOptions

#: Between two pictures of the arm, two of the numbers and the light, and two of the plots [s].
_FRAME, _NUMBERS = 1 / 30, 0.2
#: Between two questions for the parameters, where they did not come by themselves [s].
_ASK = 2.0
#: Time for callbacks in each frame [s].
_SERVE = 0.001
#: What is left out of the tables of the nodes' reports.
_LONG = 'histogram'
_REPORTS = """{% for name, report in reports %}<div style="padding:2px 12px;font-size:0.8em">
<b>{{ name }}</b>: {{ report.message }}<table class="ctc-reports" style="width:100%">
{%- for key, value in report.values.items() if long not in key %}
<tr><td>{{ key }}</td><td style="overflow-wrap:anywhere">{{ value }}</td></tr>
{%- endfor %}</table></div>{% endfor %}"""
_SUMMARY = """<div class="ctc-law">law <b>{{ law }}</b>, period {{ period }} ms</div>
<div>{{ counts }}</div>"""
#: How long the middleware may take to leave the graph [s]: Fast DDS hangs now and then.
_LEAVE = 0.5


class GraphPage:
    """
    Shows a graph, and carries out what is asked on the page.

    Parameters
    ----------
    page : Page
    reader : GraphReader
    bags : Path
        Where bags are recorded.
    ros_args : sequence of str
        Arguments for ROS of the recorder.
    controls : bool
        Whether the page has any.

    """

    def __init__(self, page: Page, reader: GraphReader, bags: Path, ros_args: Sequence[str] = (),
                 controls: bool = True) -> None:
        self._page, self._reader = page, reader
        self._executor = Executor()
        self._executor.add_node(reader)
        self._clicks: SimpleQueue[tuple[Any, ...]] = SimpleQueue()
        self._commands = GraphCommands(reader, bags, ros_args, self._show_answer)
        self._controls: Controls | None = None
        self._panel = LawPanel(self._click) if controls else None
        if self._panel is not None:
            page.samples.on('ask', self._panel.receive)
        self._plots = GraphPlots(page.samples, reader)
        self._arm = GraphArm(page, reader)
        self._made_of: Any = None
        self._due = {'numbers': 0.0, 'parameters': 0.0}
        with page.main:
            self._view = View(page.server.gui, partial(self._click, 'fit'))

    def _click(self, *command: Any) -> None:
        """Have `update` carry out a word with its arguments; from any thread."""
        self._clicks.put(command)

    def run(self, stop: Sequence[int]) -> None:
        """Serve until a signal is in `stop`."""
        try:
            while not stop:
                begin = time.monotonic()
                self.update(begin)
                time.sleep(max(0.2 * _FRAME, begin + _FRAME - time.monotonic()))
            self.update(time.monotonic())  # How a graph has ended, with which this page ends.
        finally:
            self._commands.recording.close()
            self._executor.remove_node(self._reader)

    def update(self, now: float) -> None:
        """Take what has come, carry out what was clicked, and show what is due."""
        self._reader.poll()
        self._reader.serve(self._executor, _SERVE)
        while True:
            try:
                self._carry_out(*self._clicks.get_nowait())
            except Empty:
                break
        self._commands.poll()
        self._make(now)
        self._plots.update(now)
        if not self._page.watched:
            return
        with self._page.server.atomic():
            self._arm.show(self._view.magnified, now)
            self._page.cameras.follow()
            if self._is_due('numbers', now, _NUMBERS):
                self._show_numbers()

    def _is_due(self, what: str, now: float, period: float) -> bool:
        if now < self._due[what]:
            return False
        self._due[what] = now + period
        return True

    def _make(self, now: float) -> None:
        """Make the parts of the page that depend on the robot, when it is known or changes."""
        config, description = self._reader.config, self._reader.description
        if config is None:
            if self._reader.incomplete and self._is_due('parameters', now, _ASK):
                self._commands.requests.get('controller', list(ControllerConfig.parameters()),
                                            self._take_parameters)
            return
        made_of = config.model, config.joint_names, config.locked, description
        if made_of == self._made_of:
            return
        self._made_of = made_of
        self._arm.make(config, description, now)
        if self._controls is not None:
            self._controls.remove()
        if self._panel is not None:
            with self._page.main:
                self._controls = Controls(
                    self._page.server.gui, config.joint_names, self._click)

    def _take_parameters(self, values: Mapping[str, Any]) -> None:
        with suppress(CtcError):  # Of a controller that is not ours.
            self._reader.take_parameters('controller', values)

    def _show_numbers(self) -> None:
        reader = self._reader
        reports = reader.reports()
        horizon = reader.parameters['reference'].get('horizon')
        patience = 0.5 * horizon if isinstance(horizon, int | float) else 0.0
        self._page.show_light(
            light(reports, reader.silence(), reader.simulated, {'reference': SILENT + patience},
                  time.time()), self._summary(reports))
        instant = reader.instant()
        if instant is not None:
            self._page.numbers.content = str(table(
                reader.names, instant, reader.samples(), since=reader.start))
        self._page.reports.content = str(fragment(
            _REPORTS, reports=sorted(reports.items()), long=_LONG))
        if self._controls is not None:
            self._controls.update(reader.parameters)
        if self._panel is not None:
            self._page.samples.tell(controls=self._panel.state(
                reader.names, reader.parameters['controller'], self._commands.recording.shown()))

    def _summary(self, reports: Mapping[str, NodeReport]) -> Markup:
        """Return law, switching, period, misses and refused messages."""
        config = self._reader.config
        if config is None:
            return fragment('<div>domain {{ domain }}</div>',
                            domain=os.environ.get('ROS_DOMAIN_ID', '0'))
        switching = f', {config.switching}' if config.takes('switching') else ''
        counts = '; '.join(f'{name} {misses} misses, {refused} refused' for name, misses, refused
                           in (counted(name, report) for name, report in reports.items()
                               if name != 'bringup'))
        return fragment(_SUMMARY, law=config.law + switching, counts=counts,
                        period=f'{1e3 * config.control_period:g}')

    def _show_answer(self, what: str, done: bool, answer: str) -> None:
        if self._panel is not None:
            self._panel.answer(what, done, answer)

    def _carry_out(self, what: str, *arguments: Any) -> None:
        if what == 'fit':
            self._arm.look()
            self._page.cameras.fit(*(event.client for event in arguments))
        else:
            self._commands.carry_out(what, *arguments)


def run_graph_page(make_page: Callable[[], Page], stop: Sequence[int], ros_args: Sequence[str],
                   controls: bool = True, bags: Path = Path()) -> None:
    """
    Serve the page of a running graph until a signal comes.

    Parameters
    ----------
    make_page : callable
        Called when ROS is up.
    stop : sequence of int
        Fills with the signals.
    ros_args : sequence of str
        Arguments for ROS, such as a namespace.
    controls : bool
        Whether the page has any.
    bags : Path
        Where the page records bags.

    Raises
    ------
    CtcError
        If ROS cannot start, or the port is taken.

    """
    check_security()
    use_profile()
    try:
        rclpy.init(args=['ctc_live', *ros_args], signal_handler_options=SignalHandlerOptions.NO)
        reader = GraphReader()
    except Exception as error:
        rclpy.try_shutdown()
        raise CtcError(' '.join(str(error).split())) from None
    status = 1
    try:
        page = make_page()
        try:
            GraphPage(page, reader, bags, ros_args, controls).run(stop)
            status = 0
        finally:
            page.close()
    finally:
        end_after(_LEAVE, status)
        reader.destroy_node()
        rclpy.try_shutdown()

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

"""The page of a running graph: plots of all its samples, the arm, light, reports, controls."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
import time
from typing import Any

from ctc_chattering.analysis.result import position_units
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import CtcError
from ctc_chattering.launch.requests import Requests
from ctc_chattering.live.controls import Controls, RecorderProcess
from ctc_chattering.live.graph_reader import GraphReader
from ctc_chattering.live.health import ENDED, light, SIGNS, SILENT
from ctc_chattering.live.page import ArmView, Page
from ctc_chattering.live.page_socket import Message, PageSocket, word
from ctc_chattering.live.skeleton import skeleton_of
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.ros.process import check_security, end_after, use_profile
from ctc_chattering.ros.spinning import Executor
import numpy as np
import rclpy
from rclpy.signals import SignalHandlerOptions

#: Between two pictures of the arm, two of the numbers and the light, and two of the plots [s].
_FRAME, _NUMBERS, _PLOTS = 1 / 30, 0.2, 0.1
#: Time for callbacks in each frame; to wait for a service and its answer [s].
_SERVE, _PATIENCE = 0.001, 3.0
#: How long the middleware may take to leave the graph [s]: Fast DDS hangs now and then.
_LEAVE = 0.5
#: Last seconds that the plots follow [s], and signals that are chosen at first.
WINDOW = 10.0
_SIGNALS = ('e', 'V', 'torque', 'rate')
#: Desired positions of the last seconds that the camera shows.
_POSES = 24
#: Further than this out of what the camera shows, as a part of its size, the arm is shown anew.
_OUT = 0.05


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
        self._requests = Requests(reader, self._answer, _PATIENCE)
        self._recording = RecorderProcess(bags, ros_args, self._answer)
        self._controls = (Controls(page.socket, reader, self._requests, self._recording)
                          if controls else None)
        self._plots = GraphPlots(page.socket, reader)
        self._arm = GraphArm(page, reader)
        page.socket.on('fit', None, lambda _: self._arm.look())
        self._made_of: Any = None
        self._due = 0.0

    def _answer(self, what: str, done: bool, answer: str) -> None:
        if self._controls is not None:
            self._controls.answer(what, done, answer)

    def run(self, stop: Sequence[int]) -> None:
        """Serve until a signal is in `stop`."""
        try:
            while not stop:
                begin = time.monotonic()
                self.update(begin)
                time.sleep(max(0.2 * _FRAME, begin + _FRAME - time.monotonic()))
            self.update(time.monotonic())  # How a graph has ended, with which this page ends.
        finally:
            self._recording.close()
            self._executor.remove_node(self._reader)

    def update(self, now: float) -> None:
        """Take what has come, carry out what was clicked, and show what is due."""
        self._reader.poll()
        self._reader.serve(self._executor, _SERVE)
        self._requests.poll()
        self._recording.poll()
        self._make()
        self._plots.update(now)
        if not self._page.socket.watched:
            return
        with self._page.server.atomic():
            self._arm.show()
        if now >= self._due:
            self._due = now + _NUMBERS
            self._show_numbers()

    def _make(self) -> None:
        """Make the parts of the page that depend on the robot, when it is known or changes."""
        config, description = self._reader.config, self._reader.description
        if config is None:
            return
        made_of = config.model, config.joint_names, config.locked, description
        if made_of != self._made_of:
            self._made_of = made_of
            self._arm.make(config, description)

    def _show_numbers(self) -> None:
        reader, socket = self._reader, self._page.socket
        reports, silence = reader.reports(), reader.silence()
        horizon = reader.parameters['reference'].get('horizon')
        patience = 0.5 * horizon if isinstance(horizon, int | float) else 0.0
        found = light(reports, silence, reader.simulated, {'reference': SILENT + patience},
                      time.time())
        socket.tell(
            light={'level': found.level, 'sign': SIGNS[found.level], 'lines': found.lines,
                   'law': self._law()},
            ended=f'{SIGNS[ENDED]}. {"; ".join(found.lines)}' if found.level == ENDED else '',
            reports=[(name, report.message, list(report.values.items()))
                     for name, report in sorted(reports.items())])
        if self._controls is not None:
            socket.tell(controls=self._controls.state(), answers=list(self._controls.answers))
        # Also where nothing is new: the page counts anew.
        socket.send(word(silent=0.0 if reader.simulated else min(silence.values(), default=0.0)))

    def _law(self) -> str:
        """Return law and switching; nothing before they are known."""
        config = self._reader.config
        if config is None:
            return ''
        return f'law {config.law}' + (
            f', {config.switching}' if config.takes('switching') else '')


class GraphPlots:
    """
    Sends what is new.

    Parameters
    ----------
    samples : PageSocket
        To the pages.
    reader : GraphReader
        Of the graph.

    """

    def __init__(self, samples: PageSocket, reader: GraphReader) -> None:
        self._samples, self._reader = samples, reader
        self._about: Any = None
        self._shown = ''
        self._due = 0.0

    def update(self, now: float) -> None:
        """Send the samples that have come when it is time, and all to new pages."""
        samples, about = self._samples, (
            self._reader.names, self._reader.description, self._note())
        if about != self._about:
            self._about, self._shown = about, self._show()
            samples.send(self._shown)
            self._send(fresh=True)
        if now >= self._due:
            self._due = now + _PLOTS
            self._send()
        samples.poll(self._greeting)

    def _send(self, fresh: bool = False) -> None:
        if self._samples.watched:
            for message in self._packed(fresh):
                self._samples.send(message)

    def _greeting(self) -> list[Message]:
        self._send()  # What comes next for the others must come next for the new page, too.
        return [self._shown, *self._packed(fresh=True)]

    def _packed(self, fresh: bool) -> list[bytes]:
        """Return the samples that were not sent, or all that are kept."""
        found = [track.packed(self._reader.begin, fresh) for track in self._reader.tracks.values()]
        return [message for message in found if message]

    def _show(self) -> str:
        names = self._reader.names
        return word(show={
            'joints': names, 'units': position_units(names, self._reader.description),
            'runs': [{'name': ''}], 'options': {'window': WINDOW, 'signals': _SIGNALS},
            'note': self._note()})

    def _note(self) -> str:
        """Return which samples there are."""
        if not self._reader.names:
            return 'waiting for a graph'
        values = self._reader.parameters['controller']
        every = values.get('state_decimation')
        terms = ('those of its other topics' if not isinstance(every, int) else
                 'every sample of the law' if every == 1 else
                 f'every {every}th sample of the law (state_decimation)')
        return f'Drawn: every message of joint_states (q, dq, effort), and {terms}.'


class GraphArm:
    """
    Draws the arm of a graph, once it is known.

    Parameters
    ----------
    page : Page
    reader : GraphReader

    """

    def __init__(self, page: Page, reader: GraphReader) -> None:
        self._page, self._reader = page, reader
        self._view: ArmView | None = None
        #: Points that the camera shows, shape (N, 3) [m].
        self._shown: Array | None = None

    def make(self, config: ControllerConfig, description: str) -> None:
        """Draw another robot from now on."""
        try:
            skeleton = skeleton_of(config, description)
        except CtcError as error:
            skeleton = None
            self._reader.get_logger().warning(f'no picture of the arm: {error}')
        (self._view,) = self._page.show_arms([skeleton])
        self._shown = None

    def show(self) -> None:
        """Draw it where it is, and the ghost by how much its error is magnified."""
        if self._view is None:
            return
        pose = self._reader.pose()
        self._view.magnified = self._page.magnified
        self._view.show(*pose)
        now = self._view.points([x for x in pose if x is not None])
        if self._shown is None:
            self.look(again=False)
        elif len(now):  # Has it left what the camera shows?
            least, most = self._shown.min(axis=0), self._shown.max(axis=0)
            if max((now - most).max(), (least - now).max()) > _OUT * (most - least).max():
                self._look_at(np.concatenate((self._shown, now)), again=False)

    def look(self, again: bool = True) -> None:
        """Have cameras show the arm and its desired motion, as far as it is known."""
        poses = [x for x in self._reader.pose() if x is not None]
        if self._view is not None and poses:
            self._look_at(self._view.points(poses + self._reader.desired(_POSES)), again)

    def _look_at(self, points: Array, again: bool) -> None:
        if len(points):
            self._shown = points
            self._page.cameras.look(points, again)


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

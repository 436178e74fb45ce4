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
Page of a running graph.

It has plots, arm, light, reports and controls.

`ctc live` without a bag calls `run_graph_page`. `GraphReader` has what the graph publishes, and
`Page` shows it in browsers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
import time
from typing import Any

from ctc_chattering.analysis.result import position_units
from ctc_chattering.errors import CtcError
from ctc_chattering.launch.requests import Requests
from ctc_chattering.live.controls import Controls
from ctc_chattering.live.graph_reader import GraphReader
from ctc_chattering.live.page import ArmView, describe_law, Page
from ctc_chattering.live.page_socket import encode_message, Message, PageSocket
from ctc_chattering.live.recorder_process import RecorderProcess
from ctc_chattering.live.skeleton import skeleton_of
from ctc_chattering.live.status_light import assess, Level
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.ros.process import check_security, end_after, use_profile
from ctc_chattering.ros.spinning import Executor
import numpy as np
import rclpy
from rclpy.signals import SignalHandlerOptions

#: Time between two pictures of the arm [s].
_ARM_PERIOD_S = 1 / 30
#: Time between two messages of new samples [s].
_PLOT_PERIOD_S = 0.1
#: Time between two updates of numbers and light [s].
_LIGHT_PERIOD_S = 0.2


class GraphPage:
    """
    Page of a graph, with its requests.

    Parameters
    ----------
    page : Page
    reader : GraphReader
    bags : Path
        Directory of new bags.
    ros_args : sequence of str
        Arguments for ROS of the recorder.
    with_controls : bool
        False for a page that sends nothing to the graph.

    """

    def __init__(self, page: Page, reader: GraphReader, bags: Path, ros_args: Sequence[str] = (),
                 with_controls: bool = True) -> None:
        self._page = page
        self._reader = reader
        self._executor = Executor()
        self._executor.add_node(reader)
        self._requests = Requests(reader, self._on_answer, patience=3.0)
        self._recorder = RecorderProcess(bags, ros_args, self._on_answer)
        self._controls: Controls | None = None
        if with_controls:
            self._controls = Controls(page.socket, reader, self._requests, self._recorder)
        self._plots = GraphPlots(page.socket, reader)
        self._arm = GraphArm(page, reader)
        page.socket.on('fit', None, lambda _: self._arm.fit_view())
        self._next_light = 0.0

    def _on_answer(self, request: str, done: bool, text: str) -> None:
        if self._controls is not None:
            self._controls.answer(request, done, text)

    def run(self, stop: Sequence[int]) -> None:
        """Serve until a signal is in `stop`."""
        try:
            while not stop:
                begin = time.monotonic()
                self.update(begin)
                remaining = begin + _ARM_PERIOD_S - time.monotonic()
                time.sleep(max(0.2 * _ARM_PERIOD_S, remaining))
            # A graph that ends together with this page says why.
            self.update(time.monotonic())
        finally:
            self._recorder.close()
            self._executor.remove_node(self._reader)

    def update(self, now: float) -> None:
        """Take what has come, send requests, and show what is due."""
        self._reader.poll()
        self._reader.serve(self._executor, 0.001)
        self._requests.poll()
        self._recorder.poll()
        self._arm.rebuild()
        self._plots.update(now)
        if not self._page.socket.watched:
            return
        with self._page.server.viser.atomic():
            self._arm.show()
        if now >= self._next_light:
            self._next_light = now + _LIGHT_PERIOD_S
            self._show_light()

    def _show_light(self) -> None:
        """Show light, reports, controls and answers."""
        reader = self._reader
        socket = self._page.socket
        reports = reader.reports
        silence = reader.silence
        horizon = reader.parameters['reference'].get('horizon')
        # The reference is silent between two chunks.
        patience = 0.5 * horizon if isinstance(horizon, int | float) else 0.0
        light = assess(reports, silence, reader.simulated, patience, time.time())
        has_ended = light.level == Level.ENDED
        socket.send(
            light={'level': light.level, 'title': light.level.title, 'lines': light.lines,
                   'law': f'law {describe_law(reader.config)}' if reader.config else ''},
            ended=f'{light.level.title}. {"; ".join(light.lines)}' if has_ended else '',
            reports=[(name, report.message, list(report.values.items()))
                     for name, report in sorted(reports.items())])
        if self._controls is not None:
            socket.send(controls=self._controls.state(), answers=list(self._controls.answers))
        # The page updates its numbers by it, so it is sent even if it is the same.
        age = 0.0 if reader.simulated else min(silence.values(), default=0.0)
        socket.broadcast(encode_message(silent=age))


class GraphPlots:
    """
    Samples of a graph for the plots of all pages.

    Parameters
    ----------
    socket : PageSocket
    reader : GraphReader

    """

    def __init__(self, socket: PageSocket, reader: GraphReader) -> None:
        self._socket = socket
        self._reader = reader
        #: Joints, description and note that the plots are made of.
        self._source: Any = None
        #: The message that makes the plots.
        self._show = ''
        self._next_samples = 0.0

    def update(self, now: float) -> None:
        """Send the samples that are due."""
        source = self._reader.names, self._reader.description, self._note()
        if source != self._source:
            self._source = source
            self._show = self._describe()
            self._socket.broadcast(self._show)
            self._send_samples(fresh=True)
        if now >= self._next_samples:
            self._next_samples = now + _PLOT_PERIOD_S
            self._send_samples()
        self._socket.poll(self._greet)

    def _send_samples(self, fresh: bool = False) -> None:
        if self._socket.watched:
            for message in self._pack(fresh):
                self._socket.broadcast(message)

    def _greet(self) -> list[Message]:
        """Return all messages for a new page."""
        self._send_samples()  # The next new ones are then the same for all pages.
        return [self._show, *self._pack(fresh=True)]

    def _pack(self, fresh: bool) -> list[bytes]:
        """Return the samples that were not sent, or all samples."""
        tracks = self._reader.tracks.values()
        return list(filter(None, [track.packed(self._reader.begin, fresh) for track in tracks]))

    def _describe(self) -> str:
        """Return the message that makes the plots."""
        names = self._reader.names
        return encode_message(show={
            'joints': names,
            'units': position_units(names, self._reader.description),
            'runs': [{'name': ''}],
            # The plots follow the last seconds.
            'options': {'window': 10.0, 'signals': ('e', 'V', 'torque', 'rate')},
            'note': self._note()})

    def _note(self) -> str:
        """Return which samples are drawn."""
        if not self._reader.names:
            return 'waiting for a graph'
        decimation = self._reader.parameters['controller'].get('state_decimation')
        if not isinstance(decimation, int):
            terms = 'every message of the other topics'
        elif decimation == 1:
            terms = 'every sample of the law'
        else:
            terms = f'every {decimation}th sample of the law (state_decimation)'
        return f'The plots show every message of joint_states (q, dq, effort), and {terms}.'


class GraphArm:
    """
    Arm of a graph, once it is known.

    Parameters
    ----------
    page : Page
    reader : GraphReader

    """

    def __init__(self, page: Page, reader: GraphReader) -> None:
        self._page = page
        self._reader = reader
        self._robot: Any = None
        self._view: ArmView | None = None
        #: Points that the cameras show, shape (N, 3) [m].
        self._shown: Array | None = None

    def rebuild(self) -> None:
        """Draw the robot if it is new."""
        config = self._reader.config
        if config is None:
            return
        robot = config.model, config.joint_names, config.locked, self._reader.description
        if robot == self._robot:
            return
        self._robot = robot
        try:
            skeleton = skeleton_of(config, self._reader.description)
        except CtcError as error:
            skeleton = None
            self._reader.get_logger().warning(f'the arm cannot be drawn: {error}')
        self._view = self._page.show_arms([skeleton])[0]
        self._shown = None

    def show(self) -> None:
        """Draw the last pose, and follow it with the cameras."""
        if self._view is None:
            return
        pose = self._reader.pose
        self._view.show(pose.q, pose.q_d, self._page.magnification)
        if self._shown is None:
            self.fit_view(after_move=False)
            return
        points = self._view.points([q for q in pose[1:] if q is not None])
        if len(points) and _is_outside(points, self._shown):
            self._look_at(np.concatenate((self._shown, points)), after_move=False)

    def fit_view(self, after_move: bool = True) -> None:
        """Show the arm and its desired motion, where known."""
        positions = [q for q in self._reader.pose[1:] if q is not None]
        if self._view is not None and positions:
            positions += self._reader.desired_positions(24)
            self._look_at(self._view.points(positions), after_move)

    def _look_at(self, points: Array, after_move: bool) -> None:
        if len(points):
            self._shown = points
            self._page.cameras.look(points, after_move)


def _is_outside(points: Array, shown: Array) -> bool:
    """Return whether points have left the shown box by 5 %."""
    low = shown.min(axis=0)
    high = shown.max(axis=0)
    distance = np.maximum(points - high, low - points).max()
    return bool(distance > 0.05 * (high - low).max())


def run_graph_page(make_page: Callable[[], Page], stop: Sequence[int], ros_args: Sequence[str],
                   with_controls: bool = True, bags: Path = Path()) -> None:
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
    with_controls : bool
        False for a page that sends nothing to the graph.
    bags : Path
        Directory of new bags.

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
            GraphPage(page, reader, bags, ros_args, with_controls).run(stop)
            status = 0
        finally:
            page.close()
    finally:
        end_after(0.5, status)  # Fast DDS hangs now and then when it leaves the graph.
        reader.destroy_node()
        rclpy.try_shutdown()

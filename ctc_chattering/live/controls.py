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
State and requests of the controls of a running graph.

web/controls.js draws `Controls.state` and sends the requests. `GraphPage` makes one `Controls`,
which sets parameters and calls services by `launch.requests`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from math import inf
import time
from typing import Annotated, Any, Literal, NamedTuple

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.control.laws.registry import LAWS, laws_by_parameter, SWITCHINGS
from ctc_chattering.errors import CtcError
from ctc_chattering.live.graph_reader import GraphReader
from ctc_chattering.live.page_socket import PageSocket
from ctc_chattering.live.recorder_process import RecorderProcess
from ctc_chattering.number_format import format_value
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.parameters import Parameter, unit_text
from ctc_chattering.simulation.plant_config import PlantConfig
from msgspec import Meta, Struct

#: Parameters of the controller with a slider.
GAINS = ('kp', 'kv', 'lambda', 'ka', 'observer_bandwidth', 'estimator_bandwidth')
#: Parameters of the plant with a field, and their titles.
PLANT_FIELDS = {
    'coulomb_friction': 'Coulomb friction',
    'viscous_friction': 'viscous friction',
    'disturbance.amplitude': 'disturbance',
    'disturbance.frequency': 'disturbance frequency'}
#: Factor by which a slider goes on beyond the values in force, on both sides.
_SLIDER_ROOM = 10.0


class GainSlider(NamedTuple):
    """
    Slider of a gain.

    Attributes
    ----------
    parameter : Parameter
    values : tuple of float
        Values in force, one for each joint or a single one.

    """

    parameter: Parameter
    values: tuple[float, ...]

    @property
    def limits(self) -> tuple[float, float]:
        """Range of the slider, beyond the values in force."""
        low, high = self.parameter.usual
        lowest, highest = self.parameter.bounds
        positive = [x for x in self.values if x > 0.0]
        if positive:
            low = min(low, min(positive) / _SLIDER_ROOM)
            high = max(high, max(positive) * _SLIDER_ROOM)
        return max(low, lowest), min(high, highest)

    def shown(self) -> dict[str, Any]:
        """Return the slider as the page draws it."""
        low, high = self.limits
        return {
            'name': self.parameter.name,
            'unit': unit_text(self.parameter.unit),
            'about': self.parameter.meaning,
            'low': low,
            'high': high,
            'bounds': self.parameter.bounds,
            'values': self.values}


def gain_sliders(parameters: Mapping[str, Any], n: int) -> dict[str, GainSlider]:
    """
    Return the sliders of the gains that the law takes.

    Gains that are full matrices have none.
    """
    law = str(parameters.get('law'))
    sliders = {}
    for name in GAINS:
        parameter = ControllerConfig.parameters()[name]
        # A user's own law is not imported here. It may take any gain.
        if parameter.laws and law not in parameter.laws and ':' not in law:
            continue
        with suppress(CtcError):  # Whoever published it, it is no gain.
            value = parameter.checked(parameters.get(name), n)
            values = value if isinstance(value, tuple) else (value,)
            if len(values) in (1, n) and inf not in values:
                sliders[name] = GainSlider(parameter, values)
    return sliders


class ValuesRequest(Struct, forbid_unknown_fields=True):
    """Values for a parameter: one for all joints, or one for each."""

    name: str
    values: Annotated[list[float], Meta(min_length=1)]


class PushRequest(Struct, forbid_unknown_fields=True):
    """A torque on a joint [N·m] and its duration [s]."""

    joint: Annotated[int, Meta(ge=0)]
    torque: float
    duration: float


class TimeRequest(Struct, forbid_unknown_fields=True):
    """A request to hold simulated time, go on by samples, or run."""

    action: Literal['hold', 'step', 'run']
    samples: Annotated[int, Meta(ge=1, le=100_000)]


class Controls:
    """
    State and requests of the controls.

    Parameters
    ----------
    socket : PageSocket
    reader : GraphReader
        Parameters in force, and the time.
    requests : Requests
        Service calls to the graph.
    recorder : RecorderProcess

    """

    def __init__(self, socket: PageSocket, reader: GraphReader, requests: Any,
                 recorder: RecorderProcess) -> None:
        self._reader = reader
        self._requests = requests
        self._recorder = recorder
        #: The last answers to requests, the newest first.
        self.answers: deque[dict[str, Any]] = deque(maxlen=50)
        self._answer_count = 0
        any_of: Any = Literal
        for name, choices in (('law', LAWS), ('switching', SWITCHINGS)):
            socket.on(name, any_of[choices], partial(self._set, name))
        socket.on('gain', ValuesRequest, self._set_gain)
        socket.on('torques', bool, requests.torques)
        socket.on('move', Literal['stop', 'home'], requests.move)
        socket.on('learning', Literal['freeze', 'resume', 'reset'], requests.learning)
        socket.on('guide', bool, requests.guide)
        socket.on('speed', Annotated[float, Meta(ge=0.0, le=1.0)], self._set_speed)
        socket.on('payload', Annotated[float, Meta(ge=0.0)], self._set_payload)
        socket.on('record', bool, self._record)
        socket.on('plant', ValuesRequest, self._set_plant)
        socket.on('push', PushRequest, self._push)
        socket.on('time', TimeRequest, self._set_time)

    @property
    def _sliders(self) -> dict[str, GainSlider]:
        parameters = self._reader.parameters['controller']
        return gain_sliders(parameters, len(self._reader.names))

    def state(self) -> dict[str, Any]:
        """Return the state as the page draws it."""
        controller = self._reader.parameters['controller']
        plant = self._reader.parameters['plant']
        law = str(controller.get('law', ''))
        takes_switching = law in laws_by_parameter()['switching']
        units = PlantConfig.parameters()
        is_described = controller.get('model') == 'urdf'
        return {
            'law': law,
            'laws': LAWS,
            'switching': str(controller.get('switching', '')) if takes_switching else None,
            'switchings': SWITCHINGS,
            'joints': self._reader.names,
            'gains': [slider.shown() for slider in self._sliders.values()],
            'record': self._recorder.shown(),
            'speed': self._reader.parameters['reference'].get('speed_scaling'),
            'learning': self._reader.parameters['reference'].get('learning') is True,
            'payload': controller.get('payload_mass') if is_described else None,
            'answered': self._answer_count,
            'plant': [{'name': name,
                       'title': f'{title} [{unit_text(units[name].unit)}]',
                       'value': format_value(plant[name], 12)}
                      for name, title in PLANT_FIELDS.items() if name in plant],
            'time_runs_on': _why_time_runs_on(plant.get('pacing'))}

    def answer(self, request: str, done: bool, text: str) -> None:
        """Note the answer to a request."""
        self._answer_count += 1
        self.answers.appendleft({
            'request': request,
            'done': done,
            'text': text[:1000],
            'clock': time.strftime('%H:%M:%S')})

    def _set(self, name: str, value: Any) -> None:
        self._requests.set('controller', {name: value})

    def _set_gain(self, request: ValuesRequest) -> None:
        """Set a gain, or answer why its values are not allowed."""
        slider = self._sliders.get(request.name)
        if slider is None:
            return
        is_list = slider.parameter.kind == 'float[]'
        try:
            value = slider.parameter.checked(
                request.values if is_list else request.values[0], len(self._reader.names))
        except CtcError as error:
            self.answer(request.name, False, str(error))
            return
        self._set(request.name, list(value) if is_list else value)

    def _set_speed(self, value: float) -> None:
        self._requests.set('reference', {'speed_scaling': value})

    def _set_payload(self, value: float) -> None:
        self._set('payload_mass', value)

    def _record(self, on: bool) -> None:
        (self._recorder.start if on else self._recorder.stop)()

    def _set_plant(self, request: ValuesRequest) -> None:
        if request.name in PLANT_FIELDS:
            count = len(self._reader.names) if len(request.values) == 1 else 1
            self._requests.set('plant', {request.name: request.values * count})

    def _push(self, request: PushRequest) -> None:
        torques = [0.0] * len(self._reader.names)
        # Only a change pushes, so that the same push again needs none before it.
        no_push = {'disturbance.push': list(torques)}
        if request.joint < len(torques):
            torques[request.joint] = request.torque
        self._requests.set(
            'plant',
            {'disturbance.push_duration': request.duration},
            no_push,
            {'disturbance.push': torques})

    def _set_time(self, request: TimeRequest) -> None:
        config = self._reader.config
        hold_at = 0.0
        if request.action != 'run' and config is not None:
            period = round(config.control_period * NANOSECONDS)
            sample = round(self._reader.latest * NANOSECONDS / period)
            steps = request.samples if request.action == 'step' else 1
            hold_at = seconds((sample + steps) * period)
        self._requests.set('plant', {'hold_at': hold_at})


def _why_time_runs_on(pacing: Any) -> str:
    """Return why simulated time cannot be held, or an empty text."""
    if pacing == 'lockstep':
        return ''
    if pacing is None:
        return 'No plant that can hold its time has been heard.'
    return f'The plant has pacing: {pacing}. Only in lockstep can its time be held.'

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
The controls of a running graph: what the page shows of them, and what it may ask for.

Bags are recorded by our recorder as a process of its own.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
import json
from math import inf
from pathlib import Path
import signal
import time
from typing import Annotated, Any, Literal, NamedTuple

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.control.laws.registry import LAWS, laws_by_parameter, SWITCHINGS
from ctc_chattering.errors import CtcError
from ctc_chattering.launch.child_process import Child, node_command, stop
from ctc_chattering.live.graph_reader import GraphReader
from ctc_chattering.live.page_socket import PageSocket
from ctc_chattering.number_format import format_value
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.parameters import Parameter, unit_text
from ctc_chattering.simulation.plant_config import PlantConfig
from msgspec import Meta, Struct

#: The gains with a slider.
GAINS = ('kp', 'kv', 'lambda', 'ka', 'observer_bandwidth', 'estimator_bandwidth')
#: Stands for all joints: their values keep their ratios, and the slider shows the largest.
ALL = -1
#: Room on a slider on both sides of the values in force, as a factor.
ROOM = 10.0
#: Parameters of the plant with a field of their own, and their titles, which get the units.
PLANT = {'coulomb_friction': 'Coulomb friction', 'viscous_friction': 'viscous friction',
         'disturbance.amplitude': 'disturbance',
         'disturbance.frequency': 'disturbance frequency'}
#: How long a recorder may take to write what it has, when the page ends [s].
_PATIENCE = 20.0
#: Answers that are shown.
_ANSWERS = 50
#: Why simulated time cannot be stopped, where it cannot.
_REAL = 'the plant has pacing: {}; only in lockstep its time can be held'
_NO_PLANT = 'nothing has been heard of a plant whose time can be held'


class GainSlider(NamedTuple):
    """A gain in force, as its slider shows it: one value for each joint, or a single one."""

    spec: Parameter
    values: tuple[float, ...]

    @property
    def limits(self) -> tuple[float, float]:
        """Return where the slider begins and ends: the values in force have room on both sides."""
        least, most = self.spec.usual
        lowest, highest = self.spec.bounds
        known = [x for x in self.values if x > 0.0]
        return (max(min((least, *(x / ROOM for x in known))), min(lowest, least)),
                min(max((most, *(x * ROOM for x in known))), highest))

    def shown(self) -> dict[str, Any]:
        """Return what the page has to know."""
        least, most = self.limits
        return {'name': self.spec.name, 'unit': unit_text(self.spec.unit),
                'about': self.spec.meaning, 'least': least, 'most': most,
                'bounds': self.spec.bounds, 'values': self.values}

    def changed(self, joint: int, value: float) -> list[float] | float:
        """
        Return the parameter's value once the one of a joint, or of `ALL`, is another.

        Raises
        ------
        CtcError
            If the value is not allowed.

        """
        largest = max(self.values)
        made = tuple(value if i == joint or (joint == ALL and not largest) else
                     value * (x / largest) if joint == ALL else x
                     for i, x in enumerate(self.values))
        return self._checked(made)

    def replaced(self, values: Sequence[float]) -> list[float] | float:
        """
        Return the parameter's value for other numbers, one for all joints or one for each.

        Raises
        ------
        CtcError
            If a number is not allowed.

        """
        return self._checked(tuple(values) * (len(self.values) if len(values) == 1 else 1))

    def _checked(self, values: tuple[float, ...]) -> list[float] | float:
        """Return numbers as the parameter has them; raise `CtcError` if they are not allowed."""
        self.spec.check(values, len(self.values))
        return list(values) if self.spec.kind == 'float[]' else values[0]


def gains_of(parameters: Mapping[str, Any], names: Sequence[str]) -> dict[str, GainSlider]:
    """Return the gains in force that the law takes, by name; without those of a full matrix."""
    law, found = str(parameters.get('law')), {}
    for name in GAINS:
        spec = ControllerConfig.parameters()[name]
        if spec.laws and law not in spec.laws and ':' not in law:  # No own law is imported here.
            continue
        with suppress(CtcError):  # What is no gain is left out.
            value = spec.checked(parameters.get(name), len(names))
            values = value if isinstance(value, tuple) else (value,)
            if len(values) in (1, len(names)) and inf not in values:
                found[name] = GainSlider(spec, values)
    return found


def plant_title(name: str) -> str:
    """Return the title of a parameter of the plant, with its unit."""
    return f'{PLANT[name]} [{unit_text(PlantConfig.parameters()[name].unit)}]'


class GainsRequest(Struct, forbid_unknown_fields=True):
    """Numbers for a gain: one for all joints, or one for each."""

    name: str
    values: Annotated[list[float], Meta(min_length=1)]


class GainRequest(Struct, forbid_unknown_fields=True):
    """A value for a gain of a joint, or the largest of `ALL`, whose ratios are kept."""

    name: str
    joint: Annotated[int, Meta(ge=ALL)]
    value: float


class FieldRequest(Struct, forbid_unknown_fields=True):
    """A parameter of `PLANT`, and the numbers in its field: one, or one for each joint."""

    name: str
    value: Annotated[list[float], Meta(min_length=1)]


class PushRequest(Struct, forbid_unknown_fields=True):
    """A torque [N·m] on a joint, and for how long [s]."""

    joint: Annotated[int, Meta(ge=0)]
    torque: float
    lasts: float


class HoldRequest(Struct, forbid_unknown_fields=True):
    """What is to become of simulated time; `samples` are those of a step."""

    word: Literal['hold', 'step', 'run']
    samples: Annotated[int, Meta(ge=1, le=100_000)]


class Controls:
    """
    What web/controls.js draws, and the words that it sends.

    Parameters
    ----------
    socket : PageSocket
    reader : GraphReader
        What is known of the graph.
    requests : Requests
        Asks the graph.
    recording : RecorderProcess

    """

    def __init__(self, socket: PageSocket, reader: GraphReader, requests: Any, recording: Any
                 ) -> None:
        self._reader, self._requests, self._recording = reader, requests, recording
        self.answers: deque[dict[str, Any]] = deque(maxlen=_ANSWERS)
        self._answered = 0
        one_of: Any = Literal
        for name, names in (('law', LAWS), ('switching', SWITCHINGS)):
            socket.on(name, one_of[names], partial(self._set, 'controller', name))
        for name, kind, receive in (
                ('gain', GainRequest, self._gain), ('gains', GainsRequest, self._gains),
                ('torques', bool, requests.torques), ('record', bool, self._record),
                ('plant', FieldRequest, self._plant),
                ('push', PushRequest, self._push), ('time', HoldRequest, self._hold)):
            socket.on(name, kind, receive)

    @property
    def _in_force(self) -> Mapping[str, Any]:
        return self._reader.parameters['controller']

    def state(self) -> dict[str, Any]:
        """Return what the page is to show."""
        law, switching = (str(self._in_force.get(x, '')) for x in ('law', 'switching'))
        plant = self._reader.parameters['plant']
        pacing = plant.get('pacing')
        return {
            'law': law, 'laws': LAWS, 'switchings': SWITCHINGS,
            'switching': switching if law in laws_by_parameter()['switching'] else None,
            'joints': self._reader.names,
            'gains': [x.shown() for x in gains_of(self._in_force, self._reader.names).values()],
            'record': self._recording.shown(), 'answered': self._answered,
            'plant': [{
                'name': name, 'title': plant_title(name), 'value': format_value(plant[name], 12)}
                for name in PLANT if name in plant],
            'held': '' if pacing == 'lockstep' else (
                _NO_PLANT if pacing is None else _REAL.format(pacing))}

    def answer(self, what: str, done: bool, text: str) -> None:
        """Note what became of a request."""
        self._answered += 1
        self.answers.appendleft({'what': what, 'done': done, 'text': text[:1000],
                                 'at': time.strftime('%H:%M:%S')})

    def _set(self, node: str, name: str, value: Any) -> None:
        """Set a parameter."""
        self._requests.set(node, {name: value})

    def _gain(self, asked: GainRequest) -> None:
        gain = gains_of(self._in_force, self._reader.names).get(asked.name)
        if gain is not None and asked.joint < len(gain.values):
            self._set_gain(asked.name, partial(gain.changed, asked.joint, asked.value))

    def _gains(self, asked: GainsRequest) -> None:
        gain = gains_of(self._in_force, self._reader.names).get(asked.name)
        if gain is not None:
            self._set_gain(asked.name, partial(gain.replaced, asked.values))

    def _set_gain(self, name: str, value: Callable[[], Any]) -> None:
        """Set a gain to what `value` returns; where that raises an error, answer with it."""
        try:
            self._set('controller', name, value())
        except CtcError as error:
            self.answer(name, False, str(error))

    def _record(self, on: bool) -> None:
        (self._recording.start if on else self._recording.stop)()

    def _plant(self, asked: FieldRequest) -> None:
        if asked.name in PLANT:
            count = len(self._reader.names) if len(asked.value) == 1 else 1
            self._set('plant', asked.name, asked.value * count)

    def _push(self, asked: PushRequest) -> None:
        none = [0.0] * len(self._reader.names)
        torques = [asked.torque if i == asked.joint else x for i, x in enumerate(none)]
        # Only a change pushes: the same push again is one after none.
        self._requests.set('plant', {'disturbance.push_duration': asked.lasts},
                           {'disturbance.push': none}, {'disturbance.push': torques})

    def _hold(self, asked: HoldRequest) -> None:
        hold, config = 0.0, self._reader.config
        if asked.word != 'run' and config is not None:
            period = round(config.control_period * NANOSECONDS)
            k = round(self._reader.latest * NANOSECONDS / period)
            hold = seconds((k + (asked.samples if asked.word == 'step' else 1)) * period)
        self._requests.set('plant', {'hold_at': hold})


class RecorderProcess:
    """
    Starts and stops a recorder, one at a time.

    Parameters
    ----------
    folder : Path
        Where the bags are made.
    ros_args : sequence of str
        Arguments for ROS, such as a namespace.
    tell : callable
        Called with what was asked, whether it was done, and what became of it.

    """

    def __init__(self, folder: Path, ros_args: Sequence[str],
                 tell: Callable[[str, bool, str], None]) -> None:
        self._folder, self._ros_args, self._tell = folder.absolute(), tuple(ros_args), tell
        self._child: Child | None = None
        self._path = self._folder
        self._begun = 0.0
        self._asked = False

    def start(self) -> None:
        """Record into a new bag, which is called after the time."""
        if self._child is not None:
            self._tell('record', False, f'is recording already: {self._path}')
            return
        self._path = self._folder / time.strftime('live_%Y-%m-%d_%H.%M.%S')
        self._begun, self._asked = time.monotonic(), False
        self._child = Child('recorder', node_command(
            'recorder', *self._ros_args, '--ros-args', '-p',
            f'bag:={json.dumps(str(self._path))}'), lambda _: None)
        self._tell('record', True, f'to {self._path}')

    def stop(self) -> None:
        """Have it close the bag."""
        if self._child is not None:
            self._asked = True
            self._child.process.send_signal(signal.SIGINT)

    def poll(self) -> None:
        """Tell how a recorder has ended."""
        child = self._child
        if child is None or child.status is None:
            return
        self._child = None
        if child.status == 0 and self._asked:
            counts = [line.rpartition(']: ')[2] for line in child.tail if ' messages on ' in line]
            self._tell('recorded', True, ', '.join((str(self._path), *counts)))
        else:
            self._tell('record', False, f'{self._path}: {" ".join(child.exit_report().split())}')

    def shown(self) -> dict[str, Any]:
        """Return what the page has to know."""
        child = self._child
        state = ('off' if child is None else 'stopping' if self._asked else
                 'on' if child.tail else 'starting')
        return {'state': state, 'path': str(self._folder if child is None else self._path),
                'lasts': 0 if child is None else int(time.monotonic() - self._begun)}

    def close(self) -> None:
        """End a recorder that runs, and wait for it."""
        if self._child is not None:
            stop([self._child], _PATIENCE)

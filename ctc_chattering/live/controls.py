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

"""The controls of a running graph: what the page shows of them, and what it may ask for."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
import dataclasses
from functools import partial
from math import inf
import time
from typing import Annotated, Any, Literal

from ctc_chattering.analysis.tables import in_field
from ctc_chattering.control.controller import ControllerConfig, LAWS
from ctc_chattering.control.controller_config import SWITCHINGS
from ctc_chattering.errors import CtcError
from ctc_chattering.live.graph_reader import GraphReader
from ctc_chattering.live.page_socket import PageSocket
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.parameters import Parameter, unit_text
from msgspec import Meta, Struct

#: The gains with a slider.
GAINS = ('kp', 'kv', 'lambda', 'ka', 'observer_bandwidth', 'estimator_bandwidth')
#: Stands for all joints: their values keep their ratios, and the slider shows the largest.
ALL = -1
#: Parameters of the plant with a field of their own, and their titles.
PLANT = {'coulomb_friction': 'Coulomb friction [N·m]', 'viscous_friction': 'viscous friction',
         'disturbance.amplitude': 'disturbance [N·m]',
         'disturbance.frequency': 'disturbance frequency [rad/s]'}
#: Answers that are shown.
_ANSWERS = 50
#: Why simulated time cannot be stopped, where it cannot.
_REAL = 'the plant has pacing: {}; only in lockstep its time can be held'
_NO_PLANT = 'nothing has been heard of a plant whose time can be held'


@dataclasses.dataclass(frozen=True)
class GainSlider:
    """
    A gain in force, as its slider shows it.

    Attributes
    ----------
    spec : Parameter
    values : tuple of float
        One for each joint, the diagonal of a matrix, or a single one.
    matrix : tuple of float
        All elements of a full matrix, row by row; else empty.
    off : str
        Why it has no effect; else empty.

    """

    spec: Parameter
    values: tuple[float, ...]
    matrix: tuple[float, ...] = ()
    off: str = ''

    @property
    def limits(self) -> tuple[float, float]:
        """Return where the slider begins and ends: its declared range and the values in force."""
        least, most = self.spec.usual
        known = [x for x in self.values if x > 0.0]
        return min(least, *known, most), max(most, *known, least)

    def shown(self) -> dict[str, Any]:
        """Return what the page has to know."""
        least, most = self.limits
        return {'name': self.spec.name, 'unit': unit_text(self.spec.unit),
                'about': self.spec.meaning, 'least': least, 'most': most,
                'bounds': self.spec.bounds, 'values': self.values,
                'each': len(self.values) > 1 and not self.matrix, 'off': self.off}

    def changed(self, joint: int, value: float) -> list[float] | float | None:
        """
        Return the parameter's value once the one of a joint, or of `ALL`, is another.

        None for what no page of ours asks for.

        Raises
        ------
        ParameterError
            If the value is not allowed.

        """
        n = len(self.values)
        if self.off or not ALL <= joint < n or (self.matrix and joint != ALL):
            return None
        (value,) = self.spec.coerce((value,)) if n > 1 or self.spec.shape else (
            self.spec.coerce(value),)
        if self.spec.kind == 'float':
            made: tuple[float, ...] | float = value
        elif joint == ALL:
            largest = max(self.values)
            made = tuple(value * (x / largest) if largest else value
                         for x in self.matrix or self.values)
        else:
            made = tuple(value if i == joint else x for i, x in enumerate(self.values))
        self.spec.check(made, n)
        return list(made) if isinstance(made, tuple) else made


def gains_of(parameters: Mapping[str, Any], names: Sequence[str]) -> list[GainSlider]:
    """Return the gains among a controller's parameters in force; what is no gain is left out."""
    law, n = parameters.get('law'), len(names)
    found = []
    for name in GAINS:
        spec = ControllerConfig.parameters()[name]
        try:
            value = spec.coerce(parameters.get(name), n)
            spec.check(value, n)
        except CtcError:
            continue
        if value == inf:
            continue
        off = '' if not spec.laws or law in spec.laws or ':' in str(law) else (
            f'the law {law} does not take it')
        if spec.kind == 'float':
            found.append(GainSlider(spec, (value,), off=off))
        elif len(value) == n:
            found.append(GainSlider(spec, value, off=off))
        else:
            found.append(GainSlider(spec, value[::n + 1], value, off))
    return found


class GainRequest(Struct, forbid_unknown_fields=True):
    """A value for a gain of a joint or of `ALL`, and whether a large change is meant."""

    name: str
    joint: int
    value: float


class FieldRequest(Struct, forbid_unknown_fields=True):
    """A parameter of `PLANT`, and what is in its field."""

    name: str
    value: str


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
                ('gain', GainRequest, self._gain), ('torques', bool, requests.torques),
                ('record', str | None, self._record), ('plant', FieldRequest, self._plant),
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
            'switching': switching if law == 'chattering' else None,
            'joints': self._reader.names,
            'gains': [gain.shown() for gain in gains_of(self._in_force, self._reader.names)],
            'record': self._recording.shown(), 'answered': self._answered,
            'plant': [{'name': name, 'title': title, 'value': in_field(plant[name])}
                      for name, title in PLANT.items() if name in plant],
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
        for gain in gains_of(self._in_force, self._reader.names):
            if gain.spec.name == asked.name:
                self._set_gain(gain, asked)

    def _set_gain(self, gain: GainSlider, asked: GainRequest) -> None:
        try:
            value = gain.changed(asked.joint, asked.value)
        except CtcError as error:
            self.answer(asked.name, False, str(error))
            return
        if value is not None:
            self._set('controller', asked.name, value)

    def _record(self, name: str | None) -> None:
        if name is None:
            self._recording.stop()
        else:
            self._recording.start(name)

    def _plant(self, asked: FieldRequest) -> None:
        if asked.name in PLANT:
            self._set('plant', asked.name, numbers(asked.value, len(self._reader.names)))

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
            instant = self._reader.instant()
            latest = max(self._reader.clock, instant.t if instant is not None else 0.0)
            k = round(latest * NANOSECONDS / period)
            hold = seconds((k + (asked.samples if asked.word == 'step' else 1)) * period)
        self._requests.set('plant', {'hold_at': hold})


def numbers(text: str, count: int) -> list[float] | str:
    """
    Return the numbers in a field: one, or one for each of `count` joints; else the text itself.

    The service then refuses it and says why.
    """
    try:
        values = [float(word) for word in text.replace('[', ' ').replace(']', ' ')
                  .replace(',', ' ').split()]
    except ValueError:
        return text
    if not values:
        return text
    return values * count if len(values) == 1 else values

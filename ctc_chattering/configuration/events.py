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

"""Parameters that change during a run, from lines "time node parameter value"."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from typing import Any

from ctc_chattering.configuration.yaml_file import parse_value
from ctc_chattering.control.recommended_gains import GainChoice, GAINS, LAW
from ctc_chattering.controller.trips import change_steps
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.closed_loop import Event


def parse_events(lines: Sequence[str], configs: Mapping[str, Any],
                 model_torque: Callable[[], Array | None] = lambda: None) -> tuple[Event, ...]:
    """
    Return the events that `lines` describe, each "time node parameter value".

    Where no line has gains, a law comes with those that `GainChoice` decides.

    Parameters
    ----------
    lines : sequence of str
        The value is YAML; empty lines are ignored.
    configs : mapping
        Configuration of each node that can have events, at the start of the run.
    model_torque : callable, optional
        Returns `model_torque` of the controller; None while it is not known.

    Raises
    ------
    CtcError
        For a line of another form, a parameter that cannot change while the node runs,
        or a value that is not allowed.

    """
    events = []
    for line in filter(None, lines):
        words = line.split(None, 3)
        try:
            time, (node, name, value) = float(words[0]), words[1:]
            spec = configs[node].parameters().get(name)
        except (ValueError, IndexError, KeyError):
            raise ParameterError(
                'events', line, '"time node parameter value", node ' + ' | '.join(configs)
            ) from None
        if not 0.0 <= time < float('inf'):
            raise ParameterError('events', line, 'a time >= 0')
        if spec is not None and spec.read_only:
            raise ParameterError('events', name, 'a parameter that can change during the run')
        try:
            events.append((time, node, name, parse_value(value)))
        except CtcError:
            raise ParameterError('events', line, 'a value in YAML, not null') from None
    events.sort(key=itemgetter(0))
    current, choice = dict(configs), GainChoice()
    without_gains = not any(name in GAINS for _, _, name, _ in events)
    result = []
    for time, node, name, value in events:
        before, values = current[node], {name: value}
        if name == 'law':
            law = before.changed(values).law
            if law == LAW != before.law:
                choice.torque = model_torque()
            taken = choice.of_law(law, before)
            values |= {x: taken[x] if without_gains else before.as_mapping()[x] for x in taken}
        current[node] = before.changed(values)
        wanted = {x: current[node].as_mapping()[x] for x in values}
        if node == 'controller':  # A file that names a large change confirms it.
            old = before.as_mapping()
            result += [Event(time, node, {x: step}) for x, value in wanted.items()
                       for step in change_steps(before.parameters()[x], old[x], value,
                                                len(old['joint_names']))[:-1]]
        result.append(Event(time, node, wanted))
    return tuple(result)

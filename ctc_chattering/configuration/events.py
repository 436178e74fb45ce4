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

from collections.abc import Mapping, Sequence
from operator import itemgetter

from ctc_chattering.configuration.yaml_file import parse_value
from ctc_chattering.controller.settings_check import change_steps
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.parameters import Config
from ctc_chattering.simulation.closed_loop import Event


def parse_events(lines: Sequence[str], configs: Mapping[str, Config]) -> tuple[Event, ...]:
    """
    Return the events that `lines` describe, each "time node parameter value".

    Parameters
    ----------
    lines : sequence of str
        The value is YAML; empty lines are ignored.
    configs : mapping
        Configuration of each node that can have events, at the start of the run.

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
    current = dict(configs)
    result = []
    for time, node, name, value in events:
        before, current[node] = current[node], current[node].changed({name: value})
        spec = before.parameters()[name]
        old, new = (getattr(config, spec.field) for config in (before, current[node]))
        # A file that names a large change confirms it.
        steps = change_steps(spec, old, new, len(before.as_mapping()['joint_names'])
                             ) if node == 'controller' else [new]
        result += [Event(time, node, {name: step}) for step in steps]
    return tuple(result)

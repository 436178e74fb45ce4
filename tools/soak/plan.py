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

"""The faults of a soak test, chosen at random from a seed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
import random
from typing import Any, TypeVar

from ctc_chattering.configuration.node_parameters import LOOP, NODES
from ctc_chattering.configuration.topics import (
    CLOCK,
    COMMANDS,
    JOINT_STATES,
    JOINT_TRAJECTORY,
    REFERENCE,
)
from ctc_chattering.control.laws.registry import LAWS, SWITCHINGS
from ctc_chattering.parameters import Parameter

_Card = TypeVar('_Card')

#: The processes under test.
PROCESSES = ('recorder', *LOOP)

#: Kinds of faults.
KILL = 'SIGKILL'
STOP = 'SIGSTOP'
MALFORMED = 'malformed messages'
PLAUSIBLE = 'second publisher'
ALONE = 'malformed messages, owner stopped'
VALID = 'valid parameters'
INVALID = 'invalid parameters'
ENABLE = '~/enable'
RESET = '~/reset'
TRIP = 'error_limit, ~/reset'
#: Waypoints; no node of the graph publishes them.
WAYPOINTS = f'reference/{JOINT_TRAJECTORY}'
#: The node that publishes a topic.
OWNERS = {JOINT_STATES: 'plant', COMMANDS: 'controller', REFERENCE: 'reference'}

#: Pause between two faults, and before the first [s].
PAUSE = (1.5, 4.0)
#: Part of the run in which processes are killed. Afterwards they keep running, so that a growth
#: of their memory can be measured.
KILLING = 1.0 / 3.0
#: Least time after the kills in which each process is stopped once for as long as any is: others
#: then keep the messages for it, which is the most memory that they take for that [s].
LEAST_MARKED = 120.0
#: Duration of a fault; of KILL, the time until the process is started again [s]. `ALONE` exceeds
#: the lease of the middleware: the malformed messages then have the only publisher.
DURATIONS = {KILL: (0.0, 1.0), STOP: (0.05, 2.0), MALFORMED: (0.2, 1.0), PLAUSIBLE: (0.5, 2.0),
             ALONE: (2.2, 4.0), VALID: (0.5, 2.0), ENABLE: (0.1, 2.0), TRIP: (0.1, 1.0)}
LONGEST_STOP = DURATIONS[STOP][1]
#: Targets of every kind: processes or topics.
TARGETS: dict[str, Sequence[str]] = {
    KILL: PROCESSES, STOP: PROCESSES, MALFORMED: (*OWNERS, WAYPOINTS, CLOCK),
    PLAUSIBLE: (COMMANDS, JOINT_STATES), ALONE: tuple(OWNERS),
    **dict.fromkeys((VALID, INVALID), ('plant', 'controller')),
    **dict.fromkeys((ENABLE, RESET, TRIP), ('controller',))}
#: The kinds besides `KILL`, as often as they occur in one round.
_KINDS = (STOP, STOP, MALFORMED, MALFORMED, MALFORMED, MALFORMED, PLAUSIBLE, ALONE, VALID, INVALID,
          ENABLE, RESET, TRIP)
#: Values that a parameter may take while the loop runs: an interval, or choices.
_RANGES: dict[str, dict[str, Any]] = {
    'controller': {
        'law': LAWS, 'switching': SWITCHINGS, 'kp': (60.0, 150.0), 'kv': (30.0, 70.0),
        'ka': (10.0, 14.0), 'lambda': (5.0, 15.0), 'boundary_layer': (0.01, 0.1),
        'observer_bandwidth': (300.0, 1500.0), 'effort_limit': (300.0, 500.0),
        'effort_rate_limit': (1e4, 1e6), 'anti_windup': (False, True),
        'state_decimation': (5, 10, 50)},
    'plant': {
        'coulomb_friction': (5.0, 9.9), 'viscous_friction': (0.0, 1.0),
        'stribeck_friction': (0.0, 1.0), 'disturbance.amplitude': (0.0, 1.0),
        'disturbance.frequency': (0.0, 5.0), 'fault_damping': (10.0, 40.0),
        'command_timeout': (0.05, 0.2)},
}


@dataclasses.dataclass(frozen=True)
class Fault:
    """
    One fault.

    Attributes
    ----------
    at : float
        Earliest time since the graph runs [s].
    kind, target : str
        What is done, and to which process or topic.
    lasts : float
        Duration [s].
    values : tuple of (str, object)
        Parameters to set.
    seed : int
        For the messages.

    """

    at: float
    kind: str
    target: str
    lasts: float = 0.0
    values: tuple[tuple[str, Any], ...] = ()
    seed: int = 0

    def __str__(self) -> str:
        """Return it on one line."""
        values = ', '.join(f'{name} = {value!r}' for name, value in self.values)
        return f'{self.kind} {self.target} for {self.lasts:.2f} s {values}'.strip()


def plan(seed: int, duration: float) -> list[Fault]:
    """
    Return the faults of a run, the same for the same arguments.

    Every kind occurs once before any occurs again, and so does every target of a kind. In the
    first third of the run every other fault is a kill. Then each process is stopped, for as long
    as any is, unless the run is short.

    Parameters
    ----------
    seed : int
        Seed of all that is random.
    duration : float
        Of the run [s].

    """
    rng = random.Random(seed)
    kinds = _shuffled(rng, _KINDS)
    targets = {kind: _shuffled(rng, names) for kind, names in TARGETS.items()}
    faults: list[Fault] = []
    marked = (1.0 - KILLING) * duration > LEAST_MARKED
    to_stop = rng.sample(PROCESSES, len(PROCESSES)) if marked else []
    t = 0.0
    while True:
        t += rng.uniform(*PAUSE)
        killing = t < KILLING * duration
        kind = KILL if killing and len(faults) % 2 == 0 else next(kinds)
        target = next(targets[kind])
        lasts = rng.uniform(*DURATIONS.get(kind, (0.0, 0.0)))
        if not killing and to_stop:
            kind, target, lasts = STOP, to_stop.pop(), LONGEST_STOP
        values: tuple[tuple[str, Any], ...] = ()
        if kind in (VALID, INVALID):
            values = (_valid if kind == VALID else _invalid)(rng, target)
        if t + lasts >= duration:
            return faults
        faults.append(Fault(t, kind, target, lasts, values, rng.randrange(1 << 31)))
        t += lasts


def _shuffled(rng: random.Random, cards: Sequence[_Card]) -> Iterator[_Card]:
    """Yield the cards in random order, again and again."""
    while True:
        yield from rng.sample(cards, len(cards))


def _valid(rng: random.Random, node: str) -> tuple[tuple[str, Any], ...]:
    """Return one to three parameters with allowed values."""
    result: list[tuple[str, Any]] = []
    for name in rng.sample(sorted(_RANGES[node]), rng.randint(1, 3)):
        values, kind = _RANGES[node][name], NODES[node].parameters()[name].kind
        if kind == 'float[]':
            result.append((name, [rng.uniform(*values) for _ in range(2)]))
        else:
            result.append((name, rng.uniform(*values) if kind == 'float' else rng.choice(values)))
    return tuple(result)


def _invalid(rng: random.Random, node: str) -> tuple[tuple[str, Any], ...]:
    """Return three parameters, each of which must be refused."""
    specs = NODES[node].parameters()
    names = rng.sample(sorted(specs), 2)
    return (('nonsense', 1.0), *((name, _refused(rng, specs[name])) for name in names))


def _refused(rng: random.Random, spec: Parameter) -> Any:
    """Return a value that is not allowed."""
    if spec.kind.startswith('str'):
        return 7
    return rng.choice([float('nan'), 'many', *([-1.0] if spec.kind == 'float'
                                               and spec.minimum >= 0.0 else [])])

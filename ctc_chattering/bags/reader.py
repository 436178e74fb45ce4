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
Reading the run that a bag holds.

Positions and velocities are those of the states. Commands have no stamps: where each state has
one command that answers it they stand at the states, and otherwise when they were received. The
law is recomputed only in the first case, and only where that gives every recorded torque and term;
otherwise its terms are those that the controller published.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

from ctc_chattering.analysis.result import Replay, ReplayVerdict, Result
from ctc_chattering.analysis.signals import PARTS, Series, SignalOrigin
from ctc_chattering.analysis.terms import RunTerms, terms
from ctc_chattering.bags.bag import Bag
from ctc_chattering.bags.columns import ColumnSink, joint_values, read_topics
from ctc_chattering.bags.motion import JOINT_STATE, MULTI_ARRAY, Signal, SignalTopic
from ctc_chattering.bags.recorded_reference import Instants, RecordedReference, ReferenceSink
from ctc_chattering.bags.recording import answers, BRIDGED, ordered
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import as_ctc_error, CtcError
from ctc_chattering.numerics.angles import unwrapped_beside
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import missing, NANOSECONDS, period_ns, seconds
from ctc_chattering.ros import topics
from ctc_chattering.simulation.closed_loop import Run
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np

#: Most samples over which the law is recomputed: five seconds of processor time in plain Python.
MOST_REPLAYED = 100_000
#: Part of the largest value by which a term that is recomputed may differ from the recorded one:
#: machine code and Python round differently.
ROUNDING = 1e-6
#: Endings of the names of a bag's files.
_FILES_OF_BAGS = ('metadata.yaml', '.mcap', '.db3', '.mcap.zstd', '.db3.zstd')
#: States at the end of a bag whose answers it may lack, where a recorder was stopped.
_IN_FLIGHT = 2
#: Topics of what the controller publishes of every Nth sample.
_TRACKING = f'controller/{topics.TRACKING}'
_FILTER = f'controller/{topics.FILTER}'
_TORQUES = f'controller/{topics.TORQUES}'


def read_bag(path: str | Path, model: str | type = '', law: str | type = '',
             switching: str | type = '') -> Result:
    """
    Return the run that a bag holds.

    Parameters
    ----------
    path : str or Path
        Directory of a bag of this package, as ``bringup --record`` writes it.
    model, law, switching : str or type
        Classes of your own, or ``package.module:Name``, in the place of those that the bag names:
        a bag alone runs no code.

    Returns
    -------
    Result
        As `simulate` returns it. Torques and terms that the bag lacks are nan, or computed.

    Raises
    ------
    CtcError
        If there is no bag, it cannot be read, lacks something that a run needs, or names a class
        in whose place none is given.

    """
    path = Path(path)
    with closing(open_bag(path)) as bag, as_ctc_error(f'{path}: damaged'):
        return _run(bag, {name: value for name, value in (
            ('model', model), ('law', law), ('switching', switching)) if value})


def find_bags(directory: Path) -> list[Path]:
    """
    Return the bags below a directory, sorted; none if it is a bag itself, or a file.

    Damaged bags that `ctc repair` has kept are left out.
    """
    bags = {x.parent for x in directory.rglob('*')
            if x.name.endswith(_FILES_OF_BAGS) and x.is_file()}
    return [] if directory in bags else sorted(x for x in bags if x.suffix != '.damaged')


def _run(bag: Bag, own: Mapping[str, object]) -> Result:
    """Return the run; `own` stands in the place of classes that the bag names."""
    if len(bag.namespaces) > 1:
        raise CtcError(f'{bag.path}: runs of several robots: '
                       f'{", ".join(f"{x}/controller" for x in bag.namespaces)}; copy the topics '
                       'of one of them by rosbags-convert --include-topic, or record one')
    history = bag.parameters('controller', ControllerConfig, own)
    if not history:
        raise CtcError(f'{bag.path}: not a bag of this package: no message on '
                       f'controller/{topics.PARAMETERS}')
    since, config = history[0]
    names, period = config.joint_names, period_ns(config.control_period)
    signals, reference, start = _read(bag, names)
    states = _states(signals[topics.JOINT_STATES], since, period,
                     f'{bag.path}: {topics.JOINT_STATES}')
    if not len(states.stamps):
        raise CtcError(f'{bag.path}: no state on {topics.JOINT_STATES} that was answered')
    # A recorder that is started during a run receives states before the first reference.
    states = states.where(slice(int(np.searchsorted(states.stamps, start)), None))
    if not len(reference.t) or not len(states.stamps):
        raise CtcError(f'{bag.path}: no {topics.REFERENCE} for the states')
    history = _in_force(history, int(states.stamps[0]), int(states.stamps[-1]))
    t = (states.stamps - start) / NANOSECONDS
    configs = [(seconds(instant - start), x) for instant, x in history]
    description = bag.description()
    model = model_of(config, description)
    continuous = config.which_are_continuous(model.continuous)
    reference = reference.with_turns(continuous)
    points = reference.at(states.stamps)
    commands, published = signals[topics.COMMANDS], _published(signals, len(names))
    tau = _torques(commands, published, states)
    q, dq = states.values
    q_d, dq_d, ddq_d = points.transpose(1, 0, 2)
    long_gaps = np.flatnonzero(missing(t, config.control_period) > BRIDGED) + 1
    q = unwrapped_beside(t, q, dq, q_d, continuous, long_gaps.tolist())
    run = Run(t, q, dq, q_d, dq_d, ddq_d, tau, np.zeros_like(q))
    plants = bag.parameters('plant', PlantConfig, {'friction_model': '', **own})
    torque, replay, law_terms = None, Replay(ReplayVerdict.NOT_ONE_TO_ONE), None
    if _is_one_to_one(tau):
        replay, law_terms = _replay(
            run, configs, description, published, start,
            _ahead(reference, states.stamps, period, config.input_delay))
    else:
        torque = _torque(commands, published, states, start)
    law_terms = law_terms or published.terms(start)
    return Result(
        (plants[0][1].experiment if plants else '') or bag.path.name, configs,
        dataclasses.replace(run, v=_at_states(law_terms, run)), law_terms, description,
        bag.path.resolve().name, commands=torque, replay=replay,
        topics=_topics(law_terms.origin, len(commands.logged) > 0),
        off_reference=_off_reference(signals[_TRACKING], reference, start, period))


def _in_force(history: Sequence[tuple[int, Any]], first: int, last: int) -> list[tuple[int, Any]]:
    """Return the configurations that were in force from one instant to another [ns]."""
    begins = sum(instant <= first for instant, _ in history[1:])
    return [item for item in history[begins:] if item[0] <= max(last, history[begins][0])]


class RecordedTopics(NamedTuple):
    """
    Signals and reference of a bag, read in one pass.

    Attributes
    ----------
    signals : dict of str to Signal
        By topic.
    reference : RecordedReference
        At all instants.
    start : int
        Instant of its first point [ns].

    """

    signals: dict[str, Signal]
    reference: RecordedReference
    start: int


def _read(bag: Bag, joints: tuple[str, ...]) -> RecordedTopics:
    """Return all signals of some joints, and their reference."""
    terms_of_joints = (f'{joint}/{term}' for term in (*PARTS, 'commanded') for joint in joints)
    wanted = {
        topics.JOINT_STATES: (JOINT_STATE, ('position', 'velocity'), joints),
        topics.COMMANDS: (MULTI_ARRAY, ('data',), joints),
        _TORQUES: (JOINT_STATE, ('effort',), (*terms_of_joints, 'V')),
        _FILTER: (JOINT_STATE, ('velocity',), joints),
        _TRACKING: (JOINT_STATE, ('position',), tuple(f'{x}/desired' for x in joints))}
    sinks = {topic: ColumnSink(topic, message_type, joint_values(fields, names))
             for topic, (message_type, fields, names) in wanted.items()}
    reference = ReferenceSink(joints)
    read_topics(bag, [*sinks.values(), reference])
    signals = {topic: _signal(bag, sinks[topic], fields, names)
               for topic, (_, fields, names) in wanted.items()}
    return RecordedTopics(signals, reference.reference(), reference.start)


def _signal(bag: Bag, sink: ColumnSink, fields: tuple[str, ...], joints: tuple[str, ...]
            ) -> Signal:
    """Return the joints' values of messages in which all are finite, whatever their layouts."""
    columns = sink.columns()
    if columns is None:
        connections = tuple(x for x in bag.named(sink.name) if x.msgtype == sink.message_type)
        signal = SignalTopic(
            bag, sink.name, sink.message_type, fields, connections).read(joints)
    else:
        signal = Signal(
            columns.logged, columns.stamps, tuple(columns.values.transpose(1, 0, 2)))
    return signal.where(np.isfinite(np.hstack(signal.values)).all(axis=1))


def _states(states: Signal, since: int, period: int, name: str) -> Signal:
    """
    Return the states from time `since` [ns] on, each stamp once, sorted by their stamps.

    Few states that stand alone are left out, and two publishers are refused: `ordered`.
    """
    states = states.where(states.stamps >= since)
    if len(states.stamps) < 3:
        return states
    q, dq = states.values
    return states.where(ordered(name, (states.stamps - since) / NANOSECONDS, q, dq,
                                period=period / NANOSECONDS))


class Published(NamedTuple):
    """
    Torques and terms of every Nth sample, as the controller published them.

    Attributes
    ----------
    torques : Signal
        Nominal, compensation, robust and commanded, each of shape (N, n) [N·m], and V [J].
    filtered : Signal
        v, shape (M, n) [rad/s].

    """

    torques: Signal
    filtered: Signal

    @property
    def commanded(self) -> Array:
        """Return the torques sent, shape (N, n) [N·m]."""
        return self.torques.values[len(PARTS)]

    def terms(self, start: int) -> RunTerms:
        """Return the terms at times from `start` [ns] on; nan where one is not known."""
        stamps = np.union1d(self.torques.stamps, self.filtered.stamps)
        stamps = stamps[stamps >= start]

        def column(signal: Signal, values: Array) -> Array:
            rows = np.full((len(stamps), *values.shape[1:]), np.nan)
            _, row, message = np.intersect1d(stamps, signal.stamps, return_indices=True)
            rows[row] = values[message]
            return rows
        nominal, compensation, robust, tau, energy = (
            column(self.torques, values) for values in self.torques.values)
        origin = SignalOrigin.RECORDED if len(stamps) else SignalOrigin.UNKNOWN
        return RunTerms((stamps - start) / NANOSECONDS, tau, nominal, -compensation, -robust,
                        column(self.filtered, self.filtered.values[0]), energy[:, 0], origin)


def _published(signals: Mapping[str, Signal], n: int) -> Published:
    """Return what the controller published of `n` joints."""
    torques = signals[_TORQUES]
    columns = np.split(torques.values[0], n * np.arange(1, len(PARTS) + 2), axis=1)
    return Published(torques._replace(values=tuple(columns)), signals[_FILTER])


def _torques(commands: Signal, published: Published, states: Signal) -> Array:
    """
    Return the torque that answers each state, shape (N, n); nan where it is unknown.

    The controller publishes every Nth with the stamp of its state. Commands, which have no stamps,
    stand where `answers` is sure of them, and not beside one that differs from what was published.
    """
    matched = answers(commands.values[0], commands.logged, states.stamps, states.logged)
    tau = np.where(matched.own[:, None] & (matched.late[1] == 0.0), matched.command, np.nan)
    _, state, message = np.intersect1d(
        states.stamps, published.torques.stamps, return_indices=True)
    differ = (np.abs(tau[state] - published.commanded[message]) > 0.0).any(axis=1)
    next_published = np.searchsorted(state, np.arange(len(tau)))
    tau[np.append(differ, False)[next_published]
        | np.append(False, differ)[next_published]] = np.nan
    tau[state] = published.commanded[message]
    return tau


def _is_one_to_one(tau: Array) -> bool:
    """Return whether each state has a torque that answers it, but for some that end a bag."""
    unknown = np.flatnonzero(~np.isfinite(tau).all(axis=1))
    return len(unknown) < len(tau) and not (unknown < len(tau) - _IN_FLIGHT).any()


def _torque(commands: Signal, published: Published, states: Signal, start: int) -> Series:
    """Return the torques sent when they were received, or those published without any command."""
    if not len(commands.logged):
        stamps = published.torques.stamps
        return Series((stamps - start) / NANOSECONDS, published.commanded,
                      SignalOrigin.RECORDED if len(stamps) else SignalOrigin.UNKNOWN)
    t = _reception_times(commands.logged, states, start)
    order = np.argsort(t, kind='stable')
    order = order[t[order] >= (states.stamps[0] - start) / NANOSECONDS]
    origin = SignalOrigin.RECORDED if len(order) else SignalOrigin.UNKNOWN
    return Series(t[order], commands.values[0][order], origin, received=True)


def _reception_times(logged: Instants, states: Signal, start: int) -> Array:
    """
    Return when messages were received, on the clock of the states' stamps, shape (M,) [s].

    A message that was received between two states stands between their stamps, whatever clock the
    recorder has.
    """
    received = np.maximum.accumulate(states.logged - states.logged[0])
    since = logged - states.logged[0]
    between = np.interp(since, received, states.stamps - start)
    beyond = np.maximum(since - received[-1], 0) + np.minimum(since, 0)
    times: Array = (between + beyond) / NANOSECONDS
    return times


def _ahead(reference: RecordedReference, stamps: Instants, period: int, delay: int) -> Array:
    """Return what is desired at the samples of the delay, shape (N, delay, 3, n)."""
    return np.stack([reference.at(stamps + k * period) for k in range(1, delay + 1)], axis=1) if (
        delay) else np.zeros((len(stamps), 0))


def _replay(run: Run, configs: Sequence[tuple[float, ControllerConfig]], description: str,
            published: Published, start: int, ahead: Array) -> tuple[Replay, RunTerms | None]:
    """Return the terms of the law over all states, if they are all that was recorded of them."""
    if len(run.t) > MOST_REPLAYED:
        return Replay(ReplayVerdict.TOO_LONG), None
    computed = terms(run, configs, model_of(configs[0][1], description), ahead)
    recorded = published.terms(start)
    _, state, message = np.intersect1d(computed.t, recorded.t, return_indices=True)
    pairs = [(computed.tau, run.tau), *(
        (getattr(computed, name)[state], getattr(recorded, name)[message])
        for name in (*PARTS, 'tau', 'v', 'lyapunov'))]
    if all(_agree(*pair) for pair in pairs):
        return Replay(ReplayVerdict.EXACT), computed
    difference = np.sqrt(np.nanmean(np.square(computed.tau - run.tau), axis=0))
    return Replay(ReplayVerdict.OTHER_TORQUES, tuple(difference.tolist())), None


def _agree(computed: Array, recorded: Array) -> bool:
    """Return whether values are those recorded, where they are known, except for rounding."""
    is_known = np.isfinite(recorded)
    if not is_known.any():
        return True
    largest = float(np.abs(recorded[is_known]).max())
    return bool((np.abs(computed - recorded)[is_known] <= ROUNDING * max(largest, 1e-9)).all())


def _at_states(law_terms: RunTerms, run: Run) -> Array:
    """Return v at the states, shape (N, n); nan where it is not known."""
    v = np.full_like(run.q, np.nan)
    _, state, sample = np.intersect1d(run.t, law_terms.t, return_indices=True)
    v[state] = law_terms.v[sample]
    return v


def _off_reference(tracking: Signal, reference: RecordedReference, start: int, period: int
                   ) -> tuple[float, float] | None:
    """
    Return when the controller did not follow the reference, first and last time [s].

    Where it does, what it desired differs from the reference at the stamp of a state by what that
    moves in a period, at most: the controller takes states at its samples.
    """
    tracking = tracking.where(tracking.stamps >= start)
    if not len(reference.t) or not len(tracking.stamps):
        return None
    position, velocity, acceleration = reference.at(tracking.stamps).transpose(1, 0, 2)
    h = seconds(period)
    allowed = h * (np.abs(velocity) + h * np.abs(acceleration)) + ROUNDING
    differs = (np.abs(tracking.values[0] - position) > allowed).any(axis=1)
    times = (tracking.stamps[differs] - start) / NANOSECONDS
    return (float(times[0]), float(times[-1])) if len(times) else None


def _topics(terms_origin: SignalOrigin, has_commands: bool) -> dict[str, str]:
    """Return the topics that each signal is taken or computed from."""
    states = topics.JOINT_STATES
    states_and_reference = f'{states}, {topics.REFERENCE}'
    is_computed = terms_origin is SignalOrigin.COMPUTED
    return {'q': states, 'dq': states, 'q_d': states_and_reference, 'e': states_and_reference,
            'torque': topics.COMMANDS if has_commands else _TORQUES,
            'v': states_and_reference if is_computed else _FILTER,
            **dict.fromkeys(
                (*PARTS, 'V'), states_and_reference if is_computed else _TORQUES)}

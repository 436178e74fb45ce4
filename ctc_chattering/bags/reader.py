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
Reading the run in a bag of this package.

`read_bag` is called by `ctc plot`, `ctc export` and `ctc live`. Its inputs are the topics that the
nodes publish. Positions and velocities are those of the states. `recorded_law.py` says which
torques and terms of the law are known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
import dataclasses
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.result import Result
from ctc_chattering.analysis.signals import PARTS, SignalOrigin
from ctc_chattering.analysis.terms import Replay, ReplayVerdict
from ctc_chattering.bags.bag import Bag
from ctc_chattering.bags.bag_files import is_complete, METADATA
from ctc_chattering.bags.recorded_law import (
    answers_to_states,
    is_one_to_one,
    published_terms,
    received_torques,
    replay_law,
    ROUNDING,
    rows_at,
)
from ctc_chattering.bags.recorded_reference import read_reference, RecordedReference
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.bags.signals import (
    Instants,
    JOINT_STATE,
    MULTI_ARRAY,
    read_signals,
    Signal,
    SignalTopic,
)
from ctc_chattering.bags.state_order import order_states, STAMP_LIMITS
from ctc_chattering.configuration import topics
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import as_ctc_error, CtcError
from ctc_chattering.numerics.angles import TURN, unwrapped, unwrapped_beside
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import missing, NANOSECONDS, period_ns, seconds
from ctc_chattering.simulation.closed_loop import Run
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np

#: Endings of the names of a bag's files.
_FILE_ENDINGS = (METADATA, '.mcap', '.db3', '.mcap.zstd', '.db3.zstd')
#: Topics of what the controller publishes of every Nth sample.
TRACKING_TOPIC = f'controller/{topics.TRACKING}'
_FILTER = f'controller/{topics.FILTER}'
_TORQUES = f'controller/{topics.TORQUES}'


def read_bag(
        path: str | Path,
        model: str | type = '',
        law: str | type = '',
        switching: str | type = '') -> Result:
    """
    Return the run in a bag.

    Parameters
    ----------
    path : str or Path
        Directory of a bag of this package, as ``bringup --record`` writes it.
    model, law, switching : str or type
        Classes of your own, or ``package.module:Name``, for those that the bag names. Without
        them nothing is imported, since a bag never loads code.

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
    classes = {'model': model, 'law': law, 'switching': switching}
    with closing(open_bag(path)) as bag, as_ctc_error(f'{path}: damaged'):
        return _read_run(bag, {name: value for name, value in classes.items() if value})


def find_bags(directory: Path) -> list[Path]:
    """
    Return the bags below a directory, sorted.

    A bag itself, or a file, has none below it. Damaged bags that `ctc repair` has kept are left
    out.
    """
    files = [x for x in directory.rglob('*') if x.name.endswith(_FILE_ENDINGS)]
    bags = {x.parent for x in files if x.is_file()}
    if directory in bags:
        return []
    return sorted(x for x in bags if x.suffix != '.damaged')


def _read_run(bag: Bag, replacements: Mapping[str, object]) -> Result:
    """Return the run, with user classes for those that the bag names."""
    history = read_configs(bag, replacements)
    since, config = history[0]
    period = period_ns(config.control_period)
    signals = read_run_signals(bag, config.joint_names)
    reference = read_reference(bag, config.joint_names)
    start = reference.start
    states = _order(bag, signals[topics.JOINT_STATES], since, period)
    # A recorder that is started during a run receives states before the first reference.
    states = states.select(states.stamps >= start)
    if not len(reference.t) or not len(states.stamps):
        raise CtcError(f'{bag.path}: no {topics.REFERENCE} for the states')
    first, last = states.stamps[[0, -1]].tolist()
    history = _select_in_force(history, first, last)
    configs = [(seconds(instant - start), x) for instant, x in history]
    config = configs[0][1]
    description = bag.description()
    model = model_of(config, description)
    continuous = config.which_are_continuous(model.continuous)
    reference = reference.with_turns(continuous)

    t = (states.stamps - start) / NANOSECONDS
    q, dq = states.values
    q_d, dq_d, ddq_d = reference.at(states.stamps).transpose(1, 0, 2)
    desired = read_reference(bag, config.joint_names, topics.DESIRED)
    tracking = signals[TRACKING_TOPIC]
    if any(continuous) and len(tracking.stamps):
        q = unwrapped(t, q, dq, continuous)
        q = _follow_controller(states.stamps, q, tracking, continuous)
    else:
        is_after_gap = missing(t, config.control_period) > STAMP_LIMITS.max_bridged_samples
        gaps = np.flatnonzero(is_after_gap) + 1
        q = unwrapped_beside(t, q, dq, q_d, continuous, gaps.tolist())
    commands = signals[topics.COMMANDS]
    published = published_terms(signals[_TORQUES], signals[_FILTER], start)
    nothing_dropped = is_complete(bag.path, (topics.JOINT_STATES, topics.COMMANDS))
    tau = answers_to_states(commands, published, states, t, nothing_dropped)
    run = Run(
        t,
        q,
        dq,
        q_d,
        dq_d,
        ddq_d,
        tau,
        v=np.full_like(q, np.nan),
        correction=reference.correction_at(states.stamps, desired))

    torque = None
    replay = Replay(ReplayVerdict.NOT_ONE_TO_ONE)
    law_terms = None
    if is_one_to_one(tau):
        ahead = _desired_ahead(reference, states.stamps, period, config.input_delay)
        replay, law_terms = replay_law(run, configs, model, published, ahead)
    else:
        torque = received_torques(commands, published, states, start)
    law_terms = law_terms or published
    v = rows_at(t, law_terms.t, law_terms.v)
    run = dataclasses.replace(run, v=v)
    own_classes = {'friction_model': '', **replacements}
    plants = bag.parameters('plant', PlantConfig, own_classes)
    experiment = plants[0][1].experiment if plants else ''
    return Result(
        experiment or bag.path.name,
        configs,
        run,
        law_terms,
        description,
        bag.path.resolve().name,
        commands=torque,
        replay=replay,
        topics=_source_topics(law_terms.origin, len(commands.logged) > 0),
        off_reference=_find_off_reference(tracking, reference, period))


def read_configs(
        bag: Bag,
        replacements: Mapping[str, object]) -> list[tuple[int, ControllerConfig]]:
    """Return the controller's configurations and their times [ns]."""
    if len(bag.namespaces) > 1:
        raise CtcError(f'{bag.path}: the bag has runs of several robots: '
                       f'{", ".join(f"{x}/controller" for x in bag.namespaces)}; copy the topics '
                       'of one of them by rosbags-convert --include-topic, or record one '
                       'robot')
    history = bag.parameters('controller', ControllerConfig, replacements)
    if not history:
        raise CtcError(f'{bag.path}: this package did not record the bag: there is no message on '
                       f'controller/{topics.PARAMETERS}')
    return history


def _select_in_force(
        history: Sequence[tuple[int, Any]],
        first: int,
        last: int) -> list[tuple[int, Any]]:
    """Return the configurations in force between two instants [ns]."""
    begins = sum(instant <= first for instant, _ in history[1:])
    initial, *changes = history[begins:]
    return [initial, *(item for item in changes if item[0] <= last)]


def read_run_signals(bag: Bag, joints: tuple[str, ...]) -> dict[str, Signal]:
    """
    Return the joints' signals by topic.

    Messages with values that are not finite are left out.
    """
    terms = [f'{joint}/{term}' for term in (*PARTS, 'commanded') for joint in joints]
    tracked = [f'{joint}/{term}' for term in ('desired', 'error') for joint in joints]
    columns = {
        topics.JOINT_STATES: (JOINT_STATE, ('position', 'velocity'), joints),
        topics.COMMANDS: (MULTI_ARRAY, ('data',), joints),
        _TORQUES: (JOINT_STATE, ('effort',), (*terms, 'V')),
        _FILTER: (JOINT_STATE, ('velocity',), joints),
        TRACKING_TOPIC: (JOINT_STATE, ('position',), tuple(tracked))}
    requests = []
    for name, (message_type, fields, names) in columns.items():
        connections = tuple(x for x in bag.named(name) if x.msgtype == message_type)
        topic = SignalTopic(bag, name, message_type, fields, connections)
        requests.append((topic, names))
    signals = (x.select_finite() for x in read_signals(bag, requests))
    return dict(zip(columns, signals))


def _order(bag: Bag, states: Signal, since: int, period: int) -> Signal:
    """Return the states from `since` [ns] on, in order."""
    states = states.select(states.stamps >= since)
    if not len(states.stamps):
        raise CtcError(f'{bag.path}: no state on {topics.JOINT_STATES} was answered by a torque')
    if len(states.stamps) < 3:
        return states
    name = f'{bag.path}: {topics.JOINT_STATES}'
    t = (states.stamps - since) / NANOSECONDS
    return states.select(order_states(name, t, *states.values, period=seconds(period)))


def _follow_controller(
        stamps: Instants,
        q: Array,
        tracking: Signal,
        continuous: Sequence[bool]) -> Array:
    """
    Return positions with the turns that the controller counted.

    It counts them anew after an outage, and says so by its desired position and error. Before and
    after the outage, the nearest of its samples counts.
    """
    instants, row, sample = np.intersect1d(stamps, tracking.stamps, return_indices=True)
    if not len(instants):
        return q
    desired, error = np.hsplit(tracking.values[0][sample], 2)
    measured = desired - error
    turns = np.rint((measured - q[row]) / TURN)
    turns[:, np.invert(continuous)] = 0.0
    middle = (instants[1:] + instants[:-1]) // 2
    nearest = np.searchsorted(middle, stamps)
    positions: Array = q + TURN * turns[nearest]
    return positions


def _desired_ahead(
        reference: RecordedReference,
        stamps: Instants,
        period: int,
        delay: int) -> Array:
    """Return the points at the samples of the delay, shape (N, delay, 3, n)."""
    ahead = period * np.arange(1, 1 + delay)
    instants = stamps[:, np.newaxis] + ahead
    points = reference.at(instants.ravel())
    return points.reshape(*instants.shape, 3, points.shape[-1])


def _find_off_reference(
        tracking: Signal,
        reference: RecordedReference,
        period: int) -> tuple[float, float] | None:
    """
    Return when the controller left the reference, first and last time [s].

    The controller takes states at its samples. So its desired position differs from the reference
    at the stamp of a state by no more than the reference moves in a period.
    """
    tracking = tracking.select(tracking.stamps >= reference.start)
    position, velocity, acceleration = reference.at(tracking.stamps).transpose(1, 0, 2)
    h = seconds(period)
    fastest = np.abs(velocity) + h * np.abs(acceleration)
    allowed = h * fastest + ROUNDING
    desired = tracking.values[0][:, :position.shape[1]]
    difference = np.abs(desired - position)
    is_off = (difference > allowed).any(axis=1)
    if not is_off.any():
        return None
    times = (tracking.stamps[is_off] - reference.start) / NANOSECONDS
    return float(times[0]), float(times[-1])


def _source_topics(terms_origin: SignalOrigin, has_commands: bool) -> dict[str, str]:
    """Return the topics behind each signal."""
    states = topics.JOINT_STATES
    states_and_reference = f'{states}, {topics.REFERENCE}'
    is_computed = terms_origin is SignalOrigin.COMPUTED
    term_topics = states_and_reference if is_computed else _TORQUES
    return {
        'q': states,
        'dq': states,
        'q_d': states_and_reference,
        'e': states_and_reference,
        'torque': topics.COMMANDS if has_commands else _TORQUES,
        'v': states_and_reference if is_computed else _FILTER,
        **dict.fromkeys((*PARTS, 'V'), term_topics)}

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

"""Reading the run that a bag holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
import dataclasses
import itertools
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.result import Result
from ctc_chattering.analysis.terms import BRIDGED, terms
from ctc_chattering.bags.bag import Bag
from ctc_chattering.bags.motion import JOINT_STATE, MULTI_ARRAY, Signal, SignalTopic, STATE_FIELDS
from ctc_chattering.bags.recording import answers, ordered
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError, refused_as, RejectedMessage
from ctc_chattering.numerics.angles import unwrapped_beside
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import (
    missing,
    NANOSECONDS,
    nanoseconds,
    period_ns,
    seconds,
)
from ctc_chattering.ros import topics
from ctc_chattering.ros.topics import select
from ctc_chattering.simulation.closed_loop import Run
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.buffer import Trajectory
import numpy as np


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
    with closing(open_bag(path)) as bag, refused_as(f'{path}: damaged'):
        return _run(bag, {name: value for name, value in (
            ('model', model), ('law', law), ('switching', switching)) if value})


def find_bags(directory: Path) -> list[Path]:
    """
    Return the bags below a directory, sorted; none if it is a bag itself, or a file.

    Damaged bags that `ctc repair` has kept are left out.
    """
    bags = {x.parent for x in directory.rglob('*')
            if (x.name == 'metadata.yaml' or x.suffix in ('.mcap', '.db3')) and x.is_file()}
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
    states = _states(bag, names, since, period)
    if not len(states.stamps):
        raise CtcError(f'{bag.path}: no state on {topics.JOINT_STATES} that was answered')
    description = bag.description()
    model = model_of(config, description)
    continuous = config.which_are_continuous(model.continuous)
    trajectory, start = _trajectory(bag, names, continuous)
    points = [p for t in states.stamps.tolist() if (p := trajectory.at(t))]
    if not points:
        raise CtcError(f'{bag.path}: no {topics.REFERENCE} for the state at '
                       f'{seconds(int(states.stamps[0])):g} s')
    # A recorder that is started during a run receives states before the first reference.
    unknown = len(states.stamps) - len(points)
    tau = _torques(bag, names, states)[unknown:]
    q, dq, _ = states.where(slice(unknown, None)).values
    stamps = states.stamps[unknown:].tolist()
    q_d, dq_d, ddq_d = (np.array(rows) for rows in zip(*points))
    times = np.array([seconds(t - start) for t in stamps])
    long_gaps = np.flatnonzero(missing(times, config.control_period) > BRIDGED) + 1
    q = unwrapped_beside(times, q, dq, q_d, continuous, long_gaps.tolist())
    run = Run(times, q, dq, q_d, dq_d, ddq_d, tau, np.zeros_like(q))
    configs = [(seconds(t - start), x) for t, x in history]
    plants = bag.parameters('plant', PlantConfig, {'friction_model': '', **own})
    experiment = (plants[0][1].experiment if plants else '') or bag.path.name
    known = None
    if missing(times, config.control_period).any():
        published = _signal(bag, f'controller/{topics.FILTER}', JOINT_STATE, ('velocity',), names)
        known = {seconds(t - start): v for t, v in zip(
            published.stamps.tolist(), published.values[0].tolist())}
    ahead = [[trajectory.at(t + k * period) or points[-1]
              for k in range(1, config.input_delay + 1)] for t in stamps]
    computed = terms(run, configs, model, known,
                     any(plant.sample_loss for _, plant in plants), ahead)
    return Result(experiment, configs, dataclasses.replace(run, v=computed.v), computed,
                  description, bag.path.resolve().name)


def _signal(bag: Bag, name: str, kind: str, fields: tuple[str, ...], joints: tuple[str, ...]
            ) -> Signal:
    """Return our joints' values on a topic; the first two fields of a message must be finite."""
    found = SignalTopic(bag, name, kind, fields, tuple(
        x for x in bag.named(name) if x.msgtype == kind)).read(joints)
    return found.where(np.isfinite(np.hstack(found.values[:2])).all(axis=1))


def _states(bag: Bag, joints: tuple[str, ...], since: int, period: int) -> Signal:
    """
    Return the states from time `since` [ns] on, each stamp once, sorted by their stamps.

    Few states that stand alone are left out, and two publishers are refused: `ordered`.
    """
    found = _signal(bag, topics.JOINT_STATES, JOINT_STATE, STATE_FIELDS, joints)
    found = found.where(found.stamps >= since)
    if len(found.stamps) < 3:
        return found
    q, dq, _ = found.values
    return found.where(ordered(
        f'{bag.path}: {topics.JOINT_STATES}', (found.stamps - since) / NANOSECONDS, q, dq,
        period=period / NANOSECONDS))


def _trajectory(bag: Bag, joints: tuple[str, ...], continuous: Sequence[bool]
                ) -> tuple[Trajectory, int]:
    """Return the reference and the time of its first point [ns]."""
    trajectory, start = Trajectory(), 0
    trajectory.continuous = continuous
    for _, message in bag.read(bag.named(topics.REFERENCE)):
        first = nanoseconds(message.header.stamp)
        times = [first + nanoseconds(p.time_from_start) for p in message.points]
        try:
            rows: list[Any] = [select(joints, message.joint_names, *(x.tolist() for x in (
                p.positions, p.velocities, p.accelerations))) for p in message.points]
        except RejectedMessage:
            continue
        if all(a < b for a, b in itertools.pairwise(times)):
            if not len(trajectory) and times:
                start = times[0]
            trajectory.extend(times, rows)
    return trajectory, start


def _torques(bag: Bag, joints: tuple[str, ...], states: Signal) -> Array:
    """
    Return the torque that answers each state, shape (N, n); nan where it is unknown.

    The controller publishes every Nth with the stamp of its state. Commands, which have no stamps,
    stand where `answers` is sure of them, and not beside one that differs from what was published.
    """
    commands = _signal(bag, topics.COMMANDS, MULTI_ARRAY, ('data',), joints)
    found = answers(commands.values[0], commands.logged, states.stamps, states.logged)
    tau = np.where(found.own[:, None] & (found.late[1] == 0.0), found.command, np.nan)
    published = _signal(bag, f'controller/{topics.TORQUES}', JOINT_STATE, ('effort',),
                        tuple(f'{joint}/commanded' for joint in joints))
    _, mine, there = np.intersect1d(states.stamps, published.stamps, return_indices=True)
    differ = (np.abs(tau[mine] - published.values[0][there]) > 0.0).any(axis=1)
    after = np.searchsorted(mine, np.arange(len(tau)))
    tau[np.append(differ, False)[after] | np.append(False, differ)[after]] = np.nan
    tau[mine] = published.values[0][there]
    return tau

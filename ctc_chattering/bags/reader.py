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

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
import dataclasses
import itertools
from pathlib import Path
import sys
from typing import Any, NamedTuple

from ctc_chattering.analysis.result import Result
from ctc_chattering.analysis.terms import terms
from ctc_chattering.bags.bag import Bag, BagTopics, nanoseconds
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError, refused_as, RejectedMessage
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import missing, period_ns, seconds
from ctc_chattering.ros import topics
from ctc_chattering.ros.topics import select
from ctc_chattering.simulation.closed_loop import Run
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.buffer import Trajectory
import numpy as np

#: Longest step between two states that is accepted at once [periods], and the number of states
#: that must follow a longer one.
_FEW = 20


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
    with closing(open_bag(path)) as reader, refused_as(f'{path}: damaged'):
        return _RunTopics(reader, path, {name: value for name, value in (
            ('model', model), ('law', law), ('switching', switching)) if value}).result()


def find_bags(directory: Path) -> list[Path]:
    """
    Return the bags below a directory, sorted; none if it is a bag itself, or a file.

    Damaged bags that `ctc repair` has kept are left out.
    """
    if _is_bag(directory):
        return []
    return sorted(path for path in directory.rglob('*')
                  if _is_bag(path) and path.suffix != '.damaged')


def _is_bag(path: Path) -> bool:
    """Return whether a path is a directory with the files of a bag."""
    return path.is_dir() and any(
        x.name == 'metadata.yaml' or x.suffix in ('.mcap', '.db3') for x in path.iterdir())


class _StampedState(NamedTuple):
    """A joint state: stamp [ns], (position, velocity, effort), shape (3, n), and log time [ns]."""

    t: int
    row: Array
    recorded: int


class _RunTopics(BagTopics):
    """The topics of a bag with a run of this package."""

    def __init__(self, reader: Bag, path: Path, own: Mapping[str, object]) -> None:
        super().__init__(reader, path)
        self._own = own
        self._history = self.parameters('controller', ControllerConfig, own)
        if not self._history:
            raise CtcError(f'{path}: not a bag of this package: no message on '
                           f'controller/{topics.PARAMETERS}')
        config = self._history[0][1]
        self._names = config.joint_names
        self._period = period_ns(config.control_period)

    def result(self) -> Result:
        """Return the run."""
        states, repeats = self._states(self._history[0][0])
        if not states:
            raise CtcError(f'{self.path}: no state on {topics.JOINT_STATES} that was answered')
        trajectory, start = self._trajectory()
        points = [p for state in states if (p := trajectory.at(state.t))]
        if not points:
            raise CtcError(f'{self.path}: no {topics.REFERENCE} for the state at '
                           f'{seconds(states[0].t):g} s')
        # A recorder that is started during a run receives states before the first reference.
        unknown = len(states) - len(points)
        tau = self._torques(states, repeats)[unknown:]
        q, dq, _ = np.array([state.row for state in states[unknown:]]).transpose(1, 0, 2)
        q_d, dq_d, ddq_d = (np.array(rows) for rows in zip(*points))
        times = np.array([seconds(state.t - start) for state in states[unknown:]])
        run = Run(times, q, dq, q_d, dq_d, ddq_d, tau, np.zeros_like(q))
        configs = [(seconds(t - start), config) for t, config in self._history]
        plants = self.parameters('plant', PlantConfig, {'friction_model': '', **self._own})
        experiment = (plants[0][1].experiment if plants else '') or self.path.name
        description = self.description()
        known = self._filtered_error(start) if missing(
            times, configs[0][1].control_period).any() else None
        ahead = [[trajectory.at(state.t + k * self._period) or points[-1]
                  for k in range(1, configs[0][1].input_delay + 1)] for state in states[unknown:]]
        computed = terms(run, configs, model_of(configs[0][1], description), known,
                         any(plant.sample_loss for _, plant in plants), ahead)
        return Result(experiment, configs, dataclasses.replace(run, v=computed.v), computed,
                      description, self.path.resolve().name)

    def _filtered_error(self, start: int) -> dict[float, list[float]]:
        """Return v as the controller published it [rad/s] by time since `start` [s]."""
        found = {}
        for _, message in self.messages(f'controller/{topics.FILTER}'):
            (v,) = self._select(message.name, message.velocity)
            if np.isfinite(v).all():
                found[seconds(nanoseconds(message.header.stamp) - start)] = v.tolist()
        return found

    def _select(self, names: Sequence[str], *rows: Any) -> Array:
        """Return our joints' values out of rows of a message; nan if it would be rejected."""
        try:
            with np.errstate(all='ignore'):
                return np.array(select(self._names, names, *rows))
        except RejectedMessage:
            return np.full((len(rows), len(self._names)), np.nan)

    def _valid_states(self, since: int) -> Iterator[_StampedState]:
        """Yield the states from time `since` [ns] on that a controller would accept."""
        for recorded, message in self.messages(topics.JOINT_STATES):
            t = nanoseconds(message.header.stamp)
            effort = message.effort if len(message.effort) else np.zeros(len(message.name))
            row = self._select(message.name, message.position, message.velocity)
            if t >= since and np.isfinite(row).all():
                row = np.vstack((row, self._select(message.name, effort)))
                yield _StampedState(t, row, recorded)

    def _states(self, since: int) -> tuple[list[_StampedState], Counter[int]]:
        """
        Return the states, each stamp once, sorted by time, and how often one was repeated.

        A step of more than `_FEW` periods needs `_FEW` states that confirm it.
        """
        states: list[_StampedState] = []
        pending: list[_StampedState] = []
        rejected = 0
        repeats: Counter[int] = Counter()
        for state in self._valid_states(since):
            step = state.t - states[-1].t if states else 1
            if step <= 0:
                repeats[state.t] += step == 0 and np.array_equal(state.row, states[-1].row)
            elif not states or step <= _FEW * self._period:
                states.append(state)
                pending, rejected = [], 0
            elif not pending or (
                    self._period <= 2 * (state.t - pending[-1].t) <= 2 * _FEW * self._period):
                pending.append(state)
                if len(pending) == _FEW:
                    states += pending
                    pending = []
            else:
                rejected += 1
                if rejected > 10 * _FEW:
                    pending, rejected = [], 0
        return states, repeats

    def _trajectory(self) -> tuple[Trajectory, int]:
        """Return the reference and the time of its first point [ns]."""
        trajectory, start = Trajectory(), 0
        for _, message in self.messages(topics.REFERENCE):
            first = nanoseconds(message.header.stamp)
            times = [first + nanoseconds(p.time_from_start) for p in message.points]
            rows = [self._select(message.joint_names, p.positions, p.velocities, p.accelerations)
                    for p in message.points]
            if np.isfinite(rows).all() and all(a < b for a, b in itertools.pairwise(times)):
                if not len(trajectory) and times:
                    start = times[0]
                trajectory.extend(times, [row.tolist() for row in rows])
        return trajectory, start

    def _commands(self, states: Sequence[_StampedState], repeats: Counter[int]
                  ) -> tuple[list[Array], list[int]]:
        """Return torques and log times [ns], without those that answer a repeated state."""
        commands: list[Array] = []
        recorded: list[int] = []
        left = 0
        for t, message in self.messages(topics.COMMANDS):
            labels = [dim.label for dim in message.layout.dim] or self._names
            (tau,) = self._select(labels, message.data)
            if not np.isfinite(tau).all():
                continue
            if left and np.array_equal(tau, commands[-1]):
                left -= 1
                continue
            left = repeats[states[min(len(commands), len(states) - 1)].t]
            commands.append(tau)
            recorded.append(t)
        return commands, recorded

    def _torques(self, states: Sequence[_StampedState], repeats: Counter[int]) -> Array:
        """
        Return the torque that answers each state; nan where it is unknown.

        Commands have no stamp. If there are as many as states, as in lockstep, they answer them
        one by one. Otherwise the torque is the effort in the next state; if that state is missing
        or has no effort, it is the first command recorded after the state, unless that came later
        than usual.
        """
        commands, recorded = self._commands(states, repeats)
        if len(commands) == len(states):
            return np.array(commands)
        effort = np.array([state.row[2] for state in states])
        tau = np.full_like(effort, np.nan)
        consecutive = missing(np.array([state.t for state in states], float), self._period) == 0
        tau[:-1][consecutive] = effort[1:][consecutive]
        times = np.array([state.recorded for state in states])
        answer = np.searchsorted(recorded, times)
        delay = np.array([*recorded, sys.maxsize])[answer] - times
        # A command that comes later than usual may answer a state that is missing.
        latest = np.median(delay) + 0.5 * np.median(np.diff(times, append=times[-1:]))
        until_next = np.append(times[1:], sys.maxsize) - times
        known = (delay < until_next) & (delay <= latest)
        for k in np.flatnonzero(known & ~np.isfinite(tau).all(axis=1)).tolist():
            tau[k] = commands[answer[k]]
        if not np.isfinite(tau[-1]).all():
            tau[-1] = effort[-1]
        return tau

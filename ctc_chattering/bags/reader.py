"""Reading the run that a bag holds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
import dataclasses
import itertools
from pathlib import Path
import sys
from typing import Any, NamedTuple

import numpy as np

from ctc_chattering.analysis.result import Result
from ctc_chattering.analysis.terms import terms
from ctc_chattering.bags.repair import BagReader, open_bag
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.gaps import missing
from ctc_chattering.numerics.time_grid import NANOSECONDS, period_ns, seconds
from ctc_chattering.ros.topics import (
    COMMANDS,
    FILTER,
    JOINT_STATES,
    PARAMETERS,
    REFERENCE,
    ROBOT_DESCRIPTION,
)
from ctc_chattering.simulation.closed_loop import Run
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.buffer import Trajectory

#: Longest step between two states that is accepted at once [periods], and the number of states
#: that must follow a longer one.
_FEW = 20
#: Field of a ParameterValue that holds the value, by its type.
_FIELDS = {1: 'bool_value', 2: 'integer_value', 3: 'double_value', 4: 'string_value',
           8: 'double_array_value', 9: 'string_array_value'}


def read_bag(path: Path) -> Result:
    """
    Return the run that a bag holds.

    Parameters
    ----------
    path : Path
        Directory of the bag.

    Raises
    ------
    CtcError
        If there is no bag, it cannot be read, or it lacks something that a run needs.

    """
    reader = open_bag(path)
    try:
        return _Topics(reader, path).result()
    except CtcError:
        raise
    except Exception as error:
        text = ' '.join(str(error).split())
        raise CtcError(f'{path}: damaged: {type(error).__name__}: {text}') from None
    finally:
        reader.close()


def find_bags(directory: Path) -> list[Path]:
    """
    Return the bags below a directory, sorted; none if it is a bag itself, or a file.

    Damaged bags that `ctc repair` has kept are left out.
    """
    if not directory.is_dir() or _is_bag(directory):
        return []
    return sorted(path for path in directory.rglob('*')
                  if path.is_dir() and _is_bag(path) and path.suffix != '.damaged')


def _is_bag(path: Path) -> bool:
    """Return whether a directory contains the files of a bag."""
    return (path / 'metadata.yaml').exists() or any(
        next(path.glob(pattern), None) is not None for pattern in ('*.mcap', '*.db3'))


class _State(NamedTuple):
    """A joint state: stamp [ns], (position, velocity, effort), shape (3, n), and log time [ns]."""

    t: int
    row: np.ndarray[Any, Any]
    recorded: int


@dataclasses.dataclass(frozen=True)
class _States:
    """Joint states in the controller's order of joints, each stamp once, sorted by time."""

    t: list[int]
    q: np.ndarray[Any, Any]
    dq: np.ndarray[Any, Any]
    effort: np.ndarray[Any, Any]
    #: Log times [ns].
    recorded: list[int]
    #: Number of times that the state of a stamp was repeated, by stamp.
    repeats: Counter[int]


class _Topics:
    """The topics of one open bag, in any namespace."""

    def __init__(self, reader: BagReader, path: Path) -> None:
        self._reader = reader
        self._path = path

    def result(self) -> Result:
        """Return the run."""
        history = self._parameters('controller', ControllerConfig)
        if not history:
            raise CtcError(f'{self._path}: not a bag of this package: no message on '
                           f'controller/{PARAMETERS}')
        names = history[0][1].joint_names
        period = period_ns(history[0][1].control_period)
        states = self._states(names, history[0][0], period)
        if not states.t:
            raise CtcError(f'{self._path}: no state on {JOINT_STATES} that was answered')
        trajectory, start = self._trajectory(names)
        points = [p for t in states.t if (p := trajectory.at(t))]
        if not points:
            raise CtcError(f'{self._path}: no {REFERENCE} for the state at '
                           f'{seconds(states.t[0]):g} s')
        # A recorder that is started during a run receives states before the first reference.
        unknown = len(states.t) - len(points)
        q, dq, tau = (x[unknown:] for x in (
            states.q, states.dq, self._torques(names, states, period)))
        q_d, dq_d, ddq_d = (np.array(rows) for rows in zip(*points))
        times = np.array([seconds(t - start) for t in states.t[unknown:]])
        run = Run(times, q, dq, q_d, dq_d, ddq_d, tau, np.zeros_like(q))
        configs = [(seconds(t - start), config) for t, config in history]
        plants = self._parameters('plant', PlantConfig)
        experiment = (plants[0][1].experiment if plants else '') or self._path.name
        description = self._description()
        known = None
        if missing(times, history[0][1].control_period).any():
            known = self._filtered_error(names, start)
        computed = terms(run, configs, model_of(history[0][1], description), known,
                         any(plant.sample_loss for _, plant in plants))
        return Result(experiment, configs, dataclasses.replace(run, v=computed.v), computed,
                      description, self._path.resolve().name)

    def _description(self) -> str:
        """Return the robot description that the controller published; empty for none."""
        texts = [message.data for _, message in self._messages(f'controller/{ROBOT_DESCRIPTION}')]
        return texts[-1] if texts else ''

    def _filtered_error(self, names: Sequence[str], start: int) -> dict[float, list[float]]:
        """Return v as the controller published it [rad/s] by time since `start` [s]."""
        found = {}
        for _, message in self._messages(f'controller/{FILTER}'):
            order = _order(message.name, names)
            if order is not None and _fit(len(message.name), [message.velocity]):
                v = message.velocity[order]
                if np.isfinite(v).all():
                    found[seconds(_nanoseconds(message.header.stamp) - start)] = v.tolist()
        return found

    def _messages(self, name: str) -> Iterator[tuple[int, Any]]:
        """Yield log time [ns] and message of a topic, without those that cannot be decoded."""
        connections = [x for x in self._reader.connections
                       if x.topic == name or x.topic.endswith('/' + name)]
        for connection, t, data in self._reader.messages(connections) if connections else ():
            try:
                message = self._reader.deserialize(data, connection.msgtype)
            except Exception:  # Of arbitrary bytes, decoders raise arbitrary exceptions.
                continue
            yield t, message

    def _parameters(self, node: str, kind: Any) -> list[tuple[int, Any]]:
        """Return the configurations of a node, each with the time [ns] from which it applies."""
        known = kind.parameters()
        values: dict[str, Any] = {}
        history: list[tuple[int, Any]] = []
        for _, message in self._messages(f'{node}/{PARAMETERS}'):
            for item in [*message.new_parameters, *message.changed_parameters]:
                if item.name in known and item.value.type in _FIELDS:
                    value = getattr(item.value, _FIELDS[item.value.type])
                    values[item.name] = value.tolist() if hasattr(value, 'tolist') else value
            config = kind.from_mapping(values)
            if not history or history[-1][1] != config:
                history.append((_nanoseconds(message.stamp), config))
        return history

    def _valid_states(self, names: Sequence[str], since: int) -> Iterator[_State]:
        """Yield the states from time `since` [ns] on that a controller would accept."""
        for recorded, message in self._messages(JOINT_STATES):
            t = _nanoseconds(message.header.stamp)
            order = _order(message.name, names)
            effort = message.effort if len(message.effort) else np.zeros(len(message.name))
            arrays = message.position, message.velocity, effort
            if t >= since and order is not None and _fit(len(message.name), arrays):
                row = np.array([x[order] for x in arrays])
                if np.isfinite(row[:2]).all():
                    yield _State(t, row, recorded)

    def _states(self, names: Sequence[str], since: int, period: int) -> _States:
        """Return the states; a step of more than `_FEW` periods needs `_FEW` that confirm it."""
        states: list[_State] = []
        pending: list[_State] = []
        rejected = 0
        repeats: Counter[int] = Counter()
        for state in self._valid_states(names, since):
            step = state.t - states[-1].t if states else 1
            if step <= 0:
                repeats[state.t] += step == 0 and np.array_equal(state.row, states[-1].row)
            elif not states or step <= _FEW * period:
                states.append(state)
                pending, rejected = [], 0
            elif not pending or period <= 2 * (state.t - pending[-1].t) <= 2 * _FEW * period:
                pending.append(state)
                if len(pending) == _FEW:
                    states += pending
                    pending = []
            else:
                rejected += 1
                if rejected > 10 * _FEW:
                    pending, rejected = [], 0
        table = np.array([x.row for x in states]).reshape(len(states), 3, len(names))
        return _States([x.t for x in states], table[:, 0], table[:, 1], table[:, 2],
                       [x.recorded for x in states], repeats)

    def _trajectory(self, names: Sequence[str]) -> tuple[Trajectory, int]:
        """Return the reference and the time of its first point [ns]."""
        trajectory, start = Trajectory(), 0
        for _, message in self._messages(REFERENCE):
            first = _nanoseconds(message.header.stamp)
            order = _order(message.joint_names, names)
            times = [first + _nanoseconds(p.time_from_start) for p in message.points]
            rows = [(p.positions, p.velocities, p.accelerations) for p in message.points]
            if order is None or any(b <= a for a, b in itertools.pairwise(times)) or not all(
                    _fit(len(message.joint_names), row) and np.isfinite(row).all()
                    for row in rows):
                continue
            if not len(trajectory) and times:
                start = times[0]
            trajectory.extend(
                times, [tuple(x[order].tolist() for x in row) for row in rows])
        return trajectory, start

    def _commands(self, names: Sequence[str], states: _States
                  ) -> tuple[list[np.ndarray[Any, Any]], list[int]]:
        """Return torques and log times [ns], without those that answer a repeated state."""
        commands: list[np.ndarray[Any, Any]] = []
        recorded: list[int] = []
        repeats = 0
        for t, message in self._messages(COMMANDS):
            labels = [dim.label for dim in message.layout.dim] or list(names)
            order = _order(labels, names)
            if order is None or not _fit(len(labels), [message.data]):
                continue
            tau = message.data[order]
            if not np.isfinite(tau).all():
                continue
            if repeats and np.array_equal(tau, commands[-1]):
                repeats -= 1
                continue
            repeats = states.repeats[states.t[min(len(commands), len(states.t) - 1)]]
            commands.append(tau)
            recorded.append(t)
        return commands, recorded

    def _torques(self, names: Sequence[str], states: _States, period: int
                 ) -> np.ndarray[Any, Any]:
        """
        Return the torque that answers each state; nan where it is unknown.

        Commands have no stamp. If there are as many as states, as in lockstep, they answer them
        one by one. Otherwise the torque is the effort in the next state; if that state is missing
        or has no effort, it is the first command recorded after the state, unless that came later
        than usual.
        """
        commands, recorded = self._commands(names, states)
        if len(commands) == len(states.t):
            return np.array(commands)
        tau = np.full_like(states.effort, np.nan)
        consecutive = missing(np.array(states.t, float), period) == 0
        tau[:-1][consecutive] = states.effort[1:][consecutive]
        times = np.array(states.recorded)
        answer = np.searchsorted(recorded, times)
        delay = np.array([*recorded, sys.maxsize])[answer] - times
        # A command that comes later than usual may answer a state that is missing.
        latest = np.median(delay) + 0.5 * np.median(np.diff(times, append=times[-1:]))
        until_next = np.append(times[1:], sys.maxsize) - times
        known = (delay < until_next) & (delay <= latest)
        for k in np.flatnonzero(known & ~np.isfinite(tau).all(axis=1)).tolist():
            tau[k] = commands[answer[k]]
        if not np.isfinite(tau[-1]).all():
            tau[-1] = states.effort[-1]
        return tau


def _order(found: Sequence[str], names: Sequence[str]) -> list[int] | None:
    """Return the index of each joint in a message; None if a name is missing or doubled."""
    if len(set(found)) != len(found) or not set(names) <= set(found):
        return None
    return [found.index(name) for name in names]


def _fit(n: int, rows: Sequence[Any]) -> bool:
    """Return whether each row has a number for each of `n` joints."""
    return all(len(row) == n for row in rows)


def _nanoseconds(time: Any) -> int:
    return int(time.sec) * NANOSECONDS + int(time.nanosec)

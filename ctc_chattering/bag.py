"""Reading a bag of the graph back into a run, with nothing but the bag."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
import dataclasses
import itertools
from pathlib import Path
import sys
from typing import Any

import numpy as np
from rosbags.interfaces import Connection

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.core.gaps import missing
from ctc_chattering.core.grid import NANOSECONDS, period_ns, seconds
from ctc_chattering.core.models import model_of
from ctc_chattering.core.plant import PlantConfig
from ctc_chattering.core.simulation import Run
from ctc_chattering.core.terms import terms
from ctc_chattering.core.trajectory import Trajectory
from ctc_chattering.errors import CtcError
from ctc_chattering.graph import (
    COMMANDS,
    FILTER,
    JOINT_STATES,
    PARAMETERS,
    REFERENCE,
    ROBOT_DESCRIPTION,
)
from ctc_chattering.result import Result
from ctc_chattering.salvage import BagReader, open_bag

#: Periods between two states that are no outage, and states that must follow a longer one.
_FEW = 20
#: Which field of a ParameterValue holds the value, by its type.
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
        If there is no bag, it cannot be read, or something is not in it that a run needs.

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

    What `ctc repair` has put aside is left out.
    """
    if not directory.is_dir() or _is_bag(directory):
        return []
    return sorted(path for path in directory.rglob('*')
                  if path.is_dir() and _is_bag(path) and path.suffix != '.damaged')


def _is_bag(path: Path) -> bool:
    """Return whether a directory has what a bag is made of."""
    return (path / 'metadata.yaml').exists() or any(
        next(path.glob(pattern), None) is not None for pattern in ('*.mcap', '*.db3'))


@dataclasses.dataclass(frozen=True)
class _States:
    """Joint states in the controller's order, each stamp once, in the order of time."""

    t: list[int]
    q: np.ndarray[Any, Any]
    dq: np.ndarray[Any, Any]
    effort: np.ndarray[Any, Any]
    #: When each was recorded [ns].
    heard: list[int]
    #: How many times the last one of a stamp was sent again, by stamp.
    again: Counter[int]


class _Topics:
    """The topics of one open bag; namespaces in front of their names do not matter."""

    def __init__(self, reader: BagReader, path: Path) -> None:
        self._reader = reader
        self._path = path

    def result(self) -> Result:
        """Put the run together."""
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
        # A recorder that comes amid a run hears states before it hears the reference.
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
        computed = terms(run, configs, model_of(history[0][1], description), known)
        return Result(experiment, configs, dataclasses.replace(run, v=computed.v), computed,
                      description, self._path.resolve().name)

    def _description(self) -> str:
        """Return the description of the robot that the controller published; empty for none."""
        texts = [message.data for message in self._messages(f'controller/{ROBOT_DESCRIPTION}')]
        return texts[-1] if texts else ''

    def _filtered_error(self, names: Sequence[str], start: int) -> dict[float, list[float]]:
        """Return v as the controller published it [rad/s] by time since `start` [s]."""
        found = {}
        for _, message in self._readable(f'controller/{FILTER}'):
            order = _order(message.name, names)
            if order is not None and _fit(len(message.name), [message.velocity]):
                v = message.velocity[order]
                if np.isfinite(v).all():
                    found[seconds(_nanoseconds(message.header.stamp) - start)] = v.tolist()
        return found

    def _connections(self, name: str) -> list[Connection]:
        return [x for x in self._reader.connections
                if x.topic == name or x.topic.endswith('/' + name)]

    def _messages(self, name: str) -> Iterator[Any]:
        connections = self._connections(name)
        if connections:
            for connection, _, data in self._reader.messages(connections):
                yield self._reader.deserialize(data, connection.msgtype)

    def _readable(self, name: str) -> Iterator[tuple[int, Any]]:
        """
        Yield when each message of a topic was recorded [ns], and the message.

        Anybody may have published anything there; what is no message is left out.
        """
        connections = self._connections(name)
        for connection, t, data in self._reader.messages(connections) if connections else ():
            try:
                message = self._reader.deserialize(data, connection.msgtype)
            except Exception:  # Whatever a decoder makes of bytes that are no message.
                continue
            yield t, message

    def _parameters(self, node: str, kind: Any) -> list[tuple[int, Any]]:
        """Return the configurations of a node with the stamps [ns] they are in force from."""
        known = kind.parameters()
        values: dict[str, Any] = {}
        history: list[tuple[int, Any]] = []
        for message in self._messages(f'{node}/{PARAMETERS}'):
            for item in [*message.new_parameters, *message.changed_parameters]:
                if item.name in known and item.value.type in _FIELDS:
                    value = getattr(item.value, _FIELDS[item.value.type])
                    values[item.name] = value.tolist() if hasattr(value, 'tolist') else value
            config = kind.from_mapping(values)
            if not history or history[-1][1] != config:
                history.append((_nanoseconds(message.stamp), config))
        return history

    def _states(self, names: Sequence[str], since: int, period: int) -> _States:
        leap: list[tuple[int, Any, int]] = []
        strays = 0
        times: list[int] = []
        rows: list[Any] = []
        heard: list[int] = []
        again: Counter[int] = Counter()
        for recorded, message in self._readable(JOINT_STATES):
            t = _nanoseconds(message.header.stamp)
            order = _order(message.name, names)
            effort = message.effort if len(message.effort) else np.zeros(len(message.name))
            arrays = message.position, message.velocity, effort
            if t < since or order is None or not _fit(len(message.name), arrays[:2]):
                continue
            if len(effort) != len(message.name):
                continue
            row = [x[order] for x in arrays]
            if not np.isfinite(row[:2]).all():
                continue
            if times and t <= times[-1]:
                again[t] += t == times[-1] and np.array_equal(row, rows[-1])
                continue
            if times and t - times[-1] > _FEW * period:
                # Not believed before many have gone on from there.
                if not leap or period <= 2 * (t - leap[-1][0]) <= 2 * _FEW * period:
                    leap.append((t, row, recorded))
                else:
                    strays += 1
                    if strays > 10 * _FEW:
                        leap, strays = [], 0
                if len(leap) < _FEW:
                    continue
            else:
                leap, strays = [(t, row, recorded)], 0
            times += [instant for instant, _, _ in leap]
            rows += [values for _, values, _ in leap]
            heard += [moment for _, _, moment in leap]
            leap = []
        table = np.array(rows).reshape(len(rows), 3, len(names))
        return _States(times, table[:, 0], table[:, 1], table[:, 2], heard, again)

    def _trajectory(self, names: Sequence[str]) -> tuple[Trajectory, int]:
        """Return the desired motion and the instant of its first point [ns]."""
        trajectory, start = Trajectory(), 0
        for _, message in self._readable(REFERENCE):
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

    def _torques(self, names: Sequence[str], states: _States, period: int
                 ) -> np.ndarray[Any, Any]:
        """
        Return the torque that answers each state; nan where it is not known.

        Commands carry no stamp. Where there is one for every state, as in lockstep, they answer
        them in turn, a state that was sent again more than once. Otherwise the torque is the one
        that the next state says was applied; where that state is missing, or does not say, it is
        the first command recorded after it, if that came as soon as usual.
        """
        commands: list[Any] = []
        recorded: list[int] = []
        surplus = 0
        for t, message in self._readable(COMMANDS):
            labels = [dim.label for dim in message.layout.dim] or list(names)
            order = _order(labels, names)
            if order is not None and _fit(len(labels), [message.data]) and np.isfinite(
                    message.data[order]).all():
                tau = message.data[order]
                if surplus and np.array_equal(tau, commands[-1]):
                    surplus -= 1
                    continue
                surplus = states.again[states.t[min(len(commands), len(states.t) - 1)]]
                commands.append(tau)
                recorded.append(t)
        if len(commands) == len(states.t):
            return np.array(commands)
        tau = np.full_like(states.effort, np.nan)
        follows = missing(np.array(states.t, float), period) == 0
        tau[:-1][follows] = states.effort[1:][follows]
        heard = np.array(states.heard)
        answer = np.searchsorted(recorded, heard)
        delay = np.array([*recorded, sys.maxsize])[answer] - heard
        # A command that comes later than usual may answer a state that is missing.
        latest = np.median(delay) + 0.5 * np.median(np.diff(heard, append=heard[-1:]))
        ends = np.append(heard[1:], sys.maxsize) - heard
        known = (delay < ends) & (delay <= latest)
        for k in np.flatnonzero(known & ~np.isfinite(tau).all(axis=1)).tolist():
            tau[k] = commands[answer[k]]
        if not np.isfinite(tau[-1]).all():
            tau[-1] = states.effort[-1]
        return tau


def _order(theirs: Sequence[str], ours: Sequence[str]) -> list[int] | None:
    """Return where our joints stand among those of a message; None if it cannot be used."""
    if len(set(theirs)) != len(theirs) or not set(ours) <= set(theirs):
        return None
    return [theirs.index(name) for name in ours]


def _fit(n: int, rows: Sequence[Any]) -> bool:
    """Return whether each row has a number for each of `n` joints."""
    return all(len(row) == n for row in rows)


def _nanoseconds(time: Any) -> int:
    return int(time.sec) * NANOSECONDS + int(time.nanosec)

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
Torques and terms of the law in a recorded run.

Commands have no stamps. Where each state has one command that answers it, they stand at the
states. Otherwise they stand where they were received. The law is recomputed only in the first
case, and only where that gives every recorded torque and term. Otherwise its terms are those that
the controller published of every Nth sample. `bags/reader.py` calls this with the signals of a
bag.
"""

from __future__ import annotations

from collections.abc import Sequence, Sized

from ctc_chattering.analysis.signals import PARTS, Series, SignalOrigin
from ctc_chattering.analysis.terms import Replay, ReplayVerdict, RunTerms, terms
from ctc_chattering.bags.command_matching import find_single, match_commands
from ctc_chattering.bags.signals import Instants, Signal
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Array, Flags
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.simulation.closed_loop import Run
import numpy as np

#: Longest run over which the law is recomputed: five seconds of processor time in plain Python.
MAX_REPLAYED_SAMPLES = 100_000
#: Largest relative difference of a recomputed term. Machine code and Python round differently.
ROUNDING = 1e-6
#: Terms below this are 0 [N·m, rad/s or J].
_SMALLEST_TERM = 1e-9
#: Last states of a bag that may lack their answers, where a recorder was stopped.
_UNANSWERED_STATES = 2


def published_terms(torques: Signal, filtered: Signal, start: int) -> RunTerms:
    """
    Return the terms that the controller published.

    A term is nan where it is unknown.

    Parameters
    ----------
    torques : Signal
        Nominal, compensation, robust and commanded torques of n joints [N·m], and V [J], in one
        array of shape (N, 4 n + 1).
    filtered : Signal
        v, shape (M, n) [rad/s].
    start : int
        Instant of the time 0 [ns]. Earlier samples are left out.

    """
    stamps = np.union1d(torques.stamps, filtered.stamps)
    stamps = stamps[stamps >= start]
    columns = rows_at(stamps, torques.stamps, torques.values[0])
    v = rows_at(stamps, filtered.stamps, filtered.values[0])
    begins = v.shape[1] * np.arange(1, 5)
    nominal, compensation, robust, tau, energy = np.split(columns, begins, axis=1)
    return RunTerms(
        (stamps - start) / NANOSECONDS,
        tau=tau,
        nominal=nominal,
        compensation=-compensation,
        robust=-robust,
        v=v,
        lyapunov=energy[:, 0],
        origin=_origin(stamps))


def rows_at(times: Array | Instants, sample_times: Array | Instants, values: Array) -> Array:
    """
    Return the samples at some times.

    A row for each time, nan without a sample.
    """
    rows = np.full((len(times), *values.shape[1:]), np.nan)
    _, row, sample = np.intersect1d(times, sample_times, return_indices=True)
    rows[row] = values[sample]
    return rows


def answers_to_states(
        commands: Signal,
        published: RunTerms,
        states: Signal,
        t: Array,
        is_complete: bool) -> Array:
    """
    Return the torque that answers each state.

    Its shape is (N, n) [N·m], and it is nan where it is unknown.

    Commands of a complete bag are told by their order, however late they were received. Others
    stand where `match_commands` is sure of them. They do not stand next to one that differs from
    the torque published with the stamp of its state.

    Parameters
    ----------
    commands : Signal
        Commanded torques, shape (M, n) [N·m].
    states : Signal
        States in order.
    published : RunTerms
        Terms that the controller published.
    t : ndarray, shape (N,)
        Times of the states [s].
    is_complete : bool
        Whether the recorder has lost no state and no command.

    """
    stamped = rows_at(t, published.t, published.tau)
    is_stamped = np.asarray(np.isfinite(stamped).all(axis=1))
    if is_complete:
        counted = _in_order(commands, len(t))
        if _agrees_exactly(counted, stamped, is_stamped):
            return counted
    answers = match_commands(
        commands.values[0],
        commands.logged,
        states.stamps,
        states.logged)
    is_sure = answers.late[1] == 0.0
    is_certain = answers.is_own & is_sure
    tau = answers.command
    tau[~is_certain] = np.nan
    difference = np.abs(tau - stamped)
    is_other = difference[is_stamped] > 0.0
    differs = is_other.any(axis=1)
    next_stamped = np.cumsum(is_stamped) - is_stamped
    # Of the stamped torques before and after each state.
    is_doubtful = np.append(differs, False)[next_stamped]
    is_doubtful |= np.append(False, differs)[next_stamped]
    tau[is_doubtful] = np.nan
    tau[is_stamped] = stamped[is_stamped]
    return tau


def _in_order(commands: Signal, states: int) -> Array:
    """Return single commands in the order of their reception, shape (M, n) [N·m]."""
    order = np.argsort(commands.logged, kind='stable')
    values: Array = commands.values[0][order]
    return values[find_single(values, states)]


def _agrees_exactly(counted: Array, stamped: Array, is_stamped: Flags) -> bool:
    """Return whether commands are as many as the states, with each torque of a known state."""
    is_comparable = len(counted) == len(stamped) and is_stamped.any()
    return bool(is_comparable and (counted[is_stamped] == stamped[is_stamped]).all())


def is_one_to_one(tau: Array) -> bool:
    """Return whether each state but the last has its torque."""
    is_known = np.asarray(np.isfinite(tau).all(axis=1))
    is_complete = is_known[:-_UNANSWERED_STATES].all()
    return bool(is_complete and is_known.any())


def received_torques(commands: Signal, published: RunTerms, states: Signal, start: int) -> Series:
    """
    Return the torques by the times of their reception.

    Without commands, those published are returned.
    """
    if not len(commands.logged):
        is_known = np.isfinite(published.tau).all(axis=1)
        t = published.t[is_known]
        tau = published.tau[is_known]
        return Series(t, tau, _origin(t))
    t = _reception_times(commands.logged, states, start)
    begin = (states.stamps[0] - start) / NANOSECONDS
    order = np.argsort(t, kind='stable')
    order = order[t[order] >= begin]
    torques = commands.values[0][order]
    return Series(t[order], torques, _origin(order), received=True)


def _origin(samples: Sized) -> SignalOrigin:
    """Return the origin of recorded samples, unknown without any."""
    return SignalOrigin.RECORDED if len(samples) else SignalOrigin.UNKNOWN


def _reception_times(logged: Instants, states: Signal, start: int) -> Array:
    """
    Return reception times on the stamps' clock, shape (M,) [s].

    A message that was received between two states stands between their stamps, whatever clock the
    recorder has.
    """
    first = states.logged[0]
    received = np.maximum.accumulate(states.logged - first)
    since = logged - first
    between = np.interp(since, received, states.stamps - start)
    beyond = since - since.clip(0, received[-1])
    times: Array = (between + beyond) / NANOSECONDS
    return times


def replay_law(
        run: Run,
        configs: Sequence[tuple[float, ControllerConfig]],
        model: Model,
        published: RunTerms,
        ahead: Array) -> tuple[Replay, RunTerms | None]:
    """
    Recompute the law over all states.

    Its terms are returned if they agree with all that was recorded.
    """
    if len(run.t) > MAX_REPLAYED_SAMPLES:
        return Replay(ReplayVerdict.TOO_LONG), None
    computed = terms(run, configs, model, ahead)
    agrees = _agree(computed.tau, run.tau)
    for name in (*PARTS, 'tau', 'v', 'lyapunov'):
        recorded = rows_at(run.t, published.t, getattr(published, name))
        agrees = agrees and _agree(getattr(computed, name), recorded)
    if agrees:
        return Replay(ReplayVerdict.EXACT), computed
    squares = np.square(computed.tau - run.tau)
    mean = np.nanmean(squares, axis=0)
    difference = tuple(np.sqrt(mean).tolist())
    return Replay(ReplayVerdict.OTHER_TORQUES, difference), None


def _agree(computed: Array, recorded: Array) -> bool:
    """Return whether values are the recorded ones, except for rounding."""
    is_known = np.isfinite(recorded)
    computed = computed[is_known]
    recorded = recorded[is_known]
    magnitude = np.abs(recorded)
    largest = float(magnitude.max(initial=_SMALLEST_TERM))
    difference = np.abs(computed - recorded)
    return bool((difference <= ROUNDING * largest).all())

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
A recording is checked before anything is computed of it, put in order, and cut at its gaps.

Commands without stamps are put in the places of the states that they answer.
"""

from __future__ import annotations

from ctc_chattering.bags.recording import Answers, answers, ordered, Recording, stretches
from ctc_chattering.errors import CtcError
import numpy as np
import pytest

H, N = 1e-3, 6000
T = H * np.arange(N)
TIMES = T[:3000]
Q = np.stack((np.sin(TIMES), np.cos(2.0 * TIMES)), axis=1)
TAU = np.stack((TIMES, -TIMES), axis=1)


def recording(t: np.ndarray = TIMES, q: np.ndarray = Q, tau: np.ndarray | None = TAU) -> Recording:
    return Recording('run', ('a', 'b'), t, q, None, None, tau)


def test_positions_that_are_not_finite_are_refused_by_joint_and_time() -> None:
    q = Q.copy()
    q[1234, 1] = np.nan
    with pytest.raises(CtcError, match=r'1 of 3000 states .* the first of b at 1\.234 s'):
        recording(q=q).checked()


def test_two_publishers_with_the_same_stamps_are_refused() -> None:
    t = np.repeat(TIMES, 2)
    q = np.repeat(Q, 2, axis=0)
    q[1::2] += 0.1
    with pytest.raises(CtcError, match='two publishers of joint states'):
        recording(t, q, np.repeat(TAU, 2, axis=0)).checked()


@pytest.mark.parametrize('phase', [0.05, 0.1, 0.3, 0.42])
def test_two_publishers_side_by_side_are_refused(phase: float) -> None:
    t = np.sort(np.concatenate((TIMES, TIMES + phase * H)))
    with pytest.raises(CtcError, match='two publishers of joint states'):
        recording(t, np.repeat(Q, 2, axis=0), np.repeat(TAU, 2, axis=0)).checked()


def test_jitter_is_no_second_publisher() -> None:
    t = TIMES + np.random.default_rng(0).normal(0.0, 0.1 * H, len(TIMES))
    assert recording(t).checked().period == pytest.approx(H, rel=1e-3)


def test_repeated_states_are_counted_once_and_order_is_restored() -> None:
    order = np.r_[0:100, 50:60, 100:3000]
    order[[500, 501]] = order[[501, 500]]
    found = recording(TIMES[order], Q[order], TAU[order]).checked()
    assert np.array_equal(found.t, TIMES)
    assert np.array_equal(found.q, Q)


def test_a_run_without_torque_or_with_few_samples_is_refused() -> None:
    with pytest.raises(CtcError, match='no torque'):
        recording(tau=None).checked()
    with pytest.raises(CtcError, match='no torque'):
        recording(tau=np.full_like(TAU, np.nan)).checked()
    with pytest.raises(CtcError, match='50 states; at least 200'):
        recording(TIMES[:50], Q[:50], TAU[:50]).checked()


def test_a_pause_cuts_a_run_and_missing_samples_are_bridged() -> None:
    keep = np.r_[0:1000, 1003:1500, 2000:3000]
    found = recording(TIMES[keep], Q[keep], TAU[keep]).checked()
    first, second = stretches(found, H)
    assert (len(first.q), len(second.q)) == (1500, 1000)
    assert first.q == pytest.approx(Q[:1500], abs=1e-9)
    assert second.t == pytest.approx(TIMES[2000:])
    # The torque is held where samples are missing.
    assert first.command is not None
    assert first.command[1000:1003] == pytest.approx(np.tile(TAU[999], (3, 1)))


def test_positions_between_jittering_stamps_are_those_of_the_grid() -> None:
    rng = np.random.default_rng(1)
    t = TIMES + np.clip(rng.normal(0.0, 0.1 * H, len(TIMES)), -0.4 * H, 0.4 * H)
    exact = np.stack((np.sin(t), np.cos(2.0 * t)), axis=1)
    (part,) = stretches(recording(t, exact).checked(), H)
    middle = slice(2, -2)
    assert part.q[middle] == pytest.approx(np.stack(
        (np.sin(part.t), np.cos(2.0 * part.t)), axis=1)[middle], abs=1e-11)


def order(t: np.ndarray, keep: np.ndarray | slice = slice(None)) -> np.ndarray:
    return ordered('run', t[keep], np.sin(np.arange(N))[keep, None])


def set_back(by: float) -> np.ndarray:
    return np.where(np.arange(N) >= 3000, T - by, T)


@pytest.mark.parametrize('by', [0.012, 0.35, 0.3503, 3.0])
@pytest.mark.parametrize('jitter', [0.0, 0.03, 0.1])
@pytest.mark.parametrize('loss', [0.0, 0.17])
def test_a_clock_that_is_set_back_is_refused(by: float, jitter: float, loss: float) -> None:
    rng = np.random.default_rng(1)
    t = set_back(by) + jitter * H * rng.normal(size=N)
    with pytest.raises(CtcError, match='was a clock set back'):
        order(t, rng.random(N) >= loss)
    with pytest.raises(CtcError, match='was a clock set back'):  # A recorder may sort by it.
        order(np.sort(t))


@pytest.mark.parametrize('loss', [0.0, 0.17])
def test_jitter_and_losses_are_no_second_clock(loss: float) -> None:
    rng = np.random.default_rng(3)
    kept = rng.random(N) >= loss
    t = T + 0.2 * H * rng.normal(size=N)
    assert np.array_equal(order(t, kept), np.argsort(t[kept]))


def test_late_messages_are_put_in_order() -> None:
    moved = np.arange(N)
    moved[1000:1010] = moved[1000:1010][::-1]
    moved[2000:2003] = moved[[2002, 2000, 2001]]
    assert np.array_equal(moved[order(T[moved])], np.arange(N))


@pytest.mark.parametrize('stamp', [0.0, 1e6])
def test_one_stamp_of_another_time_is_left_out(stamp: float) -> None:
    t = T.copy()
    t[4000] = stamp
    assert np.array_equal(order(t), np.delete(np.arange(N), 4000))


def test_a_slower_part_has_missing_samples() -> None:
    found = order(T, (np.arange(N) < 3600) | (np.arange(N) % 2 == 0))
    assert np.array_equal(found, np.arange(4800))


@pytest.mark.parametrize('t', [0.0 * T, np.floor(T / 0.004) * 0.004, T - 0.1 * np.floor(T / 0.2)])
def test_stamps_of_no_use_are_refused(t: np.ndarray) -> None:
    with pytest.raises(CtcError, match=r'closer than the period.*coarser than the period'):
        order(t)


COUNT, PERIOD = 20_000, 10 ** 6
STATES = PERIOD * np.arange(COUNT)


def received(late: str, rng: np.random.Generator) -> np.ndarray:
    """Return how late messages are, in order [ns]."""
    return {'never': np.zeros(COUNT), 'evenly': 0.3 * PERIOD * rng.random(COUNT),
            'at times': 2.0 * PERIOD * (rng.random(COUNT) < 0.002),
            'much': rng.exponential(0.5 * PERIOD, COUNT)}[late].astype(int)


def recorded(late: str, after: float = 0.2, states: float = 0.0, commands: float = 0.0,
             back: int = 0) -> tuple[Answers, np.ndarray]:
    """Return the answers, and which command each state had in truth; parts of them are lost."""
    rng = np.random.default_rng(1)
    number = np.arange(COUNT)
    got = np.maximum.accumulate(STATES + received(late, rng))
    sent = np.maximum.accumulate(STATES + int(after * PERIOD) + received(late, rng))
    stamps = np.where(number > COUNT // 2, STATES - back, STATES)
    left, kept = rng.random(COUNT) >= states, rng.random(COUNT) >= commands
    return answers(number[kept, None].astype(float), sent[kept], stamps[left], got[left]
                   ), number[left]


@pytest.mark.parametrize('after', [0.02, 0.2, 0.8, 0.95])
@pytest.mark.parametrize('late', ['never', 'evenly'])
def test_each_state_has_its_answer(late: str, after: float) -> None:
    found, true = recorded(late, after)
    assert np.array_equal(found.command[:, 0], true)
    assert found.late == (0.0, 0.0)


@pytest.mark.parametrize('late', ['at times', 'much'])
def test_jitter_of_the_recorder_moves_few_commands(late: str) -> None:
    found, true = recorded(late)
    assert (found.command[:, 0] != true).mean() < 0.01


def test_a_clock_that_is_set_back_moves_none() -> None:
    found, true = recorded('evenly', back=350 * PERIOD)
    assert np.array_equal(found.command[:, 0], true)


@pytest.mark.parametrize(('states', 'commands'), [(0.17, 0.0), (0.0, 0.17), (0.17, 0.17)])
def test_lost_messages_make_the_delay_uncertain_by_their_part(states: float, commands: float
                                                              ) -> None:
    found, true = recorded('evenly', states=states, commands=commands)
    known = np.isfinite(found.command[:, 0])
    shift = float((found.command[known, 0] - true[known]).mean())
    assert found.late[0] - 0.01 <= shift <= found.late[1] + 0.01
    assert (found.command[known, 0] != true[known]).mean() == pytest.approx(commands, abs=0.01)
    assert found.late[0] == pytest.approx(-0.2 * (commands > 0.0), abs=0.05)


def test_commands_that_are_received_in_batches_are_in_doubt() -> None:
    """Their times do not tell which states they answer."""
    end = STATES // (5 * PERIOD) * 5 * PERIOD + 4 * PERIOD
    found = answers(np.arange(COUNT)[:, None].astype(float), end, STATES, STATES + 1)
    assert found.late == (-1.0, 1.0)


def test_where_two_commands_stand_in_one_place_none_is_its_own() -> None:
    values = np.insert(np.arange(COUNT), 500, 499)  # Sent again.
    values = np.insert(values, 1000, -7)  # Of another publisher.
    places = np.insert(np.insert(np.arange(COUNT), 500, 499), 1000, 999)
    found = answers(values[:, None].astype(float), STATES[places], STATES, STATES)
    assert np.flatnonzero(~found.own).tolist() == [999]
    assert np.array_equal(found.command[found.own, 0], np.flatnonzero(found.own))


@pytest.mark.parametrize('loss', [0.0, 0.3])
def test_in_a_complete_bag_of_our_recorder_each_state_has_its_command(loss: float) -> None:
    """Its times are stamps: a command may have that of the state before it, or after it."""
    rng = np.random.default_rng(1)
    states = STATES[rng.random(COUNT) >= loss]
    count = np.arange(len(states))
    which = np.maximum.accumulate(count + rng.integers(-1, 2, len(states)))
    sent = states[np.clip(which, 0, len(states) - 1)]
    found = answers(count[:, None].astype(float), sent, states, states)
    assert np.array_equal(found.command[:, 0], count)
    assert found.late == (0.0, 0.0)
    assert found.own.all()


def in_lockstep(answer: float, after: float, jitter: float, stall: float, loss: float
                ) -> tuple[Answers, np.ndarray]:
    """Return the answers where each state follows a command; times in parts of a sample."""
    rng = np.random.default_rng(1)
    waits = PERIOD * rng.gamma(4.0, 0.25, (COUNT, 2)) * (answer, after)
    waits += PERIOD * rng.exponential(stall, (COUNT, 2)) * (rng.random((COUNT, 2)) < 0.01)
    sent = np.cumsum(waits.ravel()).reshape(COUNT, 2)
    late = PERIOD * rng.exponential(jitter, (COUNT, 2))
    got = np.maximum.accumulate(sent + late, axis=0).astype(int)
    left, kept = rng.random((2, COUNT)) >= loss
    # A state is sent with the second time, and the first is that of the command before.
    return answers(np.arange(1, COUNT)[kept[1:], None].astype(float), got[1:, 0][kept[1:]],
                   STATES[left], got[left, 1]), np.arange(COUNT)[left] + 1


@pytest.mark.parametrize(('answer', 'after', 'jitter', 'stall', 'loss', 'sure'), [
    (0.3, 0.2, 0.02, 0.0, 0.0, True), (0.3, 0.2, 0.06, 3.0, 0.0, True),
    (0.3, 0.03, 0.1, 0.0, 0.0, False), (0.03, 0.3, 0.1, 3.0, 0.0, False),
    (0.45, 0.05, 0.02, 20.0, 0.1, False)])
def test_answers_in_lockstep_are_counted(answer: float, after: float, jitter: float,
                                         stall: float, loss: float, sure: bool) -> None:
    """Without losses each has its place, and `late` has what is not sure of it."""
    found, true = in_lockstep(answer, after, jitter, stall, loss)
    known = np.isfinite(found.command[:, 0])
    off = found.command[known, 0] - true[known]
    assert loss or (off == 0.0).mean() > 0.98
    assert found.late[0] - 0.01 <= off.mean() <= found.late[1] + 0.01
    assert (found.late == (0.0, 0.0)) == sure

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

"""Commands without stamps stand in the rows of the states that they answer."""

from __future__ import annotations

from ctc_chattering.bags.command_matching import Answers, match_commands
import numpy as np
import pytest

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
    answers = match_commands(
        number[kept, None].astype(float), sent[kept], stamps[left], got[left])
    return answers, number[left]


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
    found = match_commands(np.arange(COUNT)[:, None].astype(float), end, STATES, STATES + 1)
    assert found.late == (-1.0, 1.0)


def test_where_two_commands_stand_in_one_place_none_is_its_own() -> None:
    values = np.insert(np.arange(COUNT), 500, 499)  # Sent again.
    values = np.insert(values, 1000, -7)  # Of another publisher.
    places = np.insert(np.insert(np.arange(COUNT), 500, 499), 1000, 999)
    found = match_commands(values[:, None].astype(float), STATES[places], STATES, STATES)
    assert np.flatnonzero(~found.is_own).tolist() == [999]
    assert np.array_equal(found.command[found.is_own, 0], np.flatnonzero(found.is_own))


@pytest.mark.parametrize('loss', [0.0, 0.3])
def test_in_a_complete_bag_of_our_recorder_each_state_has_its_command(loss: float) -> None:
    """Its times are stamps: a command may have that of the state before it, or after it."""
    rng = np.random.default_rng(1)
    states = STATES[rng.random(COUNT) >= loss]
    count = np.arange(len(states))
    which = np.maximum.accumulate(count + rng.integers(-1, 2, len(states)))
    sent = states[np.clip(which, 0, len(states) - 1)]
    found = match_commands(count[:, None].astype(float), sent, states, states)
    assert np.array_equal(found.command[:, 0], count)
    assert found.late == (0.0, 0.0)
    assert found.is_own.all()


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
    values = np.arange(1, COUNT)[kept[1:], None].astype(float)
    answers = match_commands(values, got[1:, 0][kept[1:]], STATES[left], got[left, 1])
    return answers, np.arange(COUNT)[left] + 1


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

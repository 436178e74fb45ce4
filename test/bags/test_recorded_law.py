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
What a page, its numbers and an export show of a bag is what the bag has.

Bags are read by `rosbags` alone for that.
"""

from __future__ import annotations

from collections.abc import Sequence
import json
from pathlib import Path
from typing import Any, NamedTuple

from bags import entries, Entry, nanoseconds, write_bag
from ctc_chattering.analysis.result import simulate
from ctc_chattering.analysis.signals import SignalOrigin
from ctc_chattering.analysis.terms import Replay, ReplayVerdict
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.configuration import parameter_file
from ctc_commands import ctc
from faults import load
from motion_bags import joint_state
import numpy as np
from page_samples import columns
from processes import run_bringup
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import get_typestore, Stores

COMMANDS, STATES, TORQUES, FILTER = (
    '/effort_controller/commands', '/joint_states', '/controller/torques', '/controller/filter')


class Recorded(NamedTuple):
    """Messages of a topic: log times and stamps, shape (N,) [ns], and the messages."""

    logged: Any
    stamps: Any
    messages: list[Any]

    def rows(self, field: str) -> Any:
        """Return the numbers in a field, a row a message."""
        return np.array([getattr(x, field) for x in self.messages])


def recorded(bag: Path, topic: str) -> Recorded:
    """Read a topic without our reader."""
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        found = [(t, reader.deserialize(data, x.msgtype)) for x, t, data in reader.messages(
            [x for x in reader.connections if x.topic == topic])]
    headers = [getattr(message, 'header', None) for _, message in found]
    stamps = [h.stamp.sec * 10 ** 9 + h.stamp.nanosec if h else 0 for h in headers]
    return Recorded(np.array([t for t, _ in found]), np.array(stamps), [x for _, x in found])


def check_what_is_shown(bag: Path, out: Path) -> None:
    """Assert that numbers, samples of the page and export have each command and no other."""
    done = ctc('plot', bag, '--out', out)
    assert done.returncode == 0, done.stderr
    done = ctc('export', bag, '--out', out / 'export')
    assert done.returncode == 0, done.stderr
    states, commands, torques, filtered = (
        recorded(bag, x) for x in (STATES, COMMANDS, TORQUES, FILTER))
    start = int(recorded(bag, '/reference').stamps[0])
    used = states.stamps >= start
    first = states.logged[used][0]
    sent = commands.rows('data')[commands.logged >= first]
    logged = commands.logged[commands.logged >= first]
    shown = columns(next((out / 'samples').glob('*.js')))
    n = sent.shape[1]

    # Torques: all that were sent, in order, each between the states around its reception.
    for i in range(n):
        assert np.array_equal(shown['torque', i], sent[:, i].astype('f4'))
    t = shown['t', 'torque']
    assert (np.diff(t) >= 0.0).all()
    # A run leaves out a few states that stand alone between long gaps.
    of_run = np.rint(1e9 * read_bag(bag).t).astype(np.int64)
    is_kept = np.isin(states.stamps - start, of_run)
    assert is_kept.sum() == len(of_run) > 0.95 * used.sum()
    stamps, received = (states.stamps[is_kept] - start) / 1e9, states.logged[is_kept]
    before = np.searchsorted(received, logged, side='right') - 1
    inside = (logged < received[-1]) & (logged > received[0])
    assert (t[inside] >= stamps[before[inside]] - 1e-9).all()
    assert (t[inside] <= stamps[before[inside] + 1] + 1e-9).all()

    # Terms: those published, at the stamps of their states.
    kept = torques.stamps >= start
    assert np.array_equal(shown['t', 'nominal'], (torques.stamps[kept] - start) / 1e9)
    for k, part in enumerate(('nominal', 'compensation', 'robust')):
        for i in range(n):
            assert np.array_equal(
                shown[part, i], torques.rows('effort')[kept, n * k + i].astype('f4')), part
    assert np.array_equal(shown['V', 0], torques.rows('effort')[kept, -1].astype('f4'))
    for i in range(n):
        assert np.array_equal(shown['v', i], filtered.rows('velocity')[
            filtered.stamps >= start, i].astype('f4'))

    # Numbers: of all commands in the window.
    (numbers,) = json.loads((out / 'metrics.json').read_text())['runs']
    low, high = numbers['window_s']
    part = (t >= low - 1e-9) & (t <= high + 1e-9)
    step = np.abs(np.diff(sent[part], axis=0))
    assert numbers['torque_variation_nm_per_s'] == pytest.approx(
        step.sum(axis=0) / (t[part][-1] - t[part][0]))
    assert numbers['max_torque_step_nm'] == step.max(axis=0).tolist()
    period = numbers['control_period_s']
    assert (np.array(numbers['max_torque_rate_nm_per_s']) <= step.max(axis=0) / period).all()
    assert numbers['rms_torque_nm'] == pytest.approx(np.sqrt(np.square(sent[part]).mean(axis=0)))
    assert numbers['origins'] == {
        **dict.fromkeys(('q_d', 'e'), 'computed exactly'),
        **dict.fromkeys(('q', 'dq', 'torque', 'v', 'V', 'nominal', 'compensation', 'robust'),
                        'recorded')}

    with np.load(out / 'export' / 'trajectory.npz') as exported:
        assert np.array_equal(exported['command'], sent)
        assert np.array_equal(exported['command_t'], t)
        assert np.array_equal(exported['nominal'], torques.rows('effort')[kept, :n])
        known = np.isfinite(exported['tau']).all(axis=1)
        of_state = dict(zip(torques.stamps.tolist(), torques.rows('effort')[:, 3 * n:4 * n]))
        for time, tau in zip(exported['t'][known], exported['tau'][known]):
            stamp = start + round(time * 1e9)
            assert stamp not in of_state or np.array_equal(tau, of_state[stamp])
        assert known.sum() >= np.isin(torques.stamps - start, of_run).sum()


@pytest.mark.ros
@pytest.mark.slow
def test_real_time_on_a_busy_machine(tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    with load(2):
        status, output = run_bringup(
            '--record', str(bag), '--pacing', 'real_time', '--duration', '3')
    assert status == 0, output
    check_what_is_shown(bag, tmp_path / 'out')
    page = (tmp_path / 'out' / 'index.html').read_text()
    assert 'Origin of the samples' in page
    assert 'each when the recorder received it' in page


SETUP = parameter_file.load(None, {'/**': {'compiled': False}, 'plant': {'duration': 1.0}})
RESULT = simulate(SETUP)
START = 1_700_000_000_123_456_789


def in_real_time(torque_of_the_law: float = 1.0) -> list[Entry]:
    """
    Return messages as in real time: late, bunched, states without and with two commands.

    What is published every tenth sample is that of the run; commands are those, times a factor.
    """
    rng, found = np.random.default_rng(5), list[Entry]()
    late = np.maximum.accumulate(
        np.arange(1001) * 1_000_000 + 300_000 + rng.exponential(8e5, 1001).astype(int))
    for topic, t, message in entries(RESULT, SETUP.plant, START):
        k = (t - START) // 1_000_000
        if topic == COMMANDS:
            message.data = message.data * torque_of_the_law
            count = {0: 0, 1: 2}.get(k % 50, 1)  # None, two, or one.
            found += [Entry(topic, START + int(late[k]) + 200_000 + i, message)
                      for i in range(count)]
        elif topic == STATES:
            found.append(Entry(topic, START + int(late[k]), message))
        else:
            found.append(Entry(topic, t, message))
    return found + published_terms(late)


def published_terms(late: np.ndarray) -> list[Entry]:
    """Return what the controller publishes of every tenth sample, received so late [ns]."""
    found = list[Entry]()
    terms = RESULT.terms
    names = [*(f'{joint}/{part}' for part in ('nominal', 'compensation', 'robust', 'commanded')
               for joint in RESULT.joint_names), 'V']
    for k in range(0, 1001, 10):
        t, at = START + nanoseconds(1e-3 * k), START + int(late[k]) + 300_000
        values = np.array([*terms.nominal[k], *-terms.compensation[k], *-terms.robust[k],
                           *terms.tau[k], terms.lyapunov[k]])
        found.append(Entry(TORQUES, at, joint_state(
            t, names, None, None, values)))  # type: ignore[arg-type]
        found.append(Entry(FILTER, at, joint_state(
            t, RESULT.joint_names, None, terms.v[k], None)))  # type: ignore[arg-type]
    return found


def after_sleep(lost: Sequence[int] = (), twice: Sequence[int] = ()) -> list[Entry]:
    """Return messages of a recorder that slept: of 150 states each, states or commands first."""
    found = list[Entry]()
    for topic, t, message in entries(RESULT, SETUP.plant, START):
        k = (t - START) // 1_000_000
        block, at = k // 150, t
        if (topic == COMMANDS) == (block % 2 == 0):
            at = START + 150_000_000 * (block + 1)
        count = 1 - (topic == COMMANDS and k in lost) + (topic == COMMANDS and k in twice)
        found += [Entry(topic, at, message)] * count
    return found + published_terms(1_000_000 * np.arange(1001))


#: What our recorder says of a bag in which nothing is missing.
WHOLE = {'dropped': '{}'}


def test_commands_of_a_recorder_that_slept_are_told_by_their_order(tmp_path: Path) -> None:
    """Where it says that it lost none, and they are the torques with stamps."""
    write_bag(tmp_path / 'bag', after_sleep(), notes=WHOLE)
    result = read_bag(tmp_path / 'bag')
    np.testing.assert_array_equal(result.run.tau, RESULT.run.tau)
    assert result.replay == Replay(ReplayVerdict.EXACT)


@pytest.mark.parametrize(('notes', 'twice'), [
    (WHOLE, 700), ({}, 207), ({'dropped': "{'/effort_controller/commands': 1}"}, 207),
    ({**WHOLE, 'repaired': '9 messages recovered'}, 207)])
def test_a_lost_command_and_another_one_twice_move_none(
        tmp_path: Path, notes: dict[str, str], twice: int) -> None:
    """Their number is that of the states, also between two torques with stamps."""
    write_bag(tmp_path / 'bag', after_sleep([203], [twice]), notes=notes)
    tau = read_bag(tmp_path / 'bag').run.tau
    known = np.isfinite(tau).all(axis=1)
    np.testing.assert_array_equal(tau[known], RESULT.run.tau[known])


def test_a_lost_command_and_a_lost_state_move_none(tmp_path: Path) -> None:
    """Their numbers are equal, also between two torques with stamps."""
    messages = after_sleep([208])
    lost_state = [x for x in messages if x.topic == STATES][205]
    write_bag(tmp_path / 'bag', (x for x in messages if x is not lost_state))
    tau = read_bag(tmp_path / 'bag').run.tau
    known = np.isfinite(tau).all(axis=1)
    truth = np.delete(RESULT.run.tau, 205, axis=0)
    np.testing.assert_array_equal(tau[known], truth[known])


@pytest.mark.parametrize('factor', [1.0, 0.5])
def test_commands_that_answer_no_state_for_sure(tmp_path: Path, factor: float) -> None:
    """Check it where a replay of the law would have given the torques, too, and where not."""
    write_bag(tmp_path / 'bag', in_real_time(factor))
    check_what_is_shown(tmp_path / 'bag', tmp_path / 'out')
    result = read_bag(tmp_path / 'bag')
    assert result.replay == Replay(ReplayVerdict.NOT_ONE_TO_ONE)
    assert result.torque.received and result.saturation is None
    assert result.signals['e'].origin is SignalOrigin.COMPUTED
    np.testing.assert_array_equal(result.run.e, RESULT.run.e)


def test_torques_beside_the_states_in_a_table(tmp_path: Path) -> None:
    write_bag(tmp_path / 'bag', in_real_time())
    out = tmp_path / 'samples'
    done = ctc('export', tmp_path / 'bag', '--csv', '--out', out)
    assert done.returncode == 0, done.stderr
    heads, *rows = (out / 'trajectory_commands.csv').read_text().splitlines()
    assert heads == 't [s],tau_joint1 [N·m],tau_joint2 [N·m]'
    sent = recorded(tmp_path / 'bag', COMMANDS).rows('data')
    assert [[float(x) for x in row.split(',')[1:]] for row in rows] == sent.tolist()
    assert f'{len(sent)} torques were written to ' in done.stdout
    assert 'not every state has one command that answers it' in done.stdout


def test_without_commands_torques_are_those_published(tmp_path: Path) -> None:
    write_bag(tmp_path / 'bag', [x for x in in_real_time() if x.topic != COMMANDS])
    result = read_bag(tmp_path / 'bag')
    assert not result.torque.received
    np.testing.assert_array_equal(result.torque.values, RESULT.run.tau[::10])
    numbers = result.metrics()
    assert np.isnan(numbers['torque_variation_nm_per_s']).all()
    assert np.isfinite(numbers['rms_torque_nm']).all()


def test_nothing_of_the_torque_is_known(tmp_path: Path) -> None:
    """Check that figures and page say so, and draw nothing."""
    write_bag(tmp_path / 'bag', [x for x in in_real_time() if x.topic not in (
        COMMANDS, TORQUES, FILTER)])
    result = read_bag(tmp_path / 'bag')
    assert {name for name, x in result.signals.items()
            if x.origin is SignalOrigin.UNKNOWN} == {
        'torque', 'v', 'V', 'nominal', 'compensation', 'robust'}
    done = ctc('plot', tmp_path / 'bag', '--out', tmp_path / 'out')
    assert done.returncode == 0, done.stderr
    assert 'v, V and the parts of the torque are not known' in done.stdout
    shown = columns(next((tmp_path / 'out' / 'samples').glob('*.js')))
    assert {name for name, _ in shown} == {'t', 'q_d', 'dq', 'e'}
    for figure in ('torques', 'internals'):
        (file,) = (tmp_path / 'out' / 'figures').glob(f'*_{figure}.svg')
        assert 'not known' in file.read_text()


def test_a_way_back_to_the_reference_is_told(tmp_path: Path) -> None:
    """The controller led the robot back, by itself, for a tenth of a second."""
    found = in_real_time()
    for k in range(0, 1001, 10):
        t, away = START + nanoseconds(1e-3 * k), 0.1 * (300 <= k < 400)
        names = [f'{joint}/{x}' for x in ('desired', 'error') for joint in ('joint1', 'joint2')]
        desired = RESULT.run.q_d[k] + [0.0, away]
        found.append(Entry('/controller/tracking', t, joint_state(
            t, names, np.append(desired, desired - RESULT.run.q[k]), None, None)))
    write_bag(tmp_path / 'bag', found)
    result = read_bag(tmp_path / 'bag')
    assert result.off_reference == pytest.approx((0.3, 0.39))
    assert any(text.startswith('between 0.3 s and 0.39 s the controller did not always follow')
               for text in result.metrics()['notes'])

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

"""Bags read back: the run to the last bit, and a one-line error for anything that is no bag."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
from pathlib import Path

from bags import entries, Entry, nanoseconds, parameters, write_bag
from ctc_chattering.analysis.result import Result, simulate
from ctc_chattering.analysis.signals import SignalOrigin
from ctc_chattering.analysis.terms import Replay, ReplayVerdict
from ctc_chattering.bags.reader import _follow_controller, read_bag
from ctc_chattering.bags.repair import repair
from ctc_chattering.bags.signals import Signal
from ctc_chattering.configuration import parameter_file
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.angles import within_turn
from ctc_chattering.numerics.linear_algebra import Array
from faults import KINDS, malformed
from motion_bags import joint_state, serialized, string, torques
import numpy as np
import pytest
from recorded_runs import assert_equal

#: In plain Python, whatever is compiled on this computer meanwhile: bits are compared.
SETUP = parameter_file.load(None, {
    '/**': {'compiled': False},
    'plant': {'duration': 0.2, 'experiment': 'trial', 'initial_position': [0.3, -0.2]},
    'controller': {'law': 'compensation', 'kp': [90.0, 5.0, 5.0, 80.0], 'lambda': 7.0},
    'bringup': {'events': ['0.1 controller law chattering', '0.15 controller ka [8, 9]']}})
RESULT = simulate(SETUP)
STATES, COMMANDS = '/joint_states', '/effort_controller/commands'


def messages(**how: object) -> list[Entry]:
    return entries(RESULT, SETUP.plant, **how)  # type: ignore[arg-type]


def read(path: Path, found: list[Entry], namespace: str = '') -> Result:
    write_bag(path / 'bag', found, namespace)
    return read_bag(path / 'bag')


def without_names_and_efforts() -> list[Entry]:
    found = messages()
    for topic, _, message in found:
        if topic == STATES:
            message.effort = np.zeros(0)
        elif topic == COMMANDS:
            message.layout.dim = []
    return found


def with_a_gripper() -> list[Entry]:
    """Return messages of other joints on the topic, too, which the controller ignores."""
    return [x for entry in messages() for x in (entry, Entry(STATES, entry.t, joint_state(
        entry.t, ['finger', 'thumb'], np.ones(2), np.ones(2), None)))]


#: Messages of the same run: order and names of joints, chunks, stamps on the wall clock, states
#: that are sent again or come before the controller, parameters that the law does not have.
SAME: dict[str, Callable[[], list[Entry]]] = {
    'order': lambda: messages(order=(1, 0)),
    'extra': lambda: messages(order=(1, 0), extra=('gripper', 'wheel')),
    'points': lambda: messages(chunk=1), 'chunk': lambda: messages(chunk=1000),
    'clock': lambda: messages(start=1_700_000_000_123_456_789),
    'repeated': lambda: [x for entry in messages() for x in [entry] * (1 + 2 * (
        entry.topic == STATES))],
    'early': lambda: [*[x for x in messages() if x.topic == STATES][:50],
                      *messages(start=10 ** 9)],
    'bare': without_names_and_efforts, 'gripper': with_a_gripper,
    'others': lambda: [*messages(), parameters('controller', 10 ** 8, {
        'use_sim_time': True, 'predicted_periods': 3, 'wait_for': ('a',)}, False)]}


def logged_late(found: list[Entry]) -> list[Entry]:
    """Return messages that are logged up to 15 ms late, each by another time."""
    dice = np.random.default_rng(3)
    return [x._replace(t=x.t + int(dice.integers(15_000_000))) for x in found]


def check(result: Result) -> None:
    """Assert that a result is the simulated one, to the last bit."""
    assert_equal(result.run, RESULT.run)
    assert result.configs == RESULT.configs
    assert (result.experiment, result.label) == ('trial', 'trial: compensation → chattering')
    assert result.metrics() == {
        **RESULT.metrics(), 'bag': 'bag', 'origins': result.metrics()['origins']}
    assert result.replay == Replay(ReplayVerdict.EXACT)
    assert {x.origin for x in result.signals.values()} == {
        SignalOrigin.RECORDED, SignalOrigin.COMPUTED}
    assert result.terms.tau.tobytes() == RESULT.run.tau.tobytes()
    assert result.terms.v.tobytes() == RESULT.run.v.tobytes()


@pytest.mark.parametrize('how', SAME)
def test_run_comes_back_to_the_last_bit(tmp_path: Path, how: str) -> None:
    check(read(tmp_path, SAME[how](), '/a/b' if how == 'extra' else ''))


@pytest.mark.parametrize('least', [-np.pi, 1.5])
def test_turns_of_continuous_joints_are_counted(tmp_path: Path, least: float) -> None:
    """States and reference within a driver's window, which both cross: no jump is left."""
    joints = ['joint1', 'joint2']
    setup = parameter_file.load(None, {
        '/**': {'continuous_joints': joints},
        'plant': {'duration': 0.2, 'initial_position': [3.1, 1.45]},
        'controller': {'law': 'compensation', 'ka': 20.0}})
    counted = simulate(setup)

    def seen(q: Array) -> Array:
        return np.asarray(np.vectorize(within_turn)(q, least), float)

    run = dataclasses.replace(counted.run, q=seen(counted.run.q), q_d=seen(counted.run.q_d))
    assert max(np.abs(np.diff(x, axis=0)).max() for x in (run.q, run.q_d)) > 6.0
    found = read(tmp_path, entries(dataclasses.replace(counted, run=run), setup.plant))
    for name in ('q', 'q_d', 'e', 'v', 'tau'):
        x, y = getattr(found, name), getattr(counted, name)
        turns = np.rint((x[0] - y[0]) / (2.0 * np.pi)) if name in ('q', 'q_d') else 0.0
        np.testing.assert_allclose(x - 2.0 * np.pi * turns, y, atol=1e-9, err_msg=name)


def test_turns_are_those_of_the_controller_which_counts_anew_after_an_outage() -> None:
    """It says so in every tenth sample, and not in the outage from sample 100 to 150."""
    q = np.column_stack([np.linspace(0.0, 20.0, 250), np.zeros(250)])
    counted = q.copy()
    counted[125:, 0] -= 2.0 * np.pi
    sample = np.array([*range(0, 100, 10), *range(150, 250, 10)])
    error = np.full((len(sample), 2), -0.3)
    tracking = Signal(sample, sample, (np.hstack([counted[sample] + error, error]),))
    found = _follow_controller(np.arange(250), q, tracking, (True, False))
    gap = slice(91, 150)  # Between the samples the outage may be anywhere.
    np.testing.assert_allclose(np.delete(found, gap, 0), np.delete(counted, gap, 0), atol=1e-12)
    steps = np.diff(found[:, 0])
    assert np.flatnonzero(np.abs(steps) > 1.0).size == 1


def published(k: int) -> Entry:
    """Return what the controller publishes of the torque that answers state k."""
    terms, t = RESULT.terms, nanoseconds(1e-3 * k)
    values = {f'{joint}/{part}': sign * getattr(terms, name)[k, i]
              for i, joint in enumerate(RESULT.joint_names) for part, name, sign in (
                  ('commanded', 'tau', 1.0), ('nominal', 'nominal', 1.0),
                  ('compensation', 'compensation', -1.0), ('robust', 'robust', -1.0))}
    values['V'] = terms.lyapunov[k]
    return Entry('/controller/torques', t, joint_state(
        t, list(values), None, None, np.array(list(values.values()))))  # type: ignore[arg-type]


STAMPED = [published(k) for k in range(201)]


@pytest.mark.parametrize('keep', [0, 150])
def test_missing_commands(tmp_path: Path, keep: int) -> None:
    """
    Check that a torque is the one published with the stamp of its state, else none.

    The effort of a state is that of the drive: it has lags.
    """
    whole = messages()
    commands = [entry for entry in whole if entry.topic == COMMANDS][:keep]
    found = [x for x in whole if x.topic != COMMANDS] + commands
    lost = read(tmp_path, found).run.tau
    known = np.isfinite(lost).all(axis=1)
    assert np.isnan(lost[max(keep, 1):]).all()
    assert lost[known].tobytes() == RESULT.run.tau[known].tobytes()
    check(read(tmp_path / 'stamped', found + STAMPED))


def test_commands_with_the_log_time_of_another_state(tmp_path: Path) -> None:
    """Check that a repeated command, and times of the state before, change no torque."""
    found = messages()
    at = [i for i, x in enumerate(found) if x.topic == COMMANDS]
    for i in at[::7]:
        found[i] = found[i]._replace(t=found[i].t - 1_000_000 * (i > 20))
    found.insert(at[60], found[at[60]])
    check(read(tmp_path, found))


@pytest.mark.parametrize('stamped', [True, False])
def test_as_many_commands_as_states_that_do_not_answer_them(tmp_path: Path, stamped: bool) -> None:
    """Check that one lost, and another one too many, show where some torques have stamps."""
    found = messages()
    at = [i for i, x in enumerate(found) if x.topic == COMMANDS]
    found.insert(at[120], found[at[90]]._replace(t=found[at[120]].t))
    del found[at[50]]
    tau = read(tmp_path, found + (STAMPED[::10] if stamped else [])).run.tau
    known = np.isfinite(tau).all(axis=1)
    assert (tau[known].tobytes() == RESULT.run.tau[known].tobytes()) == stamped
    assert np.flatnonzero(~known).tolist() == [
        k for k in range(41, 120) if k % 10] * stamped


def test_an_order_of_the_file_that_contradicts_the_stamps_changes_nothing(tmp_path: Path) -> None:
    found = [x for x in messages() if x.topic != COMMANDS]
    check(read(tmp_path, logged_late(found + STAMPED)))


def test_two_publishers_of_states_are_refused_and_named(tmp_path: Path) -> None:
    """Also if one of them has the stamps of the other."""
    def others(shift: int) -> list[Entry]:
        states = [x for x in messages() if x.topic == STATES]
        return [Entry(STATES, x.t + shift, joint_state(
            x.t + shift, x.message.name, x.message.position + 1.0, x.message.velocity, None))
            for x in states]
    for name, more in (('between', others(300_000)), ('same', others(0))):
        write_bag(tmp_path / name, messages() + more)
        refused(tmp_path / name, 'joint_states: ', 'two publishers of joint states')


def test_runs_of_two_robots_are_refused_and_named(tmp_path: Path) -> None:
    left, right = ([x._replace(topic=f'/{name}{x.topic}') for x in messages()]
                   for name in ('left', 'right'))
    write_bag(tmp_path / 'bag', left + right)
    refused(tmp_path / 'bag', 'runs of several robots: /left/controller, /right/controller')
    raw = [x._replace(topic=f'/raw{x.topic}') for x in messages() if x.topic == STATES]
    for x in raw:
        x.message.position += 1.0
    check(read(tmp_path / 'raw', raw + messages()))


def test_without_the_plant(tmp_path: Path) -> None:
    """Check that a bag of another robot takes its name from the directory."""
    result = read(tmp_path, [x for x in messages() if not x.topic.startswith('/plant')])
    assert result.experiment == 'bag'
    assert_equal(result.run, RESULT.run)


def test_a_recorder_started_during_the_run(tmp_path: Path) -> None:
    """Check that the run begins with the first known reference."""
    found = [x for x in messages() if x.topic != '/reference' or x.t >= nanoseconds(0.05)]
    run = read(tmp_path, found).run
    assert run.t[0] == 0.0
    assert_equal(run, RESULT.run, ['t', 'v'], slice(50, None))


def refused(path: Path, *words: str) -> None:
    """Assert that one line says why there is no run at `path`."""
    with pytest.raises(CtcError) as error:
        read_bag(path)
    text = str(error.value)
    assert len(text.splitlines()) == 1
    assert str(path) in text
    assert all(word in text for word in words)


@pytest.mark.parametrize('topic', ['joint_states', 'reference', 'controller/parameters'])
def test_what_a_run_needs(tmp_path: Path, topic: str) -> None:
    """Check that a missing topic is named."""
    write_bag(tmp_path / 'bag', [x for x in messages() if not x.topic.endswith(topic)])
    refused(tmp_path / 'bag', topic)


def test_no_bag(tmp_path: Path) -> None:
    write_bag(tmp_path / 'bag', [Entry('/chatter', 5, string('hello'))])
    refused(tmp_path / 'bag', 'this package did not record the bag')
    (tmp_path / 'file').write_text('x')
    refused(tmp_path / 'none', 'no such bag')
    for name in ('file', 'file/below', ''):
        refused(tmp_path / name)


def test_damaged_messages(tmp_path: Path) -> None:
    """Check that messages the controller refuses are ignored: any bytes, and wrong lengths."""
    found: list[Entry] = []
    for i, entry in enumerate(messages()):
        found.append(entry)
        kind = KINDS.get(entry.topic.removeprefix('/'))
        if kind is not None and i > 50:
            name = entry.message.__msgtype__
            found += [entry._replace(message=(name, x)) for x in malformed(kind, 10, i)]
            found.append(entry._replace(message=(name, serialized(entry.message)[:40])))
    found.append(Entry(COMMANDS, nanoseconds(0.2), torques([1.0], ['joint1'])))
    check(read(tmp_path, found + STAMPED))


def test_a_gap_in_the_states(tmp_path: Path) -> None:
    """Check that the run continues after a gap, from the first state."""
    found = messages()
    for topic, t, message in found:
        if topic == STATES and t >= nanoseconds(0.1):
            message.header.stamp.sec += 7
    run = read(tmp_path, found).run
    assert run.q.tobytes() == RESULT.run.q.tobytes()
    assert run.t[100] - run.t[99] == pytest.approx(7.001)


def test_metadata_that_are_cut_off_anywhere_are_found(tmp_path: Path) -> None:
    """Without them, as a killed recorder leaves it, the file tells all."""
    write_bag(tmp_path / 'bag', messages())
    path = tmp_path / 'bag' / 'metadata.yaml'
    whole = path.read_bytes()
    last = len(whole) - 3  # without the last line break YAML is whole
    for end in (0, *range(1, last, last // 12), last):
        path.write_bytes(whole[:end])
        refused(tmp_path / 'bag')
    path.unlink()
    check(read_bag(tmp_path / 'bag'))


@pytest.mark.parametrize('name', ['run.bag', 'run.db3', 'run'])
def test_the_name_of_a_bag_does_not_matter(tmp_path: Path, name: str) -> None:
    """Check complete and repaired bags; one of an older recorder has no number."""
    write_bag(tmp_path / name, messages())
    if name == 'run':
        (tmp_path / name / 'run_0.mcap').rename(tmp_path / name / 'run.mcap')
        file = tmp_path / name / 'metadata.yaml'
        file.write_text(file.read_text().replace('run_0.mcap', 'run.mcap'))
    assert_equal(read_bag(tmp_path / name).run, RESULT.run)
    (tmp_path / name / 'metadata.yaml').unlink()
    assert repair(tmp_path / name) is not None
    assert_equal(read_bag(tmp_path / name).run, RESULT.run)


def lossy(drop: Callable[[int], bool], commands: bool, effort: bool = True) -> list[Entry]:
    """Return the messages without states, or states and commands, at samples that drop."""
    found = []
    for entry in messages():
        if entry.topic == STATES and not effort:
            entry.message.effort[:] = np.nan
        if not (entry.topic == STATES or (entry.topic == COMMANDS and commands)) or (
                not drop(entry.t // 1_000_000)):
            found.append(entry)
    return found


@pytest.mark.parametrize(('commands', 'effort'), [(True, True), (False, True), (False, False)])
def test_a_recorder_that_dropped_messages(
        tmp_path: Path, commands: bool, effort: bool) -> None:
    """Check torques at the recorded states, and that no term is made up for the others."""
    def drop(k: int) -> bool:
        return (k > 30 and k % 3 == 0) or 110 <= k < 120
    kept = np.array([not drop(k) for k in range(201)])
    result = read(tmp_path, lossy(drop, commands, effort))
    assert_equal(result.run, RESULT.run, ['v'], kept)
    assert int(result.missing.sum()) == 201 - kept.sum()
    assert result.replay is not None
    assert result.replay.verdict is ReplayVerdict.OTHER_TORQUES
    assert all(x > 0.0 for x in result.replay.difference)
    assert np.isnan(result.run.v).all() and not len(result.terms.t)
    assert result.metrics()['origins']['nominal'] == 'not known'
    assert any(text.startswith(str(result.replay)) for text in result.metrics()['notes'])


@pytest.mark.parametrize('commands', [False, True])
def test_unknown_torques(tmp_path: Path, commands: bool) -> None:
    """
    Check nan, not another sample's torque, where state and command are both missing.

    A later command is no answer to a state that has none.
    """
    found = [x for x in lossy(lambda k: 50 <= k < 60, commands)
             if not (x.topic == COMMANDS and x.t // 1_000_000 == 49)]
    tau = read(tmp_path, found).run.tau
    assert np.isnan(tau[49]).all()
    known = np.delete(np.arange(201), np.s_[49:60])
    assert np.delete(tau, 49, 0).tobytes() == RESULT.run.tau[known].tobytes()


def test_after_a_gap_the_terms_are_the_published_ones(tmp_path: Path) -> None:
    found = lossy(lambda k: 50 <= k < 90, True)
    stamps = [20, 100]
    found += [published(k) for k in stamps]
    for k in stamps:
        t = nanoseconds(1e-3 * k)
        found.append(Entry('/controller/filter', t, joint_state(
            t, ['joint2', 'joint1'], None, RESULT.run.v[k][::-1], None)))  # type: ignore[arg-type]
    result = read(tmp_path, found)
    known = np.isfinite(result.run.v).all(axis=1)
    assert result.run.t[known].tolist() == result.terms.t.tolist() == [0.02, 0.1]
    for name in ('v', 'nominal', 'compensation', 'robust', 'tau', 'lyapunov'):
        assert getattr(result.terms, name).tolist() == getattr(
            RESULT.terms, name)[stamps].tolist(), name
    assert result.run.v[known].tolist() == result.terms.v.tolist()


@pytest.mark.parametrize('topic', ['torques', 'filter'])
def test_a_law_that_publishes_something_else_is_not_recomputed(tmp_path: Path, topic: str) -> None:
    """Check that one value that differs, of all that the bag has, is enough."""
    t = nanoseconds(0.12)
    entry = published(120) if topic == 'torques' else Entry('/controller/filter', t, joint_state(
        t, ['joint1', 'joint2'], None, RESULT.run.v[120].copy(), None))  # type: ignore[arg-type]
    values = entry.message.effort if topic == 'torques' else entry.message.velocity
    values[1] *= 1.0 + 1e-4
    assert read(tmp_path, [*messages(), entry]).replay == Replay(
        ReplayVerdict.OTHER_TORQUES, (0.0, 0.0))


def test_a_long_run_is_not_recomputed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('ctc_chattering.bags.recorded_law.MAX_REPLAYED_SAMPLES', 200)
    result = read(tmp_path, messages() + STAMPED[::10])
    assert result.replay == Replay(ReplayVerdict.TOO_LONG)
    assert result.terms.t.tolist() == RESULT.run.t[::10].tolist()
    assert result.run.tau.tobytes() == RESULT.run.tau.tobytes()


def test_the_law_before_a_recording_began_is_none_of_its_laws(tmp_path: Path) -> None:
    """Parameters are latched: a recorder that is started late receives all changes before."""
    found = [x for x in messages() if x.topic == '/controller/parameters' or x.t > nanoseconds(
        0.12)]
    found += [x._replace(t=nanoseconds(0.121)) for x in messages() if x.topic == '/reference']
    result = read(tmp_path, found)
    assert (result.label, result.changes) == ('bag: chattering', [])
    assert [config.ka for _, config in result.configs] == [(10.0, 10.0), (8.0, 9.0)]

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

from array import array
from collections.abc import Callable
from pathlib import Path

from bags import (
    command,
    entries,
    Entry,
    nanoseconds,
    parameters,
    same,
    serialized,
    stamped,
    write_bag,
)
from ctc_chattering.analysis.result import Result, simulate
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.bags.repair import repair
from ctc_chattering.configuration import parameter_file
from ctc_chattering.errors import CtcError
from faults import KINDS, malformed
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import String

SETUP = parameter_file.load(None, {
    'plant': {'duration': 0.2, 'experiment': 'trial', 'initial_position': [0.3, -0.2]},
    'controller': {'law': 'compensation', 'kp': [90.0, 5.0, 5.0, 80.0], 'lambda': 7.0},
    'bringup': {'events': ['0.1 controller law chattering', '0.15 controller ka [8, 9]']}})
RESULT = simulate(SETUP)


def messages(**how: object) -> list[Entry]:
    return entries(RESULT, SETUP.plant, **how)  # type: ignore[arg-type]


def read(path: Path, found: list[Entry], namespace: str = '') -> Result:
    write_bag(path / 'bag', found, namespace)
    return read_bag(path / 'bag')


def check(result: Result) -> None:
    """Assert that a result is the simulated one, to the last bit."""
    same(result.run, RESULT.run)
    assert result.configs == RESULT.configs
    assert (result.experiment, result.label) == ('trial', 'trial: compensation → chattering')
    assert result.metrics() == {**RESULT.metrics(), 'bag': 'bag'}
    assert result.terms.tau.tobytes() == RESULT.run.tau.tobytes()
    assert result.terms.v.tobytes() == RESULT.run.v.tobytes()


@pytest.mark.parametrize('how', [
    {}, {'order': (1, 0)}, {'extra': ('gripper', 'wheel')}, {'order': (1, 0), 'extra': ('x',)},
    {'chunk': 1}, {'chunk': 1000}])
def test_run_comes_back_to_the_last_bit(tmp_path: Path, how: dict[str, object]) -> None:
    check(read(tmp_path, messages(**how)))


@pytest.mark.parametrize('namespace', ['/robot1', '/a/b/c'])
def test_namespaces(tmp_path: Path, namespace: str) -> None:
    check(read(tmp_path, messages(), namespace))


def test_time_of_the_first_reference_is_zero(tmp_path: Path) -> None:
    """Check a run on the wall clock: times from its start, to the last bit."""
    check(read(tmp_path, messages(start=1_700_000_000_123_456_789)))


def test_repeated_stamps(tmp_path: Path) -> None:
    """Check that a state that is sent again, as for a late subscriber, counts once."""
    found: list[Entry] = []
    for entry in messages():
        found += [entry] * (3 if entry.topic == '/joint_states' else 1)
    check(read(tmp_path, found))


def test_states_before_the_controller_s_start(tmp_path: Path) -> None:
    """Check that states before the first command are not part of the run."""
    start = 10 ** 9
    early = [entry for entry in messages(start=0) if entry.topic == '/joint_states'][:50]
    assert early[-1].t < start
    check(read(tmp_path, [*early, *messages(start=start)]))


def commanded(k: int) -> Entry:
    """Return what the controller publishes of the torque that answers state k, among others."""
    (one, two), t = RESULT.run.tau[k], nanoseconds(1e-3 * k)
    names = ['joint2/commanded', 'V', 'joint1/commanded', 'joint1/robust']
    return Entry('/controller/torques', 'sensor_msgs/msg/JointState', t, stamped(
        JointState(name=names, effort=array('d', [two, 1.0, one, 2.0])), t))


@pytest.mark.parametrize('keep', [0, 1, 150, 200])
def test_missing_commands(tmp_path: Path, keep: int) -> None:
    """
    Check that a torque is the one published with the stamp of its state, else none.

    The effort of a state is that of the drive: it has lags.
    """
    whole = messages()
    answers = [entry for entry in whole if entry.topic.endswith('commands')][:keep]
    found = [x for x in whole if not x.topic.endswith('commands')] + answers
    lost = read(tmp_path, found).run.tau
    known = np.isfinite(lost).all(axis=1)
    assert not known[max(keep, 1):].any()
    assert lost[known].tobytes() == RESULT.run.tau[known].tobytes()
    check(read(tmp_path / 'stamped', found + [commanded(k) for k in range(201)]))


def test_commands_with_the_log_time_of_another_state(tmp_path: Path) -> None:
    """Check that a repeated command, and times of the state before, change no torque."""
    found = messages()
    at = [i for i, x in enumerate(found) if x.topic.endswith('commands')]
    for i in at[::7]:
        found[i] = found[i]._replace(t=found[i].t - 1_000_000 * (i > 20))
    found.append(found[at[60]])
    tau = read(tmp_path, found).run.tau
    known = np.isfinite(tau).all(axis=1)
    assert tau[known].tobytes() == RESULT.run.tau[known].tobytes()
    check(read(tmp_path / 'stamped', found + [commanded(k) for k in range(201)]))


def test_commands_without_labels_and_states_without_effort(tmp_path: Path) -> None:
    """Check messages of another robot's nodes."""
    found = []
    for entry in messages():
        if entry.topic == '/joint_states':
            entry.message.effort = []
        elif entry.topic.endswith('commands'):
            entry.message.layout.dim = []
        found.append(entry)
    check(read(tmp_path, found))


def test_a_joint_state_of_other_joints(tmp_path: Path) -> None:
    """Check that a gripper's messages on the topic are ignored, as by the controller."""
    found = []
    for entry in messages():
        found.append(entry)
        if entry.topic == '/joint_states' and entry.t % 7_000_000 == 0:
            other = messages(extra=('finger',))[10]
            other.message.name = ['finger', 'thumb', 'palm']
            other.message.header.stamp = entry.message.header.stamp
            found.append(other)
    check(read(tmp_path, found))


def test_without_the_plant(tmp_path: Path) -> None:
    """Check that a bag of another robot takes its name from the directory."""
    found = [x for x in messages() if not x.topic.startswith('/plant')]
    result = read(tmp_path, found)
    assert result.experiment == 'bag'
    same(result.run, RESULT.run)


def test_parameters_of_others_do_not_matter(tmp_path: Path) -> None:
    """Check parameters that the law does not have."""
    values = {'use_sim_time': True, 'state_decimation': 3, 'wait_for': ['a']}
    check(read(tmp_path, [*messages(), parameters('controller', 10 ** 8, values, False)]))


def test_a_recorder_started_during_the_run(tmp_path: Path) -> None:
    """Check that the run begins with the first known reference."""
    found = [x for x in messages() if x.topic != '/reference' or x.t >= nanoseconds(0.05)]
    run = read(tmp_path, found).run
    assert run.t[0] == 0.0
    for name in ('q', 'dq', 'q_d', 'dq_d', 'ddq_d', 'tau'):
        assert getattr(run, name).tobytes() == getattr(RESULT.run, name)[50:].tobytes()


def without(topic: str) -> Callable[[Entry], bool]:
    return lambda entry: not entry.topic.endswith(topic)


@pytest.mark.parametrize('topic', [
    'joint_states', 'reference', 'controller/parameters', ''])
def test_what_a_run_needs(tmp_path: Path, topic: str) -> None:
    """Check that a missing topic is named."""
    write_bag(tmp_path / 'bag', filter(without(topic), messages()))
    refused(tmp_path / 'bag', topic)


def test_foreign_bag(tmp_path: Path) -> None:
    data = serialized(String(data='hello'))
    write_bag(tmp_path / 'bag', [Entry('/chatter', 'std_msgs/msg/String', 5, data)])
    refused(tmp_path / 'bag', 'not a bag of this package')


def test_damaged_messages(tmp_path: Path) -> None:
    """Check that messages the controller refuses are ignored: any bytes, and wrong lengths."""
    found: list[Entry] = []
    for i, entry in enumerate(messages()):
        found.append(entry)
        kind = KINDS.get(entry.topic.removeprefix('/'))
        if kind is not None and i > 50:
            found += [entry._replace(message=data) for data in malformed(kind, 10, i)]
    last = messages()[-5]
    found.append(last._replace(message=serialized(last.message)[:40]))
    found.append(command(nanoseconds(0.2), ['joint1'], np.array([1.0])))
    check(read(tmp_path, found + [commanded(k) for k in range(201)]))


def test_a_gap_in_the_states(tmp_path: Path) -> None:
    """Check that the run continues after a gap, from the first state."""
    found = []
    for entry in messages():
        if entry.topic == '/joint_states' and entry.t >= nanoseconds(0.1):
            stamp = entry.message.header.stamp
            stamp.sec += 7
        found.append(entry)
    run = read(tmp_path, found).run
    assert run.q.tobytes() == RESULT.run.q.tobytes()
    assert run.t[100] - run.t[99] == pytest.approx(7.001)


def refused(path: Path, *words: str) -> None:
    """Assert that one line says why there is no run at `path`."""
    with pytest.raises(CtcError) as error:
        read_bag(path)
    text = str(error.value)
    assert len(text.splitlines()) == 1
    assert str(path) in text
    assert all(word in text for word in words)


def test_no_bag(tmp_path: Path) -> None:
    """Check a missing path, files, and directories without a bag."""
    (tmp_path / 'file').write_text('x')
    (tmp_path / 'file.mcap').write_text('x')
    (tmp_path / 'file.db3').write_bytes(bytes(100))
    (tmp_path / 'file.bag').write_text('x')
    (tmp_path / 'empty').mkdir()
    refused(tmp_path / 'none', 'no such bag')
    for name in ('file', 'file.mcap', 'file.db3', 'file.bag', 'empty', 'file/below'):
        refused(tmp_path / name)


@pytest.mark.parametrize('file', ['bag_0.mcap', 'metadata.yaml'])
def test_truncated_files(tmp_path: Path, file: str) -> None:
    """Cut a bag off, everywhere in the metadata and at 100 places of the messages."""
    write_bag(tmp_path / 'bag', messages())
    path = tmp_path / 'bag' / file
    whole = path.read_bytes()
    last = len(whole) - 3  # without the last line break YAML is whole
    for end in (0, *range(1, last, max(1, last // 100)), last):
        path.write_bytes(whole[:end])
        refused(tmp_path / 'bag')
    path.unlink()
    if file == 'bag_0.mcap':
        refused(tmp_path / 'bag')
    else:  # As a killed recorder leaves it.
        refused(tmp_path / 'bag', f'"ctc repair {tmp_path / "bag"}"')
        assert repair(tmp_path / 'bag') is not None
        same(read_bag(tmp_path / 'bag').run, RESULT.run)


@pytest.mark.parametrize('junk', [
    b'\xff\xfe\0', b'- a', b'hello', b'a: [', b'rosbag2_bagfile_information: 5', b'\0', b'a: !x 1',
    b'2024-99-99'])
def test_junk_in_the_metadata(tmp_path: Path, junk: bytes) -> None:
    write_bag(tmp_path / 'bag', messages())
    (tmp_path / 'bag' / 'metadata.yaml').write_bytes(junk)
    refused(tmp_path / 'bag')


@pytest.mark.parametrize('name', ['run.bag', 'run.mcap', 'run.db3', 'run'])
def test_the_name_of_a_bag_does_not_matter(tmp_path: Path, name: str) -> None:
    """Check complete and repaired bags; one ending in .bag is not a bag of ROS 1."""
    write_bag(tmp_path / name, messages())
    same(read_bag(tmp_path / name).run, RESULT.run)
    (tmp_path / name / 'metadata.yaml').unlink()
    assert repair(tmp_path / name) is not None
    same(read_bag(tmp_path / name).run, RESULT.run)


def test_a_bag_with_the_old_name_of_the_file(tmp_path: Path) -> None:
    write_bag(tmp_path / 'run', messages())
    (tmp_path / 'run' / 'run_0.mcap').rename(tmp_path / 'run' / 'run.mcap')
    file = tmp_path / 'run' / 'metadata.yaml'
    file.write_text(file.read_text().replace('run_0.mcap', 'run.mcap'))
    same(read_bag(tmp_path / 'run').run, RESULT.run)
    file.unlink()
    assert repair(tmp_path / 'run') is not None
    same(read_bag(tmp_path / 'run').run, RESULT.run)


def lossy(drop: Callable[[int], bool], commands: bool, effort: bool = True) -> list[Entry]:
    """Return the messages without states, or states and commands, at samples that drop."""
    found = []
    for entry in messages():
        state, answer = entry.topic == '/joint_states', entry.topic.endswith('commands')
        if state and not effort:
            entry.message.effort = [float('nan')] * len(entry.message.name)
        if not (state or (answer and commands)) or not drop(entry.t // 1_000_000):
            found.append(entry)
    return found


@pytest.mark.parametrize(('commands', 'effort'), [(True, True), (False, True), (False, False)])
def test_a_recorder_that_dropped_messages(
        tmp_path: Path, commands: bool, effort: bool) -> None:
    """Check the torques at the recorded states, from whichever message they are known."""
    def drop(k: int) -> bool:
        return (k > 30 and k % 3 == 0) or 110 <= k < 120
    kept = np.array([not drop(k) for k in range(201)])
    result = read(tmp_path, lossy(drop, commands, effort))
    run = result.run
    for name in ('t', 'q', 'dq', 'q_d', 'dq_d', 'ddq_d', 'tau'):
        assert getattr(run, name).tobytes() == getattr(RESULT.run, name)[kept].tobytes(), name
    assert int(result.missing.sum()) == 201 - kept.sum()
    difference = np.abs(run.v - RESULT.run.v[kept]).max(axis=0)
    assert (difference < 0.05 * np.abs(RESULT.run.v).max(axis=0)).all()


def test_a_later_command_is_no_answer(tmp_path: Path) -> None:
    """Check a state without its command, before commands without their states."""
    found = [x for x in lossy(lambda k: 50 <= k < 60, False)
             if not (x.topic.endswith('commands') and x.t // 1_000_000 == 49)]
    run = read(tmp_path, found).run
    assert np.isnan(run.tau[49]).all() and np.isfinite(np.delete(run.tau, 49, 0)).all()


def test_unknown_torques(tmp_path: Path) -> None:
    """Check nan, not another sample's torque, where state and command are both missing."""
    result = read(tmp_path, [x for x in lossy(lambda k: 50 <= k < 60, True)
                             if not (x.topic.endswith('commands') and x.t // 1_000_000 == 49)])
    assert np.isnan(result.run.tau[49]).all()
    known = np.delete(np.arange(201), np.s_[49:60])
    assert result.run.tau[np.isfinite(result.run.tau[:, 0])].tobytes() == (
        RESULT.run.tau[known].tobytes())


def test_the_filtered_error_after_a_gap_is_the_published_one(tmp_path: Path) -> None:
    found = lossy(lambda k: 50 <= k < 90, True)
    found.append(Entry('/controller/filter', 'sensor_msgs/msg/JointState', nanoseconds(0.1),
                       stamped(JointState(name=['joint2', 'joint1'], velocity=array(
                           'd', RESULT.run.v[100][::-1])), nanoseconds(0.1))))
    v = read(tmp_path, found).run.v
    assert v[:50].tobytes() == RESULT.run.v[:50].tobytes()
    assert v[50].tolist() == [0.0, 0.0]
    np.testing.assert_allclose(v[60:], RESULT.run.v[100:], atol=1e-9)

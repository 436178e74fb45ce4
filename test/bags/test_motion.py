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

"""Joint states and torques are read from bags of any recorder, or refused in clear words."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from ctc_chattering.bags.motion import read_motion
from ctc_chattering.errors import CtcError
from identified_bags import recorded_bag
from identified_robots import record, Recorded
from motion_bags import joint_state, messages_of, torques, write
import numpy as np
import pytest
import urdfs


@cache
def made() -> Recorded:
    return record('two_link', 1, 1.0)


def test_other_order_and_further_joints(tmp_path: Path) -> None:
    bag = recorded_bag(tmp_path / 'bag', made(), order=(1, 0), extra=('finger', 'thumb'))
    wanted = made().recording
    found = read_motion(bag, wanted.joints)
    assert found.recording.joints == wanted.joints
    assert found.recording.q == pytest.approx(wanted.q)
    assert found.recording.dq == pytest.approx(wanted.dq)
    assert found.recording.command == pytest.approx(wanted.command)
    assert found.recording.effort is None
    assert (found.controller, found.description) == (None, '')


def test_commands_without_names_are_in_the_order_of_joints(tmp_path: Path) -> None:
    bag = recorded_bag(tmp_path / 'bag', made(), labels=False, extra=('finger',),
                       command=made().run.tau[:, ::-1])
    with pytest.raises(CtcError, match=r'2 commanded torques for 3 joints.*--joints'):
        read_motion(bag)
    found = read_motion(bag, ('joint2', 'joint1')).recording
    assert found.q == pytest.approx(made().recording.q[:, ::-1])
    assert found.command == pytest.approx(made().run.tau[:, ::-1])


def test_some_of_the_joints_need_names_in_the_commands(tmp_path: Path) -> None:
    found = read_motion(recorded_bag(tmp_path / 'named', made()), ('joint2',)).recording
    assert found.command == pytest.approx(made().run.tau[:, 1:])
    with pytest.raises(CtcError, match=r'2 commanded torques for 1 joints, joint2; .*--joints$'):
        read_motion(recorded_bag(tmp_path / 'bare', made(), labels=False), ('joint2',))


def test_the_description_of_another_robot_is_said(tmp_path: Path) -> None:
    bag = recorded_bag(tmp_path / 'bag', made(), labels=False)
    with pytest.raises(CtcError, match=(
            f'the description has the joints {", ".join(urdfs.TWO_LINKS)}; '
            'the states have joint1, joint2$')):
        read_motion(bag, description=urdfs.two_links())


def test_joints_are_those_of_the_description(tmp_path: Path) -> None:
    x = made().recording
    bag = write(tmp_path / 'bag', messages_of(
        x.t, urdfs.TWO_LINKS, x.q, None, x.command, None, extra=('finger',),
        urdf=urdfs.two_links()))
    found = read_motion(bag)
    assert found.recording.joints == urdfs.TWO_LINKS
    assert found.description == urdfs.two_links()
    assert found.recording.dq is None
    assert found.recording.effort == pytest.approx(x.command)


def test_an_effort_of_zeros_or_nan_is_none(tmp_path: Path) -> None:
    for name, value in (('zeros', 0.0), ('nan', np.nan)):
        found = read_motion(recorded_bag(
            tmp_path / name, made(), effort=np.full_like(made().run.q, value)))
        assert found.recording.effort is None


def test_refusals(tmp_path: Path) -> None:
    x = made().recording
    with pytest.raises(CtcError, match='no message on joint_states'):
        read_motion(write(tmp_path / 'empty', messages_of(
            x.t[:0], x.joints, x.q, None, None, None, urdf=urdfs.two_links())))
    with pytest.raises(CtcError, match=r'no state has the joints elbow; '
                                       r'joints of the bag: joint1, joint2$'):
        read_motion(recorded_bag(tmp_path / 'others', made()), ('elbow',))
    with pytest.raises(CtcError, match=r'did you mean joint1\?'):
        read_motion(tmp_path / 'others', ('jiont1',))
    with pytest.raises(CtcError, match=(
            'no state has the joints joint1, elbow; joints of the bag: joint1, joint2; ')):
        read_motion(recorded_bag(tmp_path / 'some', made()), ('joint1', 'elbow'))
    with pytest.raises(CtcError, match='no torque'):
        read_motion(recorded_bag(tmp_path / 'idle', made(), command=None))
    q = x.q.copy()
    q[500] = np.nan
    with pytest.raises(CtcError, match='a position that is not finite'):
        read_motion(recorded_bag(tmp_path / 'nan', made(), q=q))


def test_two_publishers_of_commands_or_states(tmp_path: Path) -> None:
    x = made().recording
    messages = messages_of(x.t, x.joints, x.q, x.dq, None, x.command)
    twice = [y for message in messages for y in (
        [message, message] if 'commands' in message[0] else [message])]
    with pytest.raises(CtcError, match='two publishers of commands'):
        read_motion(write(tmp_path / 'commands', twice))
    # Those of another controller, half a period later.
    others = [y for topic, t, message in messages for y in (
        [(topic, t, message), (topic, t + 500_000, torques(message.data + 1.0, x.joints))]
        if 'commands' in topic else [(topic, t, message)])]
    with pytest.raises(CtcError, match='two publishers of commands'):
        read_motion(write(tmp_path / 'others', sorted(others, key=lambda message: message[1])))
    other = [(topic, t + 1, joint_state(t, x.joints, x.q[0] + 1.0, x.dq[0], None))
             for topic, t, _ in messages if topic == '/joint_states' and x.dq is not None]
    with pytest.raises(CtcError, match='two publishers of joint states'):
        read_motion(write(tmp_path / 'states', sorted(
            [*messages, *other], key=lambda message: message[1])))


def test_commands_four_times_as_frequent_as_states_are_averaged(tmp_path: Path) -> None:
    """Between two states all of them are in force, one after the other."""
    t: Any = 1e-3 * np.arange(1000)
    fine = (t[:, None] + 0.25e-3 * np.arange(4)).ravel()
    tau = 20.0 * np.stack((np.sin(3.0 * fine), np.cos(4.0 * fine)), axis=1)
    q = np.sin(np.stack((t, 2.0 * t), axis=1))
    messages = messages_of(t, ('joint1', 'joint2'), q, None, None, None)
    messages += [('/effort_controller/commands', round(1e9 * (1.0 + at)) + 50_000, torques(row))
                 for at, row in zip(fine, tau)]
    found = read_motion(write(tmp_path / 'bag', sorted(messages, key=lambda x: x[1]))).recording
    assert found.command == pytest.approx(tau.reshape(1000, 4, 2).mean(axis=1))
    assert found.late[0] <= 0.0 and found.late[1] >= 0.25


@pytest.mark.parametrize('both', [False, True])
def test_a_clock_that_was_set_back_is_said(tmp_path: Path, both: bool) -> None:
    """It is that of the stamps, or also that of the recorder, which sorts by it."""
    x = made().recording
    back = np.where(np.arange(len(x.t)) >= 600, x.t - 0.3504, x.t)
    messages = messages_of(back, x.joints, x.q, x.dq, None, x.command)
    if both:
        messages.sort(key=lambda message: message[1])
    else:
        messages = [(topic, 10 ** 9 + k * 500_000, message)
                    for k, (topic, _, message) in enumerate(messages)]
    with pytest.raises(CtcError, match=r'0\.2[45].* s after the first, .*: was a clock set back'):
        read_motion(write(tmp_path / 'bag', messages))


def test_a_torque_that_is_no_longer_commanded_is_not_known(tmp_path: Path) -> None:
    x = made().recording
    messages = [message for message in messages_of(x.t, x.joints, x.q, x.dq, None, x.command)
                if not ('commands' in message[0] and 1.5e9 < message[1] < 1.7e9)]
    found = read_motion(write(tmp_path / 'bag', messages)).recording.command
    assert found is not None and x.command is not None
    assert found[:500] == pytest.approx(x.command[:500])
    assert np.isnan(found[530:695]).all()
    assert found[701:] == pytest.approx(x.command[701:])

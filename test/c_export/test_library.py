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

"""`ctc export-c`: the law in C against `Controller.step`, to the last bit. Needs a C compiler."""

from __future__ import annotations

import ctypes
from math import inf, nan, pi, sin
from pathlib import Path
import re
import shutil
import subprocess
from typing import Any

from broken_arm import Broken
from ctc_chattering.c_export.library import c_string, export
from ctc_chattering.control.controller import Controller
from ctc_chattering.control.laws.registry import SWITCHINGS
from ctc_chattering.controller.trips import TRIP_DELAY_S, TRIP_LIMITS, TripMonitor
from ctc_chattering.errors import CtcError, UsageError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_commands import ctc, ctc_process, refused
from exported_laws import compiled_by_cc, controller_of, Robot, robot_of
from machine_code import compile_step
from made_once import made_once
import numpy as np
import pytest
from urdfs import two_links

LAWS = ['compensation', *SWITCHINGS, 'observer_feedback']
(OK, NOT_INITIALIZED, WRONG_ARGUMENT, NOT_FINITE, OVERFLOW, ERROR_LIMIT, ERROR_GROWTH,
 OSCILLATION, WRONG_GAIN, FIXED_GAINS, JUMP) = range(11)


def recorded(robot: Robot, count: int) -> tuple[Array, Array]:
    """Return states of a closed loop with their reference, and the torques, a row a sample."""
    controller, model, n = controller_of(robot), robot.model, robot.model.n
    h, delay, rng = robot.config.control_period, robot.config.input_delay, np.random.default_rng(1)
    phase, size = rng.uniform(0.0, 2.0 * pi, n), np.array(robot.config.ka) / 3.0
    t = h * np.arange(count + delay)[:, np.newaxis]
    points = np.stack((0.3 * np.sin(3.0 * t + phase), 0.9 * np.cos(3.0 * t + phase),
                       -2.7 * np.sin(3.0 * t + phase)), axis=1)
    q, dq = points[0, 0] + 0.01, points[0, 1].copy()
    rows, torques = [], []
    for k in range(count):
        measured = q + 1e-6 * rng.normal(size=n), dq + 1e-4 * rng.normal(size=n)
        at = points[k:k + delay + 1]
        q_d, dq_d, ddq_d = at[0]
        tau = controller.step(*measured, q_d, dq_d, ddq_d, at[1:].tolist()).tau
        rows.append(np.concatenate((*measured, *at.swapaxes(0, 1).reshape(3, -1))))
        torques.append(tau)
        ddq = model.forward(q, dq, np.array(tau) - size * np.sign(dq) * np.cos(20.0 * t[k]))
        dq = dq + h * ddq
        q = q + h * dq
    assert np.abs(q - points[count - 1, 0]).max() < 0.3
    return np.array(rows), np.array(torques)


def check_bits(robot: Robot, library: Path, count: int) -> None:
    """Compare the C example, under ASan and UBSan, with `Controller.step`."""
    export(*robot, library)
    example = compiled_by_cc(library, '-fsanitize=address,undefined', '-fno-sanitize-recover',
                             'example.c')
    states, torques = recorded(robot, count)
    done = subprocess.run([example], input=states.tobytes(), capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b'')
    assert done.stdout == torques.tobytes()
    assert len(np.unique(torques[:, 0])) > count / 2


@pytest.mark.slow
@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize('file', ['friction', 'panda', 'ur5'])
def test_ten_thousand_torques_to_the_last_bit(tmp_path: Path, file: str, law: str) -> None:
    check_bits(robot_of(file, law), tmp_path, 10_000)


@pytest.mark.slow
def test_a_delay_and_limits(tmp_path: Path) -> None:
    robot = robot_of('friction', 'implicit_observer', input_delay=2, inertia_scale=1.1,
                     effort_rate_limit=[2e4, 2e4], effort_limit=[300.0, 60.0])
    odd = robot.config.changed({'joint_names': ['a??/', 'b"\\']})  # As C has them, too.
    check_bits(robot._replace(config=odd), tmp_path, 1000)


def exported_robot(law: str = 'implicit_observer', **values: Any) -> Robot:
    """Return a robot with error limits, drives with a lag and a rate, and an endless joint."""
    robot = robot_of('friction', law, error_limit=[0.5, 0.5], torque_rate_limit=[1e4, 5e3],
                     actuator_lag=[2e-3, 0.0], **values)
    return robot._replace(config=robot.config.changed({'continuous_joints': ['joint2']}))


class Law:
    """A library loaded into this process, with the law in the middle of guarded memory."""

    GUARD = 4096

    def __init__(self, robot: Robot, path: Path) -> None:
        made = path / 'made'
        if not made.exists():
            export(*robot, path)
            made = compiled_by_cc(path, '-fPIC', '-shared')
        self.library = ctypes.CDLL(str(made))
        self.library.ctc_message.restype = ctypes.c_char_p
        self.n, header = robot.model.n, (path / 'ctc_law.h').read_text(encoding='utf-8')
        words = int(header.partition('double memory[')[2].partition(']')[0])
        self.block = np.full(2 * self.GUARD + words + 64, 7, np.uint64)
        self.law = ctypes.c_void_p(self.block[self.GUARD:].ctypes.data)

    def call(self, name: str, *vectors: Any) -> int:
        return int(getattr(self.library, f'ctc_{name}')(
            self.law, *((ctypes.c_double * len(x))(*x) for x in vectors)))

    def step(self, *rows: Any) -> tuple[int, list[float]]:
        """Answer a state: q, dq, q_d, dq_d, ddq_d."""
        arrays = [np.array(x, float) for x in rows]
        tau = np.full(self.n, nan)
        error = self.library.ctc_step(self.law, *(
            ctypes.c_void_p(x.ctypes.data) for x in (*arrays, tau)))
        assert (self.block[:self.GUARD] == 7).all()
        assert (self.block[-self.GUARD:] == 7).all()
        return error, tau.tolist()


REST: list[Any] = [[0.1, 0.2]] * 2 + [[0.1, 0.2]] * 3


@pytest.fixture(scope='module')
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_once(tmp_path_factory, 'exported_law', lambda path: Law(exported_robot(), path))


@pytest.mark.slow
@pytest.mark.parametrize('where', range(5))
@pytest.mark.parametrize('bad', [nan, inf, -inf])
def test_a_state_that_is_not_finite_ends_the_torques_until_a_reset(
        library: Path, where: int, bad: float) -> None:
    law = Law(exported_robot(), library)
    assert law.step(*REST) == (NOT_INITIALIZED, [0.0, 0.0])
    assert law.call('init') == OK
    first = law.step(*REST)
    assert first[0] == OK
    assert any(first[1])
    wrong = [[0.1, bad] if i == where else x for i, x in enumerate(REST)]
    assert law.step(*wrong) == (NOT_FINITE, [0.0, 0.0])
    assert law.step(*REST) == (NOT_FINITE, [0.0, 0.0])
    assert law.call('reset') == OK
    assert law.step(*REST) == first


def test_errors_have_a_code_and_a_torque_of_0(library: Path) -> None:
    law = Law(exported_robot(), library)
    assert [law.call(x) for x in ('reset', 'init')] == [NOT_INITIALIZED, OK]
    for rows, error in (([[0.7, 0.2], *REST[1:]], ERROR_LIMIT), ([[1e200] * 2] * 5, OVERFLOW),
                        ([REST[0], [1e200, -1e200], *REST[2:]], OVERFLOW)):
        assert law.step(*rows) == (error, [0.0, 0.0])
        assert law.step(*REST) == (error, [0.0, 0.0])
        assert law.library.ctc_message(error)
        law.call('reset')
    assert law.library.ctc_step(law.law, None, None, None, None, None, None) == WRONG_ARGUMENT
    assert law.library.ctc_set_gains(law.law, None, None, None) == WRONG_ARGUMENT
    moved = law.block.copy()
    law.law = ctypes.c_void_p(moved[law.GUARD:].ctypes.data)
    assert law.step(*REST) == (NOT_INITIALIZED, [0.0, 0.0])
    assert law.call('set_gains', *[[1.0, 1.0]] * 3) == NOT_INITIALIZED


def test_a_position_that_jumps_ends_the_torques_until_a_reset(library: Path) -> None:
    """By the rule of the node, also where the driver makes the velocity of the jump."""
    law = Law(exported_robot(), library)
    law.call('init')
    first = law.step(*REST)
    assert law.step([0.19, 0.2], *REST[1:])[0] == OK
    assert law.step([0.1, 0.2], *REST[1:])[0] == OK
    for velocity in (0.2, 250.0):
        assert law.step([0.1, 0.45], [0.1, velocity], *REST[2:]) == (JUMP, [0.0, 0.0])
        assert law.step(*REST) == (JUMP, [0.0, 0.0])
        assert b'jumped' in law.library.ctc_message(JUMP)
        law.call('reset')
        assert law.step(*REST) == first


def test_the_elapsed_time_bounds_the_travel_of_a_joint(library: Path) -> None:
    """0.3 rad are a jump within a period, and none within 50 ms at 6 rad/s."""
    law = Law(exported_robot(), library)
    for elapsed, error in ((1e-3, JUMP), (0.05, OK), (nan, NOT_FINITE)):
        law.call('init')
        law.step(REST[0], [0.1, 6.0], *REST[2:])
        arrays = [np.array(x) for x in ([0.1, 0.5], [0.1, 6.0], [0.1, 0.5], *REST[3:])]
        tau = np.zeros(2)
        law.library.ctc_step_after.argtypes = (
            ctypes.c_void_p, ctypes.c_double, *[ctypes.c_void_p] * 6)
        assert law.library.ctc_step_after(
            law.law, elapsed, *(x.ctypes.data for x in (*arrays, tau))) == error
        assert tau.any() == (error == OK)


def check_turns(law: Law, robot: Robot) -> None:
    """
    Let an endless joint turn.

    States and reference within a driver's window have the torques of positions that count turns.
    """
    controller, delay = controller_of(robot), robot.config.input_delay
    law.call('init')
    rate = np.array([0.3, 8.0])
    for k in range(1500):
        t = 1e-3 * (k + np.arange(delay + 1))[:, np.newaxis]
        points = np.array([0.2, 3.0]) + rate * t
        q = points[0] + 0.02 * np.sin(5.0 * t[0])
        speed = rate.tolist()
        expected = controller.step(q.tolist(), speed, points[0].tolist(), speed, [0.0, 0.0], [
            (x, speed, [0.0, 0.0]) for x in points[1:].tolist()])
        wrapped = points.copy()
        wrapped[:, 1] = (points[:, 1] + pi) % (2.0 * pi) - pi
        error, tau = law.step([q[0], (q[1] + pi) % (2.0 * pi) - pi], rate, wrapped,
                              [rate] * (delay + 1), np.zeros((delay + 1, 2)))
        assert error == OK
        assert tau == pytest.approx(expected.tau, rel=1e-9, abs=1e-9)
    assert q[1] > 14.0


def test_an_endless_joint_counts_its_turns(library: Path) -> None:
    check_turns(Law(exported_robot(), library), exported_robot())


@pytest.mark.slow
def test_an_endless_joint_counts_its_turns_behind_a_delay(tmp_path: Path) -> None:
    robot = exported_robot(input_delay=2)
    check_turns(Law(robot, tmp_path), robot)


def test_positions_of_other_joints_are_not_unwrapped(library: Path) -> None:
    """Nor is a start: that of an endless joint is the one nearest to the reference."""
    law = Law(exported_robot(), library)
    law.call('init')
    assert law.step([0.1 - 2.0 * pi, 0.2], *REST[1:]) == (ERROR_LIMIT, [0.0, 0.0])


NO_LIMIT = ('error_limit[CTC_JOINTS] = {0.5, 0.5}',
            'error_limit[CTC_JOINTS] = {INFINITY, INFINITY}')
GROWTH = TRIP_LIMITS.growth
TINY = 1e-9


@pytest.mark.parametrize(('changes', 'cases'), [
    ([], [([0.5 - TINY], OK), ([0.5 + TINY], ERROR_LIMIT), ([-0.5 - TINY], ERROR_LIMIT)]),
    ([NO_LIMIT, ('WATCHED 0', 'WATCHED 1')], [
        ([3.0, 3.0 - 2.0 * GROWTH], OK), ([0.5, 0.25, 0.25 + GROWTH - TINY], OK),
        ([0.5, 0.25, 0.25 + GROWTH + TINY], ERROR_GROWTH)]),
    ([NO_LIMIT, ('STRAINED 0', 'STRAINED MEASURED')], [
        ([TRIP_DELAY_S - TINY], OK), ([TRIP_DELAY_S], OSCILLATION)])])
def test_the_trips_are_at_their_bounds(
        library: Path, tmp_path: Path, changes: list[tuple[str, str]],
        cases: list[tuple[list[float], int]]) -> None:
    """
    Check both sides of the bounds of |e|, of its growth, and of a feedback that is not helped.

    The law is law (6); the numbers beside it are changed to say that it is watched as
    `observer_feedback` is, or that the measured position is how long its feedback was not helped.
    """
    path = tmp_path / 'law'
    shutil.copytree(library, path)
    (path / 'made').unlink()
    data = path / 'ctc_law_data.h'
    text = data.read_text(encoding='utf-8')
    for before, after in changes:
        assert text.count(before) == 1
        text = text.replace(before, after)
    data.write_text(text, encoding='utf-8')
    compiled_by_cc(path, '-fPIC', '-shared')
    # So fast that no position is a jump.
    law, zero, fast = Law(exported_robot(), path), [0.0, 0.0], [1e5, 0.0]
    law.call('init')
    for positions, expected in cases:
        law.call('reset')
        results = [law.step([q, 0.0], fast, *[zero] * 3)[0] for q in positions]
        assert results == [OK] * (len(positions) - 1) + [expected], positions


@pytest.mark.slow
def test_an_error_that_grows_trips_where_the_node_does(tmp_path: Path) -> None:
    robot = robot_of('friction', 'observer_feedback')
    law, controller = Law(robot, tmp_path), controller_of(robot)
    trips = TripMonitor(robot.config.joint_names, 1_000_000)
    law.call('init')
    reason, count = '', 0
    while not reason:
        away = -0.5 + 0.05 * min(max(count - 20, 0), 6) - 0.05 * max(count - 40, 0)
        rows = [[away, 0.2], *REST[1:]]
        sample = controller.step(*rows)
        reason, count = trips.check(controller, sample), count + 1
        expected = (ERROR_GROWTH, [0.0, 0.0]) if reason else (OK, sample.tau)
        assert law.step(*rows) == expected
    assert 'has grown by' in reason
    assert count > 40


@pytest.mark.slow
def test_a_limit_cycle_trips_where_the_node_does(tmp_path: Path) -> None:
    """
    A joint that oscillates at 20 Hz whatever its torque is, after half a second at rest.

    C looks at each sample, the node each 20 ms.
    """
    robot = robot_of('friction', 'observer_feedback', kp=[1e4] * 2, kv=[200.0] * 2)
    law, controller = Law(robot, tmp_path), controller_of(robot)
    trips = TripMonitor(robot.config.joint_names, 1_000_000)
    law.call('init')
    reason, count, tripped = '', 0, 0
    while not reason and count < 3000:
        rows: list[Any] = [
            [0.0, 0.003 * sin(0.04 * pi * max(count - 500, 0))], *[[0.0, 0.0]] * 4]
        sample = controller.step(*rows)
        if not tripped:
            answer = law.step(*rows)
            tripped = count if answer[0] == OSCILLATION else 0
            assert answer == ((OSCILLATION, [0.0, 0.0]) if tripped else (OK, sample.tau))
        reason, count = trips.check(controller, sample), count + 1
    shown = re.search(r'joint. oscillates at (\d+) Hz; the joints are elastic', reason)
    assert shown is not None, reason
    assert 18 <= int(shown[1]) <= 22
    assert 1500 < tripped <= count < tripped + 21


def check_gains(other: Law, controller: Controller) -> None:
    """Change gains before the first step, in motion, and after a reset."""
    other.call('init')
    rng, sizes = np.random.default_rng(0), {'kp': 400.0, 'kv': 40.0, 'ka': 5.0}
    for k in range(200):
        if k == 150:
            other.call('reset')
            controller.reset()
        if k in (0, 50, 100):
            gains = {name: x * rng.uniform(0.5, 2.0, 2) for name, x in sizes.items()}
            assert other.call('set_gains', *gains.values()) == OK
            controller.configure(controller.config.changed(gains))
        compile_step(controller)
        rows = [[0.1 + 1e-3 * k, 0.2 + 0.1 * np.sin(0.3 * k)], *REST[1:]]
        assert other.step(*rows) == (OK, controller.step(*rows).tau)
    assert controller.compiled


def test_other_gains_go_on_as_under_configure(library: Path) -> None:
    check_gains(Law(exported_robot(), library), controller_of(exported_robot()))


@pytest.mark.slow
@pytest.mark.parametrize('law', [
    x for x in (*LAWS, 'extended_state_observer') if x != 'implicit_observer'])
def test_other_gains_of_each_law(tmp_path: Path, law: str) -> None:
    robot = exported_robot(law)
    check_gains(Law(robot, tmp_path), controller_of(robot))


def test_wrong_gains_change_nothing(library: Path) -> None:
    law, good = Law(exported_robot(), library), [[100.0, 100.0]] * 3
    law.call('init')
    before = law.block.copy()
    for i in range(3):
        for bad in (nan, inf, -inf, -1.0, 2e9, *[0.0] * (i < 2)):
            assert law.call('set_gains', *good[:i], [100.0, bad], *good[i + 1:]) == WRONG_GAIN
    assert (law.block == before).all()


@pytest.mark.slow
@pytest.mark.parametrize('law', ['integral', 'slotine_li', 'pid_kalman'])
def test_gains_are_fixed_where_other_numbers_depend_on_them(
        tmp_path: Path, law: str) -> None:
    fixed = Law(robot_of('friction', law), tmp_path)
    fixed.call('init')
    assert fixed.call('set_gains', *[[100.0, 100.0]] * 3) == FIXED_GAINS


def test_a_floating_point_trap_or_rounding_of_the_caller_changes_nothing(
        library: Path) -> None:
    """With traps for invalid operations, overflow and division by 0, and rounding upwards."""
    law, libm = Law(exported_robot(), library), ctypes.CDLL('libm.so.6')
    law.call('init')
    states = [[[0.1 + 1e-3 * k, 0.0], *REST[1:]] for k in range(20)]
    right = [law.step(*x) for x in states]
    law.call('reset')
    upward = 0x800
    assert libm.fesetround(upward) == 0
    libm.feenableexcept(0x1 | 0x4 | 0x8)
    try:
        found = [law.step(*x) for x in states]
        jump = law.step([1e200] * 2, [1e200] * 2, *REST[2:])
        law.call('reset')
        overflow = law.step([1e200] * 2, [1e200] * 2, *REST[2:])
        assert libm.fegetround() == upward
    finally:
        libm.fedisableexcept(0x3d)
        libm.fesetround(0)
    assert found == right
    assert (jump, overflow) == ((JUMP, [0.0, 0.0]), (OVERFLOW, [0.0, 0.0]))


@pytest.mark.slow
def test_the_same_input_gives_the_same_bytes(tmp_path: Path) -> None:
    """From the command line and in Python, after whatever else has been compiled."""
    first, again = tmp_path / 'first', tmp_path / 'again'
    export(*robot_of('friction', 'compensation'), first)
    done = ctc('export-c', 'friction', '--law', 'compensation', '--out', str(again))
    assert done.stdout.startswith(f'wrote {again}: law compensation for 2 joints, ')
    for path in again.iterdir():
        assert path.read_bytes() == (first / path.name).read_bytes()
    symbols = subprocess.check_output(['nm', again / 'ctc_law_code.o'], text=True)
    assert {x.split()[-1] for x in symbols.splitlines() if ' U ' in x} <= {
        'fmod', 'memcpy', 'memset', 'sin', 'sincos'}


@pytest.mark.slow
def test_export_needs_no_code_compiled_before(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Export from a process of its own, with an empty cache."""
    monkeypatch.setenv('HOME', str(tmp_path))
    done = ctc_process('export-c', 'friction', '--law', 'compensation', '--out', tmp_path / 'law',
                       timeout=300.0)
    assert done.returncode == 0, done.stderr


def test_a_wrong_name_of_a_package_is_refused(tmp_path: Path) -> None:
    refused(ctc('export-c', 'friction', '--out', str(tmp_path / 'out'),
                '--ros2-control', 'My-Arm'), '--ros2-control My-Arm', 'small letters')
    for name in ('my_arm-2', 'my_Arm', 'my arm', 'arm/../..', 'arm.h', '2_arms', 'arm"\n'):
        with pytest.raises(UsageError, match='small letters'):
            export(*exported_robot(), tmp_path / 'out', package=name)
    assert not list(tmp_path.iterdir())


def test_a_negative_effort_limit_is_not_exported(tmp_path: Path) -> None:
    (tmp_path / 'arm.urdf').write_text(two_links().replace('effort="40"', 'effort="-1"'))
    (tmp_path / 'arm.yaml').write_text(
        '/**: {ros__parameters: {model: urdf, description: arm.urdf, joint_names: [a, b]}}\n'
        'reference: {ros__parameters: {center: [0, 0], amplitude: 0.1, frequency: 0.1}}')
    done = ctc('export-c', 'arm.yaml', '--out', 'law', cwd=tmp_path)
    refused(done, 'joint a: effort is -1')
    assert not (tmp_path / 'law').exists()


@pytest.mark.parametrize('standard', ['c99', 'c11', 'gnu17', 'c++98', 'c++17'])
def test_names_of_joints_are_literals_of_every_version_of_c(standard: str, tmp_path: Path) -> None:
    """Check trigraphs, ends of strings and lines, and what is no ASCII."""
    names = ['joint 1', 'a??/', '??=??(', '"\\', 'tab\t1', 'line\n2', 'é\u20ac', '\x7f1', '%s',
             'b\\']
    source = tmp_path / ('names.cpp' if '++' in standard else 'names.c')
    source.write_text('#include <stdio.h>\nint main(void) {\n' + ''.join(
        f'fwrite({c_string(x)}, 1, sizeof({c_string(x)}), stdout);\n' for x in names)
        + 'return 0;\n}\n')
    subprocess.run(['c++' if '++' in standard else 'cc', f'-std={standard}', '-Wall', '-Wextra',
                    '-Wpedantic', '-Werror', source, '-o', tmp_path / 'names'], check=True)
    printed = subprocess.check_output([tmp_path / 'names'])
    assert printed.decode().split('\0')[:-1] == names


def test_an_own_model_and_full_matrices_are_refused(tmp_path: Path) -> None:
    robot = robot_of('friction', 'compensation')
    with pytest.raises(CtcError, match='cannot be exported; allowed: models two_link and urdf'):
        export(robot.config, Broken(('joint1', 'joint2'), 9.81), tmp_path)
    with pytest.raises(CtcError, match='a full matrix cannot be exported'):
        export(robot.config.changed({'kv': [2.0, 1.0, 1.0, 2.0]}), robot.model, tmp_path)

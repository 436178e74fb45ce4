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

from collections.abc import Callable
import ctypes
from math import inf, nan, pi
from pathlib import Path
import subprocess
from typing import Any

from broken_arm import Broken
from ctc_chattering.c_export.library import export, Robot
from ctc_chattering.control.controller_config import SWITCHINGS
from ctc_chattering.controller.trips import TripMonitor
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_commands import ctc, refused
from exported_laws import compiled_by_cc, controller_of, robot_of, watched
from machine_code import compile_step
import numpy as np
import pytest

LAWS = ['compensation', *SWITCHINGS, 'observer_feedback']
(OK, NOT_INITIALIZED, WRONG_ARGUMENT, NOT_FINITE, OVERFLOW, ERROR_LIMIT, ERROR_GROWTH) = range(7)


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
    export([robot], library)
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


def test_a_delay_and_limits(tmp_path: Path) -> None:
    check_bits(robot_of('friction', 'implicit_observer', input_delay=2, inertia_scale=1.1,
                        effort_rate_limit=[2e4, 2e4], effort_limit=[300.0, 60.0]), tmp_path, 1000)


class Law:
    """A library loaded into this process, with the law in the middle of guarded memory."""

    GUARD = 4096

    def __init__(self, robot: Robot, path: Path, *others: Robot) -> None:
        if not path.joinpath('ctc_law.c').exists():
            export([robot, *others], path)
        self.library = ctypes.CDLL(str(compiled_by_cc(path, '-fPIC', '-shared')))
        self.library.ctc_message.restype = ctypes.c_char_p
        self.n, header = robot.model.n, (path / 'ctc_law.h').read_text(encoding='utf-8')
        words = int(header.partition('double memory[')[2].partition(']')[0])
        self.block = np.full(2 * self.GUARD + words + 64, 7, np.uint64)
        self.law = ctypes.c_void_p(self.block[self.GUARD:].ctypes.data)

    def call(self, name: str, *arguments: int) -> int:
        return int(getattr(self.library, f'ctc_{name}')(self.law, *arguments))

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
def paths(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    base = tmp_path_factory.mktemp('libraries')
    return lambda name: base / name


@pytest.mark.slow
@pytest.mark.parametrize('where', range(5))
@pytest.mark.parametrize('bad', [nan, inf, -inf])
def test_what_is_not_finite_is_no_torque_until_a_reset(
        paths: Callable[[str], Path], where: int, bad: float) -> None:
    law = Law(watched()[0], paths('watched'), watched()[1])
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


def test_errors_have_a_code_and_a_torque_of_0(paths: Callable[[str], Path]) -> None:
    law = Law(watched()[0], paths('watched'), watched()[1])
    assert [law.call(x) for x in ('reset', 'init')] == [NOT_INITIALIZED, OK]
    for rows, error in (([[0.7, 0.2], *REST[1:]], ERROR_LIMIT), ([[1e200] * 2] * 5, OVERFLOW),
                        ([REST[0], [1e200, -1e200], *REST[2:]], OVERFLOW)):
        assert law.step(*rows) == (error, [0.0, 0.0])
        assert law.step(*REST) == (error, [0.0, 0.0])
        assert law.library.ctc_message(error)
        law.call('reset')
    assert law.library.ctc_step(law.law, None, None, None, None, None, None) == WRONG_ARGUMENT
    assert [law.call('set_gains', x) for x in (-1, 2)] == [WRONG_ARGUMENT] * 2
    moved = law.block.copy()
    law.law = ctypes.c_void_p(moved[law.GUARD:].ctypes.data)
    assert law.step(*REST) == (NOT_INITIALIZED, [0.0, 0.0])


@pytest.mark.slow
def test_an_error_that_grows_trips_where_the_node_does(tmp_path: Path) -> None:
    robot = robot_of('friction', 'observer_feedback')
    law, controller = Law(robot, tmp_path), controller_of(robot)
    trips = TripMonitor(robot.config.joint_names, 1_000_000)
    law.call('init')
    reason, count = '', 0
    while not reason:
        rows = [[-0.5 + 0.3 * (count > 20) - 1.5 * (count > 40), 0.2], *REST[1:]]
        sample = controller.step(*rows)
        reason, count = trips.check(controller, sample), count + 1
        expected = (ERROR_GROWTH, [0.0, 0.0]) if reason else (OK, sample.tau)
        assert law.step(*rows) == expected
    assert 'has grown by' in reason
    assert count > 40


def test_other_gains_go_on_as_under_configure(paths: Callable[[str], Path]) -> None:
    one, other = watched()
    law, controller = Law(one, paths('watched'), other), controller_of(one)
    law.call('init')
    for k in range(40):
        rows = [[0.1 + 1e-3 * k, 0.2], *REST[1:]]
        if k == 20:
            assert law.call('set_gains', 1) == OK
            controller.configure(other.config)
            compile_step(controller)
        assert law.step(*rows) == (OK, controller.step(*rows).tau)
    assert controller.compiled


def test_a_floating_point_trap_or_rounding_of_the_caller_changes_nothing(
        paths: Callable[[str], Path]) -> None:
    """With traps for invalid operations, overflow and division by 0, and rounding upwards."""
    law, libm = Law(watched()[0], paths('watched'), watched()[1]), ctypes.CDLL('libm.so.6')
    law.call('init')
    states = [[[0.1 + 1e-3 * k, 0.0], *REST[1:]] for k in range(20)]
    right = [law.step(*x) for x in states]
    law.call('reset')
    upward = 0x800
    assert libm.fesetround(upward) == 0
    libm.feenableexcept(0x1 | 0x4 | 0x8)
    try:
        found = [law.step(*x) for x in states]
        overflow = law.step([1e200] * 2, [1e200] * 2, *REST[2:])
        assert libm.fegetround() == upward
    finally:
        libm.fedisableexcept(0x3d)
        libm.fesetround(0)
    assert found == right
    assert overflow == (OVERFLOW, [0.0, 0.0])


@pytest.mark.slow
def test_the_same_input_gives_the_same_bytes(tmp_path: Path) -> None:
    """From the command line and in Python, after whatever else has been compiled."""
    first, again = tmp_path / 'first', tmp_path / 'again'
    export([robot_of('friction', 'compensation')], first)
    done = ctc('export-c', 'friction', '--law', 'compensation', '--out', str(again))
    assert done.stdout.startswith(f'wrote {again}: compensation, 2 joints, ')
    for path in again.iterdir():
        assert path.read_bytes() == (first / path.name).read_bytes()
    symbols = subprocess.check_output(['nm', again / 'ctc_law_code.o'], text=True)
    assert {x.split()[-1] for x in symbols.splitlines() if ' U ' in x} <= {
        'fmod', 'memcpy', 'memset', 'sin', 'sincos'}


@pytest.mark.parametrize(('arguments', 'words'), [
    (['--ros2-control', 'My-Arm'], ['--ros2-control My-Arm', 'small letters']),
    (['--gain-sets', 'panda'], ['panda differs from friction in more than gains'])])
def test_what_is_refused_in_one_line(tmp_path: Path, arguments: list[str], words: list[str]
                                     ) -> None:
    refused(ctc('export-c', 'friction', '--out', str(tmp_path / 'out'), *arguments), *words)
    assert not list(tmp_path.iterdir())


def test_a_model_of_ones_own_is_refused(tmp_path: Path) -> None:
    robot = robot_of('friction', 'compensation')
    with pytest.raises(CtcError, match='cannot be exported; allowed: models two_link and urdf'):
        export([robot._replace(model=Broken(('joint1', 'joint2'), 9.81))], tmp_path)

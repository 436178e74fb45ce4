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
The exported controller of ros2_control, compiled against a stub of what it uses of ROS 2.

validation/README.md says what was run in a controller manager. Needs a C++ compiler.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, inf, nan, sin
from pathlib import Path
import re
import shutil
import subprocess
from typing import cast

from ctc_chattering.c_export.library import export
from ctc_chattering.controller.trips import TRIP_DELAY_S
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.trajectory.buffer import Point, Trajectory
from ctc_chattering.trajectory.path_clock import Stop
from ctc_chattering.trajectory.transitions import BRAKING_TIME, TimedMotion
from exported_laws import controller_of, Robot, robot_of, watched
from machine_code import compile_step
import numpy as np
import pytest

#: The compiler takes half a minute; `.ci/run` runs them.
pytestmark = pytest.mark.slow
HERE = Path(__file__).parent
MS = 1_000_000
#: Begin of the reference, its last point, and how long it may be late [ns].
BEGIN, END, GRACE = 1000 * MS, 1100 * MS, 100 * MS
GOOD, FAILED = 0, 1


def point_at(t: int) -> Point:
    x = 3e-9 * t
    return ((0.3 * sin(x), 0.2 * cos(x)), (0.9 * cos(x), -0.6 * sin(x)),
            (-2.7 * sin(x), -1.8 * cos(x)))


#: A point every 10 ms, in motion to the end.
POINTS = [(t, point_at(t)) for t in range(BEGIN, END + 1, 10 * MS)]
#: The same, with a point at rest after it.
RESTING = [*POINTS, (END + 10 * MS, (POINTS[-1][1][0], (0.0, 0.0), (0.0, 0.0)))]


def reference(points: Sequence[tuple[int, Point]] = POINTS, stamp: int = BEGIN) -> str:
    lines = (f'{t - stamp} ' + ' '.join(repr(x) for row in rows for x in row)
             for t, rows in points)
    return f'reference {stamp} {len(points)} ' + ' '.join(lines)


def update(t: int, q: Vector = (0.0, 0.2), dq: Vector = (0.9, 0.0)) -> str:
    return f'update {t} {q[0]!r} {dq[0]!r} {q[1]!r} {dq[1]!r}'


@pytest.fixture(scope='module')
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(watched(), tmp_path_factory.mktemp('package'))


def built(robot: Robot, package: Path) -> Path:
    """Return a program that runs the controller by commands."""
    export(*robot, package, package='int')  # A word of C++.
    for name in re.findall('#include "(.*/.*)"', (package / 'controller.cpp').read_text()):
        path = package / 'stub' / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text('#include "ros2_control_stub.hpp"\n')
    assert shutil.which('c++'), 'this test needs a C++ compiler: apt-get install g++'
    subprocess.run(['cc', '-O2', '-c', 'ctc_law.c', '-o', 'ctc_law.o'], cwd=package / 'ctc_law',
                   check=True)
    subprocess.run(
        ['c++', '-std=c++17', '-O1', '-Wall', '-Wextra', '-Werror', '-fsanitize=address,undefined',
         f'-I{HERE}', '-Istub', '-I.', '-Ictc_law', HERE / 'run_controller.cpp',
         'ctc_law/ctc_law.o', 'ctc_law/ctc_law_code.o', '-o', 'run'], cwd=package, check=True)
    return package / 'run'


def run(program: Path, *commands: str) -> list[list[float]]:
    """Return what was returned by each command, with the torques, and more after an update."""
    done = subprocess.run([program], input='\n'.join(commands), text=True, capture_output=True,
                          check=True)
    return [[float(x) for x in line.split()] for line in done.stdout.splitlines()]


def test_the_torques_are_those_of_the_controller(program: Path) -> None:
    """
    At and between points of the reference, with other gains, to the last bit.

    The points of the first message are kept until those of the second begin.
    """
    robot = watched()
    controller, trajectory = controller_of(robot), Trajectory(GRACE)
    trajectory.extend([t for t, _ in POINTS], [x for _, x in POINTS])
    commands, expected = [
        'configure', 'activate', reference(POINTS[:6]), reference(POINTS[6:])], []
    for k, t in enumerate(range(BEGIN, END + GRACE // 2, MS + 77)):
        if k == 60:
            controller.configure(robot.config.changed({'kp': [400.0, 300.0], 'ka': [3.0, 2.0]}))
            compile_step(controller)
            commands += ['gain kp 400 300', 'gain ka 3 2']
        desired = trajectory.at(t)
        assert desired is not None
        q = desired[0][0] + 1e-3 * sin(k), desired[0][1]
        sample = controller.step(q, desired[1], *desired)
        commands.append(update(t, q, desired[1]))
        expected.append([
            GOOD, *sample.tau, *desired[0], *sample.e, *sample.nominal,
            *(-x for x in (*sample.compensation, *sample.robust)), *sample.tau,
            pytest.approx(controller.lyapunov(q, sample.v), rel=1e-12)])
    found = zip(run(program, *commands), commands)
    assert [x for x, line in found if line[:6] == 'update'] == expected


@pytest.mark.parametrize(('commands', 'results'), [
    ([update(BEGIN)], [GOOD]),                                        # No reference yet.
    ([reference(), update(BEGIN - MS)], [GOOD]),                      # It is still to come.
    ([reference(), update(BEGIN, (nan, 0.2))], [FAILED]),
    ([reference(), update(BEGIN, dq=(0.0, inf))], [FAILED]),
    ([reference(), update(BEGIN, (0.7, 0.2)), update(BEGIN + MS)], [FAILED, FAILED]),  # |e|
    ([reference(), update(END + GRACE + MS, POINTS[-1][1][0])], [FAILED]),
    ([reference(), 'activate', update(BEGIN)], [GOOD]),               # It is forgotten.
    (['publishers 2', reference(), update(BEGIN)], [GOOD]),           # None is obeyed.
    ([reference(stamp=-BEGIN), update(BEGIN)], [GOOD]),
    ([reference([POINTS[1], POINTS[0]]), update(BEGIN + 10 * MS)], [GOOD]),
    ([reference(POINTS[:2], POINTS[1][0]), update(BEGIN + 5 * MS)], [GOOD]),  # Negative times.
    (['reference 0 0', update(BEGIN)], [GOOD]),                       # Nothing to stop.
    ([update(END + GRACE + MS), reference(RESTING[:-1]), update(END + GRACE + 2 * MS)],
     [GOOD, GOOD]),                                                   # All of it is past.
    ([reference(), update(BEGIN), update(BEGIN + MS, (0.2, 0.2))], [GOOD, FAILED]),  # A jump.
    ([reference([(BEGIN, ((nan, 0.0), *POINTS[0][1][1:]))]), update(BEGIN)], [GOOD]),
    ([reference(), update(BEGIN), 'deactivate'], [GOOD])])
def test_where_there_is_no_torque(program: Path, commands: list[str], results: list[int]) -> None:
    found = run(program, 'configure', 'activate', *commands)
    assert results == [x[0] for x, line in zip(found[2:], commands) if line[:6] == 'update']
    assert found[-1][1:3] == [0.0, 0.0]


def test_a_reference_without_points_stops_the_motion_on_its_path(program: Path) -> None:
    """Within half a second from 20 ms on, to a place that is held; the next points move again."""
    points = [(t, point_at(t)) for t in range(BEGIN, BEGIN + 500 * MS, 10 * MS)]
    trajectory = Trajectory(GRACE)
    trajectory.extend([t for t, _ in points], [x for _, x in points])
    begin = BEGIN + 30 * MS
    stop = Stop(cast('TimedMotion', trajectory), begin + 20 * MS, BRAKING_TIME)
    times = range(BEGIN, BEGIN + 1500 * MS, MS)
    commands, desired = ['configure', 'activate', reference(points)], []
    for t in times:
        q, dq, _ = stop.at(t)
        commands += ['reference 0 0'] * (t == begin + MS) + [update(t, q, dq)]
        desired.append(q)
    done = [x for x, line in zip(run(program, *commands), commands) if line[:6] == 'update']
    assert {x[0] for x in done} == {GOOD}
    found = np.array([x[3:5] for x in done])
    assert np.abs(found - desired).max() < 1e-6
    assert np.ptp(found[-800:], axis=0).max() == 0.0
    last = stop.at(stop.end)[0]
    assert found[-1] == pytest.approx(last, abs=1e-6)
    assert np.abs(np.diff(found, axis=0)).max() < 1.01e-3


def test_late_points_of_the_reference_are_gone_through_where_they_are_due(program: Path) -> None:
    """Those that are past are dropped; the motion is where the trajectory is now."""
    late = BEGIN + 55 * MS
    found = run(program, 'configure', 'activate', update(late - MS), reference(),
                update(late, point_at(late)[0], point_at(late)[1]))
    assert found[-1][0] == GOOD
    assert found[-1][3:5] == pytest.approx(point_at(late)[0], abs=1e-9)


def test_an_oscillating_feedback_trips_until_it_is_activated_again(tmp_path: Path) -> None:
    """
    Once it has not been helped for `TRIP_DELAY_S`, of which the node reads every 20 ms.

    Until then a reference that ends at rest is held.
    """
    robot = robot_of('friction', 'observer_feedback')
    rest, times = RESTING[-1][1], range(END + 10 * MS, END + 3000 * MS, MS)
    states = [(rest[0][0] + 0.049 * (-1) ** k, rest[0][1]) for k in range(len(times))]
    found = run(
        built(robot, tmp_path), 'configure', 'activate', reference(RESTING),
        *(update(t, q, rest[1]) for t, q in zip(times, states)), 'deactivate', 'activate',
        reference([(times[-1], rest)], times[-1]), update(times[-1], *rest[:2]))
    controller, expected = controller_of(robot), list[list[float]]()
    while controller.stability[1] < TRIP_DELAY_S:
        expected.append([GOOD, *controller.step(states[len(expected)], rest[1], *rest).tau])
    expected[-1:] = [[FAILED, 0.0, 0.0]] * (len(times) - len(expected) + 1)
    assert [x[:3] for x in found[3:-4]] == expected
    assert (found[-1][0], any(found[-1][1:3])) == (GOOD, True)


def test_another_rate_timeout_and_wrong_gains_are_refused(program: Path) -> None:
    found = run(program, 'rate 500', 'configure', 'rate 1000', 'configure', 'gain kp 200 1e5',
                'gain kp nan 200', 'gain kv 0 50', 'gain ka 0 11', 'gain ka 2000 11',
                'gain ka 900 11')
    assert [x[0] for x in found] == [0, 2, 0, 0, FAILED, FAILED, FAILED, GOOD, FAILED, GOOD]
    found = run(program, *(line for x in ('inf', 'nan', '0', '-1', '0.5')
                           for line in (f'timeout {x}', 'configure')))
    assert [x[0] for x in found[1::2]] == [2, 2, 2, 2, GOOD]

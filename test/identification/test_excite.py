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

"""Motions that excite a robot: what they keep, what they contain, and what is foretold."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from pathlib import Path
import re
from typing import Any, NamedTuple
import xml.etree.ElementTree as ET

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.collision import SelfCollision
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import make_model, model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.excite import (
    AssumedFriction,
    excite,
    first_motion,
    Plan,
    write_excitation,
)
from ctc_chattering.identification.random_motions import (
    bounds_of,
    Excitation,
    ExcitationConfig,
    random_motion,
)
from ctc_chattering.output_folder import LIST
from ctc_chattering.simulation.closed_loop import Run, run_closed_loop
from ctc_chattering.simulation.plant import make_plant
from ctc_chattering.trajectory.joint_limits import read_limits
from ctc_chattering.trajectory.reference import make_motion
from ctc_commands import ctc, refused
import numpy as np
import numpy.typing as npt
import pytest
from urdfs import joint, link, PANDA, panda, two_links, UR5, ur5, urdf

Array = npt.NDArray[np.float64]
ROOT = Path(__file__).parents[2]
#: Step of the finite differences and duration of the motions [s], and size of the searches.
STEP, DURATION, EVALUATIONS = 0.01, 60.0, 50


class Motion(NamedTuple):
    """A motion as the reference plays it, sampled; its derivatives are finite differences."""

    found: Plan
    setup: Setup
    t: Array
    q: Array
    dq: Array
    ddq: Array


@cache
def made(robot: str) -> Plan:
    setup = parameter_file.load(ROOT / 'config' / f'{robot}.yaml')
    return excite(setup, {'duration': DURATION, 'evaluations': EVALUATIONS, 'seed': 1})


ROBOTS = ['friction', *(pytest.param(x, marks=pytest.mark.slow) for x in ('panda', 'ur5'))]


@pytest.fixture(scope='module', params=ROBOTS)
def motion(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Motion:
    """Return the motion of a robot, written, read, and played from where the plant is."""
    return of(request.param, tmp_path_factory.mktemp(request.param))


def of(robot: str, out: Path) -> Motion:
    found = made(robot)
    write_excitation(found, parameter_file.load(ROOT / 'config' / f'{robot}.yaml'), out)
    setup = parameter_file.load(out / 'run.yaml')
    plant = setup.plant
    way = make_motion(setup.reference, setup.route, dict(zip(
        plant.joint_names, zip(plant.initial_position, plant.initial_velocity))))
    t = np.arange(0.0, DURATION + STEP / 2.0, STEP)
    points = [way.at(round(x * 1e9)) for x in t]
    q = np.array([point[0] for point in points])
    return Motion(found, setup, t[1:-1], q[1:-1], (q[2:] - q[:-2]) / (2.0 * STEP),
                  (q[2:] - 2.0 * q[1:-1] + q[:-2]) / STEP ** 2)


def model(setup: Setup) -> Model:
    return model_of(setup.controller, setup.descriptions.get('controller', ''))


def described(name: str) -> dict[str, Array]:
    """Return limits of a robot, read from its URDF here."""
    text, names = {'panda': (panda(), PANDA), 'ur5': (ur5(), UR5)}[name]
    joints = ET.fromstring(text.encode()).findall('joint')
    elements = {x.get('name'): x.find('limit') for x in joints}
    rows: list[Any] = [elements[x] for x in names]
    return {key: np.array([float(row.get(key)) for row in rows])
            for key in ('lower', 'upper', 'velocity', 'effort')}


def test_the_played_motion_keeps_the_limits(motion: Motion) -> None:
    """Check finite differences against the URDF's numbers, or 1 rad/s and 4 rad/s² without."""
    name = motion.setup.plant.experiment
    center = np.array(motion.setup.reference.center)
    speed = np.ones(2)
    if name != 'friction':
        limits = described(name)
        margin = 0.05 * (limits['upper'] - limits['lower'])
        assert (motion.q > limits['lower'] + margin).all()
        assert (motion.q < limits['upper'] - margin).all()
        speed = 0.5 * limits['velocity']
    away = motion.q[motion.t > 8.0] - center
    assert np.abs(away).max() < 0.8
    assert (np.abs(away).max(axis=0) > 0.5).all()
    assert (np.abs(motion.dq).max(axis=0) < speed).all()
    assert (np.abs(motion.ddq).max(axis=0) < 4.0 * speed).all()


def test_it_begins_and_ends_at_rest_without_jumps(motion: Motion) -> None:
    start, center = motion.setup.plant.initial_position, motion.setup.reference.center
    for at, place in ((0, start), (-1, center)):
        assert motion.q[at] == pytest.approx(np.array(place), abs=1e-5)
        assert np.abs(motion.dq[at]).max() < 1e-3
    # A quintic over 1 rad in 1 s has a jerk of 60 rad/s³; a jump is that of any step.
    assert np.abs(np.diff(motion.dq, axis=0)).max() < 7.0 * STEP
    assert np.abs(np.diff(motion.ddq, axis=0)).max() < 60.0 * STEP
    assert motion.setup.plant.duration == DURATION
    assert motion.found.excitation.route.times[-1] == DURATION * 1e9


def reversals(t: Array, dq: Array, begin: float, end: float) -> list[tuple[int, int]]:
    """Return index and direction of the changes of sign of one velocity, rest left out."""
    # Differences reach a sample beyond.
    inside = (t > begin + STEP) & (t < end - STEP)
    moving = np.flatnonzero(inside & (np.abs(dq) > 1e-4))
    return [(int(b), int(np.sign(dq[b]))) for a, b in pairwise(moving) if dq[a] * dq[b] < 0.0]


def test_every_joint_reverses_slowly_both_ways_at_three_poses(motion: Motion) -> None:
    spans = motion.found.excitation.slow
    assert len(spans) == 3
    for i in range(motion.q.shape[1]):
        poses = []
        for begin, end, _ in spans:
            found = reversals(motion.t, motion.dq[:, i], begin, end)
            assert sorted(way for _, way in found) == [-1, 1]
            for k, _ in found:
                assert abs(motion.ddq[k, i]) < 0.5
                # Near zero velocity for long: some 0.1 s within 0.02 rad/s.
                near = (np.abs(motion.t - motion.t[k]) < 0.5) & (np.abs(motion.dq[:, i]) < 0.02)
                assert near.sum() * STEP > 0.07
            poses.append(motion.q[(motion.t > begin) & (motion.t < end), i].mean())
        assert min(b - a for a, b in pairwise(sorted(poses))) > 0.02
        assert max(poses) - min(poses) > 0.25


def test_the_peak_torque_is_that_of_the_motion(motion: Motion) -> None:
    """Check torques of matrices and potential."""
    robot, plant = model(motion.setup), motion.setup.plant
    found = motion.found
    worst = [int(np.abs(found.tau[:, i]).argmax()) for i in range(robot.n)]
    for i, k in enumerate(worst):
        j = int(np.abs(motion.t - STEP * k).argmin())
        q, dq, ddq = motion.q[j], motion.dq[j], motion.ddq[j]
        d = 1e-5 * np.eye(robot.n)[i]
        torque = (np.array(robot.mass_matrix(q)) @ ddq + np.array(robot.coriolis_matrix(q, dq))
                  @ dq)[i] + (robot.potential_energy(q + d) - robot.potential_energy(q - d)) / 2e-5
        torque += plant.coulomb_friction[i] * np.sign(dq[i]) + plant.viscous_friction[i] * dq[i]
        assert np.abs(found.tau[:, i]).max() == pytest.approx(abs(torque), rel=0.02)


def run_of(motion: Motion) -> Run:
    setup = motion.setup
    text = setup.descriptions.get('plant', '')
    return run_closed_loop(setup.plant, setup.controller, setup.reference, route=setup.route,
                           robot=make_plant(setup.plant, text), model=model(setup))


def assert_identifiable(motion: Motion, run: Run) -> None:
    """Check that that least squares of a run find the friction, conditioned as foretold."""
    robot, h = model(motion.setup), run.t[1]
    # Over ten samples, from the middle of which all but the acceleration is taken.
    middle = np.arange(5, len(run.t) - 5, 10)
    q, dq, ddq = run.q[middle], run.dq[middle], (
        run.dq[middle + 5] - run.dq[middle - 5]) / (10.0 * h)
    tau = np.array([run.tau[middle + k] for k in range(-5, 5)]).mean(axis=0)
    gravity = np.array([robot.gravity_torque(x) for x in q])
    inertial = np.array([robot.inverse_dynamics(*x) for x in zip(q, dq, ddq)]) - gravity
    for i, coulomb in enumerate(motion.setup.plant.coulomb_friction):
        steady = np.ptp(np.sign([run.dq[middle + k, i] for k in range(-5, 6)]), axis=0) == 0
        a = np.column_stack([np.sign(dq[:, i]), np.ones(len(q)), dq[:, i], inertial[:, i],
                             gravity[:, i]])[steady & (dq[:, i] != 0.0)]
        a = a[:, np.abs(a).max(axis=0) > 1e-6]
        found = np.linalg.lstsq(a, tau[steady & (dq[:, i] != 0.0), i], rcond=None)[0]
        assert found[0] == pytest.approx(coulomb, rel=0.01)
        assert found[2] == pytest.approx(motion.setup.plant.viscous_friction[i], rel=0.05,
                                         abs=0.05)


@pytest.mark.parametrize('robot', ROBOTS)
def test_the_robot_under_friction_reverses_where_the_motion_does(robot: str, tmp_path: Path
                                                                 ) -> None:
    """Check a run under law compensation: no joint sticks through the slow reversals."""
    motion = of(robot, tmp_path)
    run = run_of(motion)
    assert run.t[-1] == DURATION
    for i, slow in enumerate(motion.found.bounds.slow):
        for begin, end, _ in motion.found.excitation.slow:
            # The first way may begin with the other sign: friction held the joint elsewhere.
            assert len(reversals(run.t, run.dq[:, i], begin, end)) >= 2
            inside = run.q[(run.t > begin) & (run.t < end), i]
            assert np.ptp(inside) > 1.3 * slow
        for _, begin, end in motion.found.excitation.slow:
            # It creeps: for a second at least it slides, and no faster than that.
            speed = np.abs(run.dq[(run.t > begin) & (run.t < end), i])
            assert ((speed > 0.002) & (speed < 0.025)).mean() * (end - begin) > 1.0
    assert_identifiable(motion, run)
    peak = np.abs(run.tau).max(axis=0)
    assert peak == pytest.approx(np.abs(motion.found.tau).max(axis=0), rel=0.15)
    assert (np.abs(run.q_d - run.q).max(axis=0) < 0.25).all()


def test_the_seed_and_nothing_else_decides(tmp_path: Path) -> None:
    texts = []
    for k, seed in enumerate((3, 3, 4)):
        out = tmp_path / str(k)
        result = ctc('excite', '--evaluations', 5, '--seed', seed, '--out', out)
        assert result.returncode == 0, result.stderr
        texts.append((out / 'motion.yaml').read_text())
    assert texts[0] == texts[1] != texts[2]


def test_the_file_it_wrote_may_be_the_one_it_reads(tmp_path: Path) -> None:
    for file in ('friction', tmp_path / 'run.yaml'):
        result = ctc('excite', '--params-file', file, '--evaluations', 1, '--out', tmp_path,
                     '--overwrite')
        assert result.returncode == 0, result.stderr
    assert parameter_file.load(tmp_path / 'run.yaml').plant.duration == 60.0


def test_the_command_prints_and_writes_the_motion(tmp_path: Path) -> None:
    result = ctc('excite', '--params-file', 'panda', '--evaluations', 1, '--duration', 35,
                 '--poses', 2, '--out', tmp_path)
    assert result.returncode == 0, result.stderr
    for text in (*PANDA, '/87', 'no acceleration limit', 'nearest approach of two links is '):
        assert text in result.stdout
    assert max(map(len, result.stdout.splitlines()[:-1])) <= 100
    assert {x.name for x in tmp_path.iterdir()} == {LIST, 'motion.yaml', 'run.yaml'}
    setup = parameter_file.load(tmp_path / 'run.yaml')
    assert (setup.controller.law, setup.plant.duration, setup.events) == ('compensation', 35.0, ())
    before = parameter_file.load(ROOT / 'config' / 'panda.yaml')
    assert (np.array(setup.controller.kp) >= before.controller.kp).all()
    refused(ctc('excite', '--evaluations', 1, '--out', tmp_path),
            'motion.yaml', 'exists already')
    without = ctc('excite', '--evaluations', 1, '--out', tmp_path / 'plain')
    assert without.returncode == 0
    assert 'not checked for collisions of the robot with itself: there is no' in without.stdout


@pytest.mark.parametrize(('arguments', 'words'), [
    (['--duration', '20'], ['duration: 20.0', 'at least', 's']),
    (['--center', '0,-0.4,0,-0.1,0,1.8,0.5'], [
        'center of panda_joint4: -0.1', 'more than -2.922 and less than -0.2199']),
    (['--position-range', '1,2'], [
        'position_range: [1.0, 2.0]', 'one per joint (n = 7, got 2 values)']),
    (['--position-range', 'wide'], [
        "--position-range: 'wide'", 'numbers', 'one for all or one per joint']),
    (['--velocity-scale', '1.5'], ['velocity_scale: 1.5', '<= 1']),
    (['--friction', '-1'], ['friction', '>= 0']),
    (['--friction', '60'], ['peak torque of panda_joint', 'at most 12 N*m, its effort limit']),
    (['--evaluations', '0'], ['evaluations: 0', '>= 1']),
    (['--seed', '-1'], ['seed: -1', '>= 0']),
    (['--poses', '0'], ['poses: 0', '>= 1']),
    (['--params-file', 'nothing.yaml'], ['nothing.yaml'])])
def test_limits_that_no_motion_keeps_are_refused(
        arguments: list[str], words: list[str], tmp_path: Path) -> None:
    given = [] if '--evaluations' in arguments else ['--evaluations', '2']
    refused(ctc('excite', '--params-file', 'panda', *given, *arguments, cwd=tmp_path), *words)
    assert not list(tmp_path.rglob('*.yaml'))


@pytest.mark.slow
def test_the_duration_that_a_refusal_names_is_enough(tmp_path: Path) -> None:
    result = ctc('excite', '--params-file', 'panda', '--evaluations', '1', '--duration', '20',
                 '--velocity-scale', '0.2', '--out', tmp_path / 'short')
    found = re.search(r'at least (\d+) s', result.stderr)
    assert found
    for duration, status in ((int(found[1]), 0), (int(found[1]) - 2, 2)):
        assert ctc('excite', '--params-file', 'panda', '--evaluations', '1', '--velocity-scale',
                   '0.2', '--duration', duration, '--out', tmp_path / str(duration)
                   ).returncode == status


def test_a_motion_for_one_joint_moves_the_others_little(tmp_path: Path) -> None:
    setup = parameter_file.load(ROOT / 'config' / 'panda.yaml')
    found = excite(setup, {'duration': DURATION, 'evaluations': 3, 'seed': 1}, ('panda_joint7',))
    q, t = found.motion[0], STEP * np.arange(found.motion.shape[1])
    away = np.ptp(q[t > found.excitation.slow[-1][2] + 2.0], axis=0)
    assert (away[:6] < 0.5 * away[6]).all()
    begin, end, _ = found.excitation.slow[1]
    inside = (t > begin) & (t < end)
    assert (np.ptp(q[inside][:, :6], axis=0) < 1e-9).all()
    assert np.ptp(q[inside][:, 6]) > found.bounds.slow[6]
    refused(ctc('excite', '--params-file', 'panda', '--evaluations', 1, '--for', 'panda_joint8',
                cwd=tmp_path),
            'no joint is called panda_joint8', 'panda_joint7?')


def test_the_motion_of_the_reference_may_exceed_the_limits(tmp_path: Path) -> None:
    text = (ROOT / 'config' / 'panda.yaml').read_text()
    file = tmp_path / 'fast.yaml'
    file.write_text(re.sub(r'frequency: \[.*\]', f'frequency: [{", ".join(7 * ["9.0"])}]', text))
    refused(ctc('simulate', '--params-file', file), 'panda_joint1')
    result = ctc('excite', '--params-file', file, '--evaluations', 1, '--poses', 1,
                 '--duration', 30, '--out', tmp_path / 'out')
    assert result.returncode == 0, result.stderr


NAMES = ('first', 'second')
#: Two bars in a plane, and a wall that the ends of the second may reach.
LENGTH, WALL = 0.5, 0.75
ARM = urdf([
    link('base'), link('upper', 3.0, (0.25, 0.0, 0.0), (0.1, 0.1, 0.1)),
    link('lower', 1.0, (0.25, 0.0, 0.0), (0.05, 0.05, 0.05)).replace(
        '</link>', '<collision><origin xyz="0.5 0 0"/><geometry><sphere radius="0.05"/></geometry>'
        '</collision></link>'),
    link('wall').replace('/>', '><collision><origin xyz="1.25 0 0"/><geometry><box size="1 9 9"/>'
                         '</geometry></collision></link>'),
    joint('first', 'revolute', 'base', 'upper', '0 1 0'),
    joint('second', 'revolute', 'upper', 'lower', '0 1 0', f'{LENGTH} 0 0'),
    joint('fixed', 'fixed', 'base', 'wall', more='')])


class Bench:
    """The arm, with the search of its motions."""

    def __init__(self, center: tuple[float, float] = (0.8, 1.2), effort: float = np.inf) -> None:
        self.config = ExcitationConfig(NAMES, 50.0, center=center, start=center)
        self.center = np.array(center)
        self.bounds = bounds_of(self.config, read_limits(ARM, NAMES))
        self.model: Model = make_model('urdf', 9.81, NAMES, ARM)
        self.friction = AssumedFriction(np.ones(2), np.zeros(2))
        self.effort = np.full(2, effort)
        self.links = SelfCollision(ARM, NAMES, {}, np.array([center]), 0.05)

    def drawn(self, seed: int) -> Array:
        """Return a motion that may keep no limit."""
        return sampled(random_motion(self.config, self.bounds, np.ones(2), 1.0, seed))

    def first(self, count: int) -> Array:
        """Return position, velocity and acceleration of the motion, in steps of 1 ms."""
        return sampled(first_motion(
            self.config.changed({'evaluations': count}), self.bounds, np.ones(2), self.model,
            self.friction, self.effort, self.links)[0])


def sampled(found: Excitation) -> Array:
    return found.at(np.arange(0.0, 50.0, 0.001))


def to_the_wall(q: Array) -> Array:
    """Return the distance of the ball from the wall, (N,) [m]."""
    reach = LENGTH * np.cos(q[:, 0]) + LENGTH * np.cos(q.sum(axis=1))
    found: Array = WALL - reach - 0.05
    return found


def test_the_wall_and_the_bounds_are_kept_in_finer_steps() -> None:
    bench = Bench()
    assert min(to_the_wall(bench.drawn(seed)[0]).min() for seed in range(5)) < 0.05
    q, dq, ddq = bench.first(20)
    assert to_the_wall(q).min() >= 0.05
    for rows, most in ((q - bench.center, bench.bounds.room), (dq, bench.bounds.velocity),
                       (ddq, bench.bounds.acceleration)):
        assert (np.abs(rows).max(axis=0) <= most).all()


def test_a_torque_limit_is_kept_in_finer_steps() -> None:
    peaks = []
    for effort in (np.inf, 12.0):
        bench = Bench(effort=effort)
        points = bench.first(20)[:, ::10]
        peaks.append(np.abs(bench.friction.torques(bench.model, points)).max())
    assert peaks[1] <= 12.0 < peaks[0]


def test_an_impossible_motion_is_refused_with_the_limit_that_it_breaks() -> None:
    with pytest.raises(CtcError, match=r'peak torque of first: .* at most 5 N\*m'):
        Bench(effort=5.0).first(3)
    with pytest.raises(CtcError, match=r'they touch, lower and wall at .* at least 0\.0\d+ m'):
        Bench(center=(0.2, 1.2)).first(3)


def test_the_first_of_the_largest_motions_is_taken() -> None:
    """Of a count of one motion it is smaller than of many, and among these the first."""
    bench = Bench(center=(0.7, 1.2))
    kept = [to_the_wall(bench.drawn(seed)[0]).min() >= 0.05 for seed in range(10)]
    first = kept.index(True)
    assert first > 0
    assert bench.first(10) == pytest.approx(bench.drawn(first), abs=1e-9)
    alone, whole = bench.first(1)[1], bench.drawn(0)[1]
    assert np.abs(alone).max() < 0.8 * np.abs(whole).max()


def test_a_limit_that_leaves_no_motion_is_refused(tmp_path: Path) -> None:
    """Take a velocity limit above 0 for which no number of samples is enough."""
    (tmp_path / 'arm.urdf').write_text(two_links().replace('velocity="1.5"', 'velocity="1e-320"'))
    assert ctc('new-robot', '--urdf', 'arm.urdf', cwd=tmp_path).returncode == 0
    refused(ctc('excite', 'robot.yaml', '--evaluations', 1, cwd=tmp_path),
            'joint b: its velocity limit leaves no motion', 'at least 1e-09 is needed')

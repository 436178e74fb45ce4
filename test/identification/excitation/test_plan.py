"""Motions that excite a robot: what they keep, what they contain, and what is foretold."""

from __future__ import annotations

from functools import cache
from itertools import pairwise, product
from pathlib import Path
import re
from typing import Any, NamedTuple
import xml.etree.ElementTree as ET

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.parameter_file import Setup
from ctc_chattering.configuration.trajectory_file import read_trajectory, write_trajectory
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import ParameterError
from ctc_chattering.identification.excitation.forecast import AssumedFriction, gains, sticking
from ctc_chattering.identification.excitation.fourier_series import random_series
from ctc_chattering.identification.excitation.limits import bounds_of, ExcitationConfig
from ctc_chattering.identification.excitation.plan import Plan, plan, request_of, write
from ctc_chattering.identification.excitation.random_motion import PathBuilder
from ctc_chattering.simulation.closed_loop import Run, simulate
from ctc_chattering.simulation.registry import make_plant
from ctc_chattering.trajectory.joint_limits import DescribedLimits
from ctc_chattering.trajectory.reference import make_motion
from ctc_chattering.trajectory.waypoints import Route, Waypoints
from ctc_commands import ctc, refused
import numpy as np
import numpy.typing as npt
import pytest
from urdfs import joint, link, PANDA, panda, UR5, ur5, urdf

Array = npt.NDArray[np.float64]
ROOT = Path(__file__).parents[3]
ROBOTS = ('friction', 'panda', 'ur5')
#: Step of the finite differences [s].
STEP = 0.005


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
    return plan(setup, request_of(setup, {}), None, 5, 1)


@pytest.fixture(scope='module', params=ROBOTS)
def motion(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Motion:
    """Return the motion of a robot, written, read, and played from where the plant is."""
    return of(request.param, tmp_path_factory.mktemp(request.param))


def of(robot: str, out: Path) -> Motion:
    found = made(robot)
    write(found, parameter_file.read(ROOT / 'config' / f'{robot}.yaml'), out)
    setup = parameter_file.load(out / 'run.yaml')
    plant = setup.plant
    way = make_motion(setup.reference, setup.route, dict(zip(
        plant.joint_names, zip(plant.initial_position, plant.initial_velocity))))
    t = np.arange(0.0, 60.0 + STEP / 2.0, STEP)
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
    assert (np.abs(away).max(axis=0) > 0.6).all()
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
    assert motion.setup.plant.duration == 60.0
    assert motion.found.excitation.route.times[-1] == 60_000_000_000


def reversals(t: Array, dq: Array, begin: float, end: float) -> list[tuple[int, int]]:
    """Return index and direction of the changes of sign of one velocity, rest left out."""
    moving = np.flatnonzero((t > begin) & (t < end) & (np.abs(dq) > 1e-4))
    return [(int(b), int(np.sign(dq[b]))) for a, b in pairwise(moving) if dq[a] * dq[b] < 0.0]


def test_every_joint_reverses_slowly_both_ways_at_three_poses(motion: Motion) -> None:
    spans = motion.found.excitation.slow
    assert len(spans) == 3
    for i in range(motion.q.shape[1]):
        poses = []
        for begin, end in spans:
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


def torques(motion: Motion) -> tuple[Array, Array]:
    """Return M ddq + C dq, of the model's matrices, and the differences of the potential."""
    robot = model(motion.setup)
    inertial, gravity = np.zeros_like(motion.q), np.zeros_like(motion.q)
    for k, (q, dq, ddq) in enumerate(zip(motion.q, motion.dq, motion.ddq)):
        inertial[k] = (np.array(robot.mass_matrix(q)) @ ddq
                       + np.array(robot.coriolis_matrix(q, dq)) @ dq)
        for i, d in enumerate(1e-5 * np.eye(robot.n)):
            gravity[k, i] = (robot.potential_energy(q + d) - robot.potential_energy(q - d)) / 2e-5
    return inertial, gravity


def test_conditioning_and_peak_torque_are_those_of_the_motion(motion: Motion) -> None:
    """Check the eigenvalues of the normal equations, and torques of matrices and potential."""
    motion = motion._replace(**{name: getattr(motion, name)[::4]
                                for name in ('t', 'q', 'dq', 'ddq')})
    inertial, gravity = torques(motion)
    plant = motion.setup.plant
    friction = (np.array(plant.coulomb_friction) * np.sign(motion.dq)
                + np.array(plant.viscous_friction) * motion.dq)
    peak = np.abs(inertial + gravity + friction).max(axis=0)
    assert motion.found.motion.peak_torque == pytest.approx(peak, rel=0.01)
    for i, (raw, scaled) in enumerate(motion.found.conditions):
        a = np.column_stack([np.where(motion.dq[:, i] > 0.0, 1.0, -1.0), np.ones(len(motion.t)),
                             motion.dq[:, i], inertial[:, i], gravity[:, i]])
        moves = np.abs(motion.dq[:, i]) > 1e-9
        a = (a * np.column_stack([moves, *[np.ones(len(moves))] * 4]))
        a = a[:, np.abs(a).max(axis=0) > 1e-6]
        assert a.shape[1] == (5 if np.ptp(gravity[:, i]) > 1e-6 else 4)
        for columns, value in ((a, raw), (a / np.sqrt((a * a).sum(axis=0)), scaled)):
            values = np.linalg.eigvalsh(columns.T @ columns)
            assert value == pytest.approx(np.sqrt(values[-1] / values[0]), rel=0.02)
        assert scaled < 20.0


def run_of(motion: Motion) -> Run:
    setup = motion.setup
    text = setup.descriptions.get('plant', '')
    return simulate(setup.plant, setup.controller, setup.reference, route=setup.route,
                    robot=make_plant(setup.plant, text), model=model(setup))


def assert_identifiable(motion: Motion, run: Run) -> None:
    """Check that least squares of the run are conditioned as foretold, and find the friction."""
    robot, h = model(motion.setup), run.t[1]
    # Over ten samples, from the middle of which all but the acceleration is taken.
    middle = np.arange(5, len(run.t) - 5, 10)
    q, dq, ddq = run.q[middle], run.dq[middle], (
        run.dq[middle + 5] - run.dq[middle - 5]) / (10.0 * h)
    tau = np.array([run.tau[middle + k] for k in range(-5, 5)]).mean(axis=0)
    gravity = np.array([robot.gravity_torque(x) for x in q])
    inertial = np.array([robot.inverse_dynamics(*x) for x in zip(q, dq, ddq)]) - gravity
    for i, (_, scaled) in enumerate(motion.found.conditions):
        steady = np.ptp(np.sign([run.dq[middle + k, i] for k in range(-5, 6)]), axis=0) == 0
        a = np.column_stack([np.sign(dq[:, i]), np.ones(len(q)), dq[:, i], inertial[:, i],
                             gravity[:, i]])[steady & (dq[:, i] != 0.0)]
        a = a[:, np.abs(a).max(axis=0) > 1e-6]
        found = np.linalg.lstsq(a, tau[steady & (dq[:, i] != 0.0), i], rcond=None)[0]
        assert np.linalg.cond(a / np.linalg.norm(a, axis=0)) == pytest.approx(scaled, rel=0.2)
        assert found[0] == pytest.approx(motion.setup.plant.coulomb_friction[i], rel=0.01)
        assert found[2] == pytest.approx(motion.setup.plant.viscous_friction[i], rel=0.05,
                                         abs=0.05)


@pytest.mark.parametrize('robot', ['friction', pytest.param('panda', marks=pytest.mark.slow),
                                   pytest.param('ur5', marks=pytest.mark.slow)])
def test_the_robot_under_friction_reverses_where_the_motion_does(robot: str, tmp_path: Path
                                                                 ) -> None:
    """Check a run under law compensation: no joint sticks through the slow reversals."""
    motion = of(robot, tmp_path)
    run = run_of(motion)
    assert run.t[-1] == 60.0
    for i, slow in enumerate(motion.found.bounds.slow):
        for begin, end in motion.found.excitation.slow:
            # The first way may begin with the other sign: friction held the joint elsewhere.
            assert len(reversals(run.t, run.dq[:, i], begin, end)) >= 2
            inside = run.q[(run.t > begin) & (run.t < end), i]
            assert np.ptp(inside) > 1.3 * slow
    assert_identifiable(motion, run)
    peak = np.abs(run.tau).max(axis=0)
    assert peak == pytest.approx(motion.found.motion.peak_torque, rel=0.15)
    assert (np.abs(run.q_d - run.q).max(axis=0) < 0.25).all()


def test_the_seed_and_nothing_else_decides(tmp_path: Path) -> None:
    texts = []
    for k, seed in enumerate((3, 3, 4)):
        out = tmp_path / str(k)
        result = ctc('excite', '--draws', 2, '--seed', seed, '--out', out)
        assert result.returncode == 0, result.stderr
        texts.append((out / 'motion.yaml').read_text())
    assert texts[0] == texts[1] != texts[2]


def test_the_file_it_wrote_may_be_the_one_it_reads(tmp_path: Path) -> None:
    for file in ('friction', tmp_path / 'run.yaml'):
        result = ctc('excite', '--params-file', file, '--draws', 1, '--out', tmp_path,
                     '--overwrite')
        assert result.returncode == 0, result.stderr
    assert parameter_file.load(tmp_path / 'run.yaml').plant.duration == 60.0


def test_more_draws_are_not_worse() -> None:
    setup = parameter_file.load(ROOT / 'config' / 'ur5.yaml')
    worst = [plan(setup, request_of(setup, {}), None, draws, 0).conditions[:, 1].max()
             for draws in (1, 20)]
    assert worst[1] < worst[0]


def test_what_the_command_prints_and_writes(tmp_path: Path) -> None:
    result = ctc('excite', '--params-file', 'panda', '--draws', 1, '--duration', 80, '--poses', 4,
                 '--out', tmp_path)
    assert result.returncode == 0, result.stderr
    for text in (*PANDA, 'condition', 'at 4 poses', '87', 'no acceleration limit'):
        assert text in result.stdout
    assert {x.name for x in tmp_path.iterdir()} == {'motion.yaml', 'run.yaml'}
    setup = parameter_file.load(tmp_path / 'run.yaml')
    assert (setup.controller.law, setup.plant.duration, setup.events) == ('compensation', 80.0, ())
    before = parameter_file.load(ROOT / 'config' / 'panda.yaml')
    assert (np.array(setup.controller.kp) >= before.controller.kp).all()
    refused(ctc('excite', '--params-file', 'panda', '--draws', 1, '--out', tmp_path),
            'motion.yaml', 'exists already')
    without = ctc('excite', '--draws', 1)
    assert without.returncode == 0
    assert 'waypoints' not in without.stdout


@pytest.mark.parametrize(('arguments', 'words'), [
    (['--duration', '20'], ['duration: 20.0', 'at least', 's']),
    (['--center', '0,-0.4,0,-0.1,0,1.8,0.5'], [
        'center of panda_joint4: -0.1', 'more than -2.922 and less than -0.2199']),
    (['--velocity-limit', '2.5'], ['velocity_limit of panda_joint1: 2.5', '2.175']),
    (['--velocity-limit', '0'], ['velocity_limit: ', '>= 1e-09']),
    (['--acceleration-limit', 'nan'], ['acceleration_limit']),
    (['--position-range', '1,2'], ['position_range', 'n = 7, got 2']),
    (['--position-range', 'wide'], ["'wide'", 'a number, or 7 numbers']),
    (['--velocity-scale', '1.5'], ['velocity_scale: 1.5', '<= 1']),
    (['--friction', '-1'], ['friction', '>= 0']),
    (['--friction', '60'], ['peak torque of panda_joint', 'at most 12 N*m, its effort limit']),
    (['--draws', '0'], ['--draws', '>= 1']),
    (['--seed', '-1'], ['--seed', '>= 0']),
    (['--poses', '0'], ['poses: 0', '>= 1']),
    (['--params-file', 'nothing.yaml'], ['nothing.yaml'])])
def test_what_cannot_be_kept_is_refused(arguments: list[str], words: list[str]) -> None:
    given = [] if '--draws' in arguments else ['--draws', '2']
    refused(ctc('excite', '--params-file', 'panda', *given, *arguments), *words)


def test_the_duration_that_a_refusal_names_would_do() -> None:
    result = ctc('excite', '--params-file', 'panda', '--draws', '1', '--duration', '20',
                 '--velocity-scale', '0.2')
    found = re.search(r'at least (\d+) s', result.stderr)
    assert found
    for duration, status in ((int(found[1]), 0), (int(found[1]) - 2, 1)):
        assert ctc('excite', '--params-file', 'panda', '--draws', '1', '--velocity-scale', '0.2',
                   '--duration', duration).returncode == status


ARM = urdf([
    link('base'), link('a', 2.0, (0.2, 0.0, 0.0), (0.1, 0.1, 0.1)),
    link('b', 1.0, (0.1, 0.0, 0.0), (0.05, 0.05, 0.05)),
    joint('turn', 'revolute', 'base', 'a', '0 1 0', more=(
        '<limit lower="-1" upper="3" velocity="2" effort="30" acceleration="5"/>')),
    joint('slide', 'prismatic', 'a', 'b', '1 0 0', more=(
        '<limit lower="0" upper="0.2" velocity="0.1" effort="40"/>'))])


def test_bounds_of_a_description_with_acceleration_and_a_short_slide() -> None:
    limits = DescribedLimits(ARM, ('turn', 'slide')).joints
    config = ExcitationConfig(('turn', 'slide'), center=(1.0, 0.08), start=(0.0, 0.0))
    bounds = bounds_of(config, limits)
    assert bounds.room == pytest.approx([0.8, 0.07])
    assert bounds.velocity == pytest.approx([1.0, 0.05])
    assert bounds.acceleration == pytest.approx([2.5, 0.2])
    bounds = bounds_of(config.changed({
        'velocity_limit': [0.3, 0.1], 'acceleration_limit': [5.0, float('inf')]}), limits)
    assert bounds.velocity == pytest.approx([0.3, 0.1])
    assert bounds.acceleration == pytest.approx([5.0, 0.4])
    with pytest.raises(ParameterError, match=r'start of slide: 0\.3 is not allowed'):
        bounds_of(config.changed({'start': [0.0, 0.3]}), limits)


def test_a_series_is_at_rest_at_both_ends_and_the_derivative_of_itself() -> None:
    series = random_series(np.random.default_rng(0), 3, 8, 20.0)
    for rows in series.at(np.array([0.0, 20.0])):
        assert np.abs(rows).max() < 1e-9
    t = np.linspace(0.0, 20.0, 20001)
    q, dq, ddq = series.at(t)
    assert np.gradient(q, t, axis=0)[1:-1] == pytest.approx(dq[1:-1], abs=1e-4)
    assert np.gradient(dq, t, axis=0)[1:-1] == pytest.approx(ddq[1:-1], abs=1e-4)
    assert np.abs(q[:-1].mean(axis=0)).max() < 1e-9
    assert (np.abs(dq).max(axis=0) > 1.0).all()
    assert np.abs(series.scaled(np.array([2.0, 0.0, 1.0])).at(t)[0]
                  - q * [2.0, 0.0, 1.0]).max() < 1e-12


def test_between_waypoints_the_motion_is_the_series() -> None:
    series = random_series(np.random.default_rng(1), 2, 13, 27.0)
    series = series.scaled(1.0 / np.abs(series.at(np.linspace(0.0, 27.0, 500))[1]).max(axis=0))
    path = PathBuilder()
    path.rest(np.array([1.0, -1.0]), 3.0)
    path.series(np.array([1.0, -1.0]), series)
    played = Waypoints(path.times, path.points)
    t = np.linspace(3.0, 30.0, 5000)
    for rows, exact, most in zip(zip(*(played.at(round(x * 1e9)) for x in t)),
                                 series.at(t - 3.0), (1e-6, 1e-5, 2e-4)):
        offset = [1.0, -1.0] if most == 1e-6 else 0.0
        assert np.abs(np.array(rows) - offset - exact).max() < most


def test_what_friction_holds_is_found_at_a_corner_of_its_box() -> None:
    setup = parameter_file.load(ROOT / 'config' / 'ur5.yaml')
    robot, kp = model(setup), np.linspace(50.0, 100.0, 6)
    friction = AssumedFriction(np.array([8.0, 8.0, 6.0, 1.5, 1.5, 1.0]), np.zeros(6))
    q = np.array(setup.reference.center)
    mass = np.array(robot.mass_matrix(q.tolist()))
    corners = [np.abs(np.linalg.solve(mass, friction.coulomb * signs)) / kp
               for signs in product((-1.0, 1.0), repeat=6)]
    hold = sticking(robot, q[np.newaxis], kp, friction)
    assert hold == pytest.approx(np.max(corners, axis=0), rel=1e-9)


def test_gains_rise_only_where_friction_holds_too_much_and_with_the_delay() -> None:
    kp, kv, slow = np.array([100.0, 100.0, 100.0]), np.array([50.0, 50.0, 50.0]), np.full(3, 0.3)
    higher, damping = gains(kp, kv, np.array([0.01, 0.6, 60.0]), slow, 0.001)
    assert higher == pytest.approx([100.0, 1000.0, 2500.0])
    assert damping == pytest.approx([50.0, 64.0, 100.0])
    higher, damping = gains(kp, kv, np.array([0.01, 0.6, 60.0]), slow, 0.01)
    assert higher == pytest.approx([100.0, 100.0, 100.0])
    assert damping == pytest.approx(kv)


def test_a_slow_loop_is_warned_that_joints_stick(tmp_path: Path) -> None:
    file = tmp_path / 'slow.yaml'
    file.write_text((ROOT / 'config' / 'panda.yaml').read_text().replace(
        'control_period: 0.001', 'control_period: 0.01'))
    result = ctc('excite', '--params-file', file, '--draws', 1)
    assert result.returncode == 0, result.stderr
    assert 'panda_joint7 (1.3 of ±0.32 rad)' in result.stdout


def test_a_motion_that_shows_little_is_warned_of() -> None:
    result = ctc('excite', '--params-file', 'panda', '--draws', 1, '--position-range', 0.02)
    assert result.returncode == 0, result.stderr
    assert 'hardly separates friction and errors of the model on' in result.stdout


def test_waypoints_are_read_as_they_were_written(tmp_path: Path) -> None:
    route = Route(('b', 'a'), (100_000_001, 2_000_000_000), (
        ((1.0, -2.5e-7), (1e8, 0.0), (3.0, -4.0)), ((1.5, 2.0), (), ())))
    write_trajectory(route, tmp_path / 'way.yaml')
    read = read_trajectory(tmp_path / 'way.yaml', ('b', 'a'))
    assert read.times == route.times
    assert read.points == route.points
    turned = read_trajectory(tmp_path / 'way.yaml', ('a', 'b'))
    assert turned.points[0][0] == (-2.5e-7, 1.0)

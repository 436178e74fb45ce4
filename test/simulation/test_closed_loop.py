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

"""The closed loop: against scipy, the paper's numbers, and the theorem's bounds."""

from typing import Any

from ctc_chattering.analysis.terms import RunTerms, terms
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation.closed_loop import ClosedLoop, Event, Run, run_closed_loop
from ctc_chattering.simulation.plant import make_plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import reference_table, ReferenceConfig, Sinusoid
from learners import corrected_at_once, learning_setup
import numpy as np
from oracles import Array, paper_c, paper_field, paper_g, paper_m
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]


def _run(h: float = 1e-3, duration: float = 10.0, law: str = 'chattering',
         plant: dict[str, Any] | None = None, controller: dict[str, Any] | None = None,
         events: tuple[Event, ...] = ()) -> Run:
    return run_closed_loop(
        PlantConfig.from_mapping({'control_period': h, 'duration': duration, **(plant or {})}),
        ControllerConfig.from_mapping({'control_period': h, 'law': law, **(controller or {})}),
        ReferenceConfig(control_period=h), events)


def test_closed_loop_against_scipy() -> None:
    """Check 0.15 s of law (6) without friction: the law in numpy, the held plant in scipy."""
    h, count = 5e-3, 30
    run = _run(h, h * count, plant={'coulomb_friction': [0, 0], 'integration_step': 5e-4})
    x, xi = np.zeros(4), np.zeros(2)
    for k in range(count + 1):
        t = k * h
        q, dq = x[:2].tolist(), x[2:].tolist()
        sine = 0.5 * np.sin(2 * np.pi * t)
        q_d = np.array([np.pi, np.pi / 2]) + sine
        e, de = q_d - q, np.pi * np.cos(2 * np.pi * t) - dq
        feedback = 50 * de + 100 * e
        v = xi - de
        c, acceleration = paper_c(q, dq), feedback - (2 * np.pi) ** 2 * sine
        tau = paper_m(q) @ acceleration + c @ dq + paper_g(q) - c @ v - 10 * np.sign(v)
        np.testing.assert_allclose([*run.q[k], *run.dq[k]], x, atol=1e-6)
        np.testing.assert_allclose(run.v[k], v, atol=1e-6)
        np.testing.assert_allclose(run.tau[k], tau, rtol=1e-5, atol=1e-3)
        xi = np.exp(-10 * h) * xi + (1 - np.exp(-10 * h)) / 10 * (10 * de - feedback)
        x = solve_ivp(paper_field(tau), (0, h), x, rtol=1e-11, atol=1e-12).y[:, -1]


def test_grid_and_reference() -> None:
    """Check both ends of the time, the desired motion, and rest at the start."""
    run = _run(duration=0.25)
    assert run.t.tolist() == [k / 1000 for k in range(251)]
    for k in (0, 1, 100, 250):
        desired = Sinusoid(ReferenceConfig()).at(k * 1_000_000)
        assert [run.q_d[k].tolist(), run.dq_d[k].tolist(), run.ddq_d[k].tolist()] == [*desired]
    assert run.q[0].tolist() == run.dq[0].tolist() == [0.0, 0.0]
    assert run.q.shape == run.tau.shape == run.v.shape == (251, 2)


@pytest.mark.parametrize(('time', 'sample'), [
    (0.0, 0), (0.1, 100), (0.1001, 101), (0.0995, 100), (0.3, 300), (5.0, 1001)])
def test_events_act_at_the_first_sample_at_or_after(time: float, sample: int) -> None:
    """Check that the law switches at the right sample: tau differs there and not before."""
    steady = _run(duration=0.4)
    before = [Event(0.5 * time, 'controller', {'law': 'chattering'})] * (time > 0.0)
    run = _run(duration=0.4, events=(Event(time, 'controller', {'law': 'compensation'}), *before))
    same = (run.tau[:401] == steady.tau).all(axis=1)
    assert same[:sample].all()
    if sample <= 400:
        assert not same[sample]
        assert (run.q[:sample + 1] == steady.q[:sample + 1]).all()
        assert (run.v[:sample + 1] == steady.v[:sample + 1]).all()
        np.testing.assert_allclose(
            run.tau[sample] - steady.tau[sample], 10 * np.sign(run.v[sample]), atol=1e-9)


def test_joints_of_the_reference_in_another_order() -> None:
    """Check that names, not places, say which joint a desired motion is for."""
    swapped = ReferenceConfig(joint_names=('joint2', 'joint1'), center=(np.pi / 2, np.pi),
                              frequency=(2.0, 1.0))
    straight = ReferenceConfig(frequency=(1.0, 2.0))
    plant, law = PlantConfig(duration=0.2), ControllerConfig()
    a, b = run_closed_loop(plant, law, swapped), run_closed_loop(plant, law, straight)
    assert (a.q == b.q).all()
    assert (a.q_d == b.q_d).all()


def test_refuses_an_endless_run_and_tells_progress() -> None:
    """Check that a duration of 0 is an error, and that progress rises to the end."""
    with pytest.raises(CtcError, match='duration'):
        _run(duration=0.0)
    times: list[float] = []
    for compiled in (True, False):
        times.clear()
        run_closed_loop(PlantConfig(duration=0.5, compiled=compiled), ControllerConfig(),
                        ReferenceConfig(), (), times.append)
        assert times == sorted(times)
        assert (times[0], times[-1]) == (0.0, 0.5)
    assert 50 < len(times) < 200


FREE = {'coulomb_friction': [0, 0]}
SLOW = {'lambda': 0.1}  # so that the filter's own decay does not do the work


def _terms(run: Run) -> RunTerms:
    return terms(run, [(0.0, ControllerConfig(lambda_=0.1, control_period=float(run.t[1])))])


def _held_error(run: Run) -> Array:
    """
    Return for every period how far holding tau and the filter's bracket falsifies (7) [N·m].

    Within a period M (dv/dt + λ v) + C v + Ka sgn(v_k) = rho, where rho is the change since the
    sample of the smooth part of tau and of M times the bracket: at most that of the period.
    """
    parts = _terms(run)
    smooth = np.abs(np.diff(parts.nominal - parts.compensation, axis=0)).sum(axis=1)
    e, de = run.q_d - run.q, run.dq_d - run.dq
    bracket = np.abs(np.diff((0.1 - 50.0) * de - 100.0 * e, axis=0)).sum(axis=1)
    rho: Array = smooth + 9.97 * bracket
    return rho


def test_lyapunov_function_does_not_grow() -> None:
    """
    Check that V falls but for the sampling, and that what it rises by shrinks as h².

    From the held equation (7), dV/dt <= -λ vᵀMv - ka ‖v‖₁ + ‖v‖ rho + 2 ka |v_i| for joints whose
    v_i changed sign since the sample, where |v_i| is at most its own change over the period.
    """
    rises = []
    for h in (8e-4, 4e-4, 2e-4):
        run = _run(h, 2.5, plant=FREE, controller=SLOW)
        rise = np.diff(_terms(run).lyapunov)
        step = np.abs(np.diff(run.v, axis=0))
        size = np.maximum(np.linalg.norm(run.v[1:], axis=1), np.linalg.norm(run.v[:-1], axis=1))
        crossed = run.v[1:] * run.v[:-1] <= 0.0
        allowed = h * (size * _held_error(run) + 2 * 10.0 * (step * crossed).sum(axis=1))
        assert (rise <= allowed + 1e-12).all()
        rises.append(float(rise.max()))
        falling = run.t[1:] < 1.0
        assert (rise[falling] < 0.0).all()
    assert rises[0] > 2.5 * rises[1] > 2.5 ** 2 * rises[2]
    assert rises[2] < 8e-6


def _started(duration: float, reference: dict[str, Any], **plant: Any) -> Run:
    return run_closed_loop(PlantConfig(duration=duration, **plant), ControllerConfig(),
                           ReferenceConfig.from_mapping(reference))


def test_smooth_start_spares_the_drives() -> None:
    """Check the peak of the torque: about the motion's own, a twentieth of the paper's."""
    paper, smooth = (_started(4.0, {'start_duration': x}) for x in (0.0, 1.0))
    assert np.abs(paper.tau).max(axis=0) == pytest.approx([5022.4, 803.3], abs=0.1)
    needed = np.abs(paper.tau[2000:]).max(axis=0)
    assert (np.abs(smooth.tau).max(axis=0) < 1.25 * needed).all()
    assert np.abs(smooth.tau).max() < 300.0
    assert smooth.tau[0] == pytest.approx([0.0, 0.0], abs=1e-9)
    error = np.abs(smooth.q_d - smooth.q).max(axis=0)
    assert (error < [3e-4, 2e-3]).all()
    assert (smooth.q_d[1000:] == paper.q_d[1000:]).all()
    assert (smooth.ddq_d[1000:] == paper.ddq_d[1000:]).all()


def test_smooth_start_begins_at_the_measured_state() -> None:
    """Check that error, v and feedback are 0 at t = 0 with a moving robot and noisy sensors."""
    run = _started(0.1, {'start_duration': 2.0, 'joint_names': ['joint2', 'x', 'joint1'],
                         'center': [0.0, 5.0, 1.0]},
                   initial_position=(0.7, -0.4), initial_velocity=(0.3, -0.2),
                   position_noise=(1e-3, 1e-3), velocity_noise=(1e-3, 1e-3),
                   encoder_resolution=(1e-4, 1e-4))
    assert run.q_d[0].tolist() == run.q[0].tolist() != [0.7, -0.4]
    assert run.dq_d[0].tolist() == run.dq[0].tolist() != [0.3, -0.2]
    assert run.v[0].tolist() == run.ddq_d[0].tolist() == [0.0, 0.0]


def test_error_limit_ends_the_run() -> None:
    """Check joint, time and error of the message against a run without the limit."""
    start = {'initial_position': [np.pi, np.pi / 2], 'initial_velocity': [np.pi, np.pi]}
    free = _run(duration=1.0, law='compensation', plant=start)
    e = free.q_d - free.q
    for i, limit in ((0, [1e-3, np.inf]), (1, [np.inf, 0.02]), (1, [0.01, 0.02])):
        k = int(np.flatnonzero((np.abs(e) > limit).any(axis=1))[0])
        assert 5 < k < 900
        found = f'joint{i + 1} at t = {free.t[k]:g} s, {e[k, i]:.4g} rad, exceeds error_limit'
        with pytest.raises(CtcError, match=f'{found}, {limit[i]:g} rad'):
            _run(duration=1.0, law='compensation', plant=start, controller={'error_limit': limit})
        _run(duration=float(free.t[k - 1]), law='compensation', plant=start,
             controller={'error_limit': limit})
    wide = _run(duration=1.0, law='compensation', plant=start, controller={
        'error_limit': np.abs(e).max(axis=0).tolist()})
    assert (wide.tau == free.tau).all()


IMPERFECT: dict[str, Any] = {
    'sample_loss': 0.2, 'sample_jitter': 2e-4, 'late_samples': 0.1, 'input_delay': 2,
    'velocity_noise': [1e-3, 2e-3], 'noise_seed': 5}


def _imperfect_loop(table: Array | None = None) -> ClosedLoop:
    plant = PlantConfig.from_mapping({**IMPERFECT, 'duration': 0.4, 'compiled': False})
    law = ControllerConfig.from_mapping({
        'law': 'observer_feedback', 'input_delay': 2, 'compiled': False})
    if table is None:
        table = reference_table(ReferenceConfig(), None, (), law.joint_names, 1_000_000, 403)
    events = (Event(0.1, 'controller', {'law': 'compensation'}),
              Event(0.2, 'plant', {'coulomb_friction': [1.0, 1.0]}))
    return ClosedLoop(make_plant(plant), Controller(law), table, events=events)


def test_a_loop_in_segments_is_that_in_one() -> None:
    """Events, delay, lost and jittered samples are as before; only needed rows are read."""
    whole = _imperfect_loop()
    table = reference_table(ReferenceConfig(), None, (), ('joint1', 'joint2'), 1_000_000, 403)
    grown = np.full_like(table, np.nan)
    grown[0] = table[0]
    split = _imperfect_loop(grown)
    whole.advance(401)
    for until in (0, 1, 1, 2, 57, 100, 101, 200, 390, 401):
        grown[:until + 2] = table[:until + 2]
        split.advance(until)
        assert split.k == until
        for column, expected in zip(split.recorded, whole.recorded):
            np.testing.assert_array_equal(column, expected[:len(column)])
    assert 200 < len(split.recorded.stamps) == len(whole.recorded.stamps) < 400
    for name, x in vars(whole.run()).items():
        np.testing.assert_array_equal(getattr(split.run(), name), x)


def test_the_recorded_error_is_that_of_the_law() -> None:
    """Check law (6), whose error is that of the measured state, with lost samples."""
    plant = PlantConfig(duration=0.3, sample_loss=0.2)
    table = reference_table(ReferenceConfig(), None, (), ('joint1', 'joint2'), 1_000_000, 301)
    loop = ClosedLoop(make_plant(plant), Controller(ControllerConfig()), table)
    loop.advance(301)
    assert 200 < len(loop.recorded.stamps) < 300
    np.testing.assert_array_equal(loop.recorded.e, loop.run().e)


def test_a_learner_corrects_a_run_from_its_errors() -> None:
    """Half the speed, a delay and the joints in another order: the run is that of one table."""
    learner, plant, law, reference = learning_setup(compiled=False)
    run = run_closed_loop(plant, law, reference, learner=learner)
    at_once = corrected_at_once(plant, law, reference)
    desired = reference_table(reference, None, (), law.joint_names, 1_000_000, 503)
    for name, x in vars(at_once.run(desired)).items():
        np.testing.assert_array_equal(getattr(run, name), x)
    np.testing.assert_allclose(run.e, desired[:501, 0] - run.q, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(run.de, desired[:501, 1] - run.dq, rtol=1e-12, atol=1e-12)
    assert abs(run.e - at_once.recorded.e).max() > 1e-4  # The law's own error is another.
    samples = slice(None, None, law.state_decimation)
    path_times, q_d, e = map(np.array, zip(*learner.added))
    np.testing.assert_array_equal(path_times, np.rint(run.t[samples] * 1e9 / 2))
    np.testing.assert_array_equal(q_d, run.q_d[samples, ::-1])
    np.testing.assert_array_equal(e, at_once.recorded.e[samples, ::-1])


def test_a_learner_that_does_not_go_on_is_an_internal_error() -> None:
    learner, plant, law, reference = learning_setup(compiled=False)
    learner.horizon = 3_000_000
    with pytest.raises(RuntimeError, match='the learner does not know the motion at row 6'):
        run_closed_loop(plant, law, reference, learner=learner)

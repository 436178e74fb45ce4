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

"""The closed loop as machine code against plain Python: laws, imperfections, every end."""

from __future__ import annotations

import dataclasses
from math import inf
from typing import Any

from ctc_chattering.analysis.result import simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.control.controller import Controller
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation import closed_loop
from ctc_chattering.simulation.closed_loop import Event, MachineCodeLoop, Run
from ctc_chattering.simulation.plant import make_plant, Plant
from ctc_chattering.simulation.sensor import Measured
from ctc_chattering.trajectory.reference import reference_table
from ctc_chattering.trajectory.waypoints import Route
from learners import corrected_at_once, learning_setup
from machine_code import compile_runs
import numpy as np
import pytest

#: Some of what test_plant_step.py and test_compiled_step.py have by turns.
PLANT: dict[str, Any] = {
    'viscous_friction': [1.0, 0.5], 'stribeck_friction': [2.0, 1.0], 'load_friction': [0.03, 0.02],
    'disturbance.amplitude': [1.0, 2.0], 'disturbance.frequency': [3.0, 9.0],
    'velocity_noise': [1e-3, 2e-3], 'encoder_resolution': [1e-5, 1e-4], 'sample_loss': 0.1,
    'late_samples': 0.1, 'velocity_sensor': 'filtered', 'torque_rate_limit': [5e4, 1e4],
    'actuator_lag': [1e-3, 2e-3], 'input_delay': 1, 'integration_step': 4e-4}
CONTROLLER: dict[str, Any] = {
    'ka': [12.0, 11.0], 'inertia_scale': 1.1, 'gravity_scale': 0.9, 'effort_limit': [300.0, 60.0],
    'actuator_lag': [1e-3, 2e-3], 'torque_rate_limit': [5e4, 1e4], 'input_delay': 1}
START: dict[str, Any] = {'start_duration': 0.3}


class OwnTwoLink(TwoLink):
    """Somebody's model."""


def loaded(name: str = 'friction', **sections: dict[str, Any]) -> Setup:
    return parameter_file.load(find_config(name), sections)


def by_machine_code(setup: Setup) -> Run:
    compile_runs(setup)
    run = simulate(setup, truth=True).run
    assert run.compiled
    return run


def rms(run: Run) -> Array:
    error: Array = np.sqrt(np.mean((run.q_d - run.q) ** 2, axis=0))
    return error


def difference(setup: Setup) -> float:
    """Return the largest relative difference of the RMS errors; the reference agrees."""
    # Steps of the controller are machine code even in a loop that is not.
    right = simulate(dataclasses.replace(
        setup, plant=setup.plant.changed({'compiled': False}),
        controller=setup.controller.changed({'compiled': False})), truth=True).run
    found = by_machine_code(setup)
    assert not right.compiled
    np.testing.assert_array_equal(found.t, right.t)
    for name in ('q_d', 'dq_d', 'ddq_d'):
        np.testing.assert_allclose(
            getattr(found, name), getattr(right, name), rtol=1e-12, atol=1e-11)
    return float(np.abs(rms(found) / rms(right) - 1.0).max())


@pytest.mark.parametrize(('law', 'switching'), [
    ('compensation', 'sign'), ('chattering', 'sign'), ('chattering', 'implicit_observer'),
    ('observer_feedback', 'sign')])
def test_the_run_is_that_of_plain_python(law: str, switching: str) -> None:
    """Noise is that of the reference, so that even a run with noise is the same run."""
    named = {'law': law, 'switching': switching}
    assert difference(loaded(plant={'duration': 0.3}, controller=named)) < 1e-9
    # Where it rattles rounding grows.
    most = 0.1 if (law, switching) == ('chattering', 'sign') else 5e-3
    assert difference(loaded(plant={**PLANT, 'duration': 0.5}, reference=START, controller={
        **CONTROLLER, **named})) < most


@pytest.mark.slow  # Seven joints are compiled for it.
@pytest.mark.parametrize(('law', 'switching'), [
    ('chattering', 'implicit_observer'), ('compensation', 'sign'), ('observer_feedback', 'sign')])
def test_a_robot_of_a_description(law: str, switching: str) -> None:
    plant = {'duration': 0.5, 'payload': 1.5, 'velocity_noise': [1e-3] * 7, 'input_delay': 1}
    assert difference(loaded('panda', plant=plant, controller={
        'law': law, 'switching': switching, 'input_delay': 1})) < 1e-6


def test_waypoints() -> None:
    rest = ((0.0, 0.0), (0.0, 0.0))
    route = Route(('joint1', 'joint2'), (0, 400_000_000, 700_000_000), (
        ((3.0, 1.5), *rest), ((3.3, 1.2), *rest), ((3.1, 1.6), *rest)))
    setup = loaded(plant={'duration': 0.8}, reference=START)
    assert difference(dataclasses.replace(setup, route=route)) < 1e-9


def test_continuous_joints_that_start_in_another_turn() -> None:
    """The positions of both are those nearest to the reference."""
    shared: Any = {'/**': {'continuous_joints': ['joint2']}}
    setup = loaded(plant={'duration': 0.3, 'initial_position': [3.0, 1.5 - 6.0 * np.pi]},
                   controller={'law': 'compensation'}, **shared)
    assert difference(setup) < 1e-9
    for truth in (False, True):
        run = simulate(setup, truth=truth).run
        assert run.compiled
        assert run.q[0] == pytest.approx([3.0, 1.5])
        assert np.abs(run.e).max() < 0.5


@pytest.mark.parametrize(('speed', 'controller', 'words'), [
    (0.0, {'error_limit': [2.5, 3.0]}, 'exceeds error_limit, 2.5 rad'),
    (1e200, {}, 'the law has no finite torque at t = 0 s for [0.1, 0.2], [1e+200, 1e+200]'),
    (1e120, {}, 'diverged at t = 0 s, under a torque of [')])
def test_a_run_that_does_not_end(speed: float, controller: dict[str, Any], words: str) -> None:
    """Both say why and when; the torque of a motion that diverges is rounded otherwise."""
    setup = loaded(plant={'duration': 2.0, 'torque_saturation': [inf, inf]}, controller=controller)
    compile_runs(setup)
    texts = []
    for compiled in (False, True):
        config = setup.plant.changed({'compiled': compiled})
        robot, q, dq = Plant(config, TwoLink()), np.array((0.1, 0.2)), np.full(2, speed)
        robot._begin(config, robot.state._replace(
            motion=robot.state.motion._replace(q=q, dq=dq), shown=Measured(q, dq)),
            np.zeros((1, 2)))
        with pytest.raises(CtcError) as error:
            closed_loop.run_closed_loop(config, setup.controller, setup.reference, robot=robot)
        texts.append(str(error.value))
    assert words in texts[0]
    if 'diverged' in words:
        texts = [text.partition('[')[0] for text in texts]
    assert texts[0] == texts[1]


def test_what_is_plain_python() -> None:
    """Elastic joints, other models, events, and what is asked for; the run itself says so."""
    setup = loaded(plant={'duration': 0.02})
    compile_runs(setup)

    def compiled(events: tuple[Event, ...] = (), plant: dict[str, Any] | None = None,
                 controller: dict[str, Any] | None = None, **more: Any) -> bool:
        return closed_loop.run_closed_loop(
            setup.plant.changed(plant or {}), setup.controller.changed(controller or {}),
            setup.reference, events, **more).compiled

    assert compiled() and compiled(model=TwoLink())
    assert not compiled(plant={'joint_stiffness': [1e4] * 2, 'motor_inertia': [1.0] * 2})
    assert not compiled(plant={'compiled': False})
    assert not compiled(controller={'compiled': False})
    assert not compiled(model=OwnTwoLink())
    assert not compiled(robot=Plant(setup.plant, OwnTwoLink()))
    assert not compiled((Event(0.01, 'controller', {'kp': [120.0, 120.0]}),))


def test_the_gravity_is_that_of_the_model() -> None:
    """Not that of the configuration."""
    setup = loaded(plant={'duration': 0.1})
    compile_runs(setup)
    plants = [setup.plant.changed({'compiled': compiled}) for compiled in (False, True)]
    runs = [closed_loop.run_closed_loop(
        plant, setup.controller, setup.reference, robot=Plant(plant, TwoLink(3.0)),
        model=TwoLink(9.81)) for plant in plants]
    assert [run.compiled for run in runs] == [False, True]
    np.testing.assert_allclose(runs[1].q, runs[0].q, rtol=1e-9, atol=1e-9)


def machine_code_loop(setup: Setup, table: Array) -> MachineCodeLoop:
    robot, law = make_plant(setup.plant), Controller(setup.controller)
    loop = closed_loop.compiled_loop_of(robot, law)
    assert loop is not None and loop.compiled
    return MachineCodeLoop(loop, robot, law, table, truth=True)


@pytest.mark.parametrize('law', ['chattering', 'observer_feedback'])
def test_a_loop_in_segments_is_that_in_one(law: str) -> None:
    """To the last bit, with lost, jittered and late samples; only needed rows are read."""
    setup = loaded(plant={**PLANT, 'sample_jitter': 2e-4, 'duration': 0.5},
                   controller={**CONTROLLER, 'law': law})
    compile_runs(setup)
    table = reference_table(setup.reference, None, (), ('joint1', 'joint2'), 1_000_000, 502)
    whole = machine_code_loop(setup, table)
    whole.advance(501)
    grown = np.full_like(table, np.nan)
    grown[0] = table[0]
    split = machine_code_loop(setup, grown)
    for until in (0, 1, 1, 2, *range(57, 80), 200, 490, 501):
        grown[:until + 1] = table[:until + 1]
        split.advance(until)
        assert split.k == until
        for column, expected in zip(split.recorded, whole.recorded):
            np.testing.assert_array_equal(column, expected[:len(column)])
    assert 400 < len(split.recorded.stamps) == len(whole.recorded.stamps) < 500
    for name, x in vars(simulate(setup, truth=True).run).items():
        np.testing.assert_array_equal(getattr(split.run(), name), x)


def test_a_learner_corrects_a_run_from_its_errors() -> None:
    learner, plant, controller, reference = learning_setup(compiled=True)
    compile_runs(Setup(plant, controller, reference))
    run = closed_loop.run_closed_loop(plant, controller, reference, learner=learner)
    assert run.compiled
    _, plain_plant, plain_controller, _ = learning_setup(compiled=False)
    expected = corrected_at_once(plain_plant, plain_controller, reference)
    samples = slice(None, None, controller.state_decimation)
    path_times, q_d, e = map(np.array, zip(*learner.added))
    np.testing.assert_array_equal(path_times, np.rint(run.t[samples] * 1e9 / 2))
    np.testing.assert_array_equal(q_d, run.q_d[samples, ::-1])
    np.testing.assert_allclose(e, expected.recorded.e[samples, ::-1], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(run.q, expected.run().q, rtol=1e-9, atol=1e-9)

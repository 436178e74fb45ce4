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

"""The closed loop as machine code against plain Python: random parameters, laws, every end."""

from __future__ import annotations

import dataclasses
from math import inf
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.result import simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation import closed_loop
from ctc_chattering.simulation.closed_loop import Event, Run
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.sensor import Measured
from ctc_chattering.trajectory.motions import Route
from machine_code import compile_runs
import numpy as np
import pytest

#: Largest relative difference of RMS errors: where the motion is regular, and where it rattles.
REGULAR, RATTLING = 5e-3, 0.1


class OwnTwoLink(TwoLink):
    """Somebody's model."""


def file(name: str) -> Path:
    return config_directory() / f'{name}.yaml'


def random_setup(name: str, seed: int, law: str, switching: str, duration: float) -> Setup:
    """Return a parameter file with random friction, imperfections and gains."""
    rng = np.random.default_rng(seed)
    base = parameter_file.load(file(name))
    kf, n = np.array(base.plant.coulomb_friction), len(base.plant.joint_names)

    def each(low: float, high: float) -> list[float]:
        return [float(x) for x in rng.uniform(low, high, n)]

    def some(values: dict[str, Any]) -> dict[str, Any]:
        return {key: x for key, x in values.items() if rng.random() < 0.3}

    plant = some({
        'coulomb_friction': (kf * each(0.0, 1.5)).tolist(), 'viscous_friction': each(0.0, 2.0),
        'stribeck_friction': (kf * each(0.0, 0.4)).tolist(), 'load_friction': each(0.0, 0.05),
        'friction_asymmetry': each(-0.4, 0.4), 'disturbance.amplitude': each(0.0, 2.0),
        'disturbance.frequency': each(0.0, 20.0), 'disturbance.push': each(-5.0, 5.0),
        'position_noise': each(0.0, 1e-4), 'velocity_noise': each(0.0, 5e-3),
        'encoder_resolution': each(0.0, 1e-4), 'velocity_sensor': 'filtered',
        'sample_loss': 0.1, 'late_samples': 0.1, 'torque_resolution': each(0.0, 0.1),
        'torque_rate_limit': (5e3 * kf).tolist(), 'actuator_lag': each(0.0, 3e-3),
        'input_delay': int(rng.integers(1, 3)), 'integration_step': 4e-4})
    if plant.get('velocity_sensor') and rng.random() < 0.5:
        plant['velocity_sensor'] = 'difference'
    controller = some({
        'kp': each(50.0, 400.0), 'kv': each(20.0, 60.0), 'ka': (kf * each(0.5, 2.0)).tolist(),
        'lambda': rng.uniform(5.0, 40.0), 'b': rng.uniform(0.5, 2.0),
        'observer_bandwidth': rng.uniform(100.0, 2000.0), 'boundary_layer': 0.2,
        'effort_limit': (40.0 * kf).tolist(), 'effort_rate_limit': (1e3 * kf).tolist(),
        'anti_windup': False, 'inertia_scale': rng.uniform(0.8, 1.2),
        'gravity_scale': rng.uniform(0.8, 1.2), 'friction_level': kf.tolist(),
        'actuator_lag': plant.get('actuator_lag', each(0.0, 2e-3)),
        'torque_rate_limit': (5e3 * kf).tolist(), 'input_delay': plant.get('input_delay', 0)})
    return parameter_file.load(file(name), {
        '/**': {'control_period': float(rng.choice([5e-4, 1e-3, 2e-3]))},
        'plant': {**plant, 'duration': duration, 'noise_seed': seed},
        'controller': {**controller, 'law': law, 'switching': switching},
        'reference': some({'start_duration': 0.7})})


def rms(run: Run) -> Array:
    error: Array = np.sqrt(np.mean((run.q_d - run.q) ** 2, axis=0))
    return error


def by_python(setup: Setup, truth: bool = False) -> Run:
    """Return the run of plain Python."""
    run = simulate(dataclasses.replace(
        setup, plant=setup.plant.changed({'compiled': False})), truth=truth).run
    assert not run.compiled
    return run


def by_machine_code(setup: Setup, truth: bool = False) -> Run:
    """Return the run of machine code."""
    compile_runs(setup)
    run = simulate(setup, truth=truth).run
    assert run.compiled
    return run


def compared(setup: Setup, truth: bool) -> float:
    """Return the largest relative difference of the RMS errors; all else agrees."""
    # The controller too, whose steps are machine code even in a loop that is not.
    right = by_python(dataclasses.replace(
        setup, controller=setup.controller.changed({'compiled': False})), truth)
    found = by_machine_code(setup, truth)
    np.testing.assert_array_equal(found.t, right.t)
    for name in ('q_d', 'dq_d', 'ddq_d'):
        np.testing.assert_allclose(
            getattr(found, name), getattr(right, name), rtol=1e-12, atol=1e-11)
    return float(np.abs(rms(found) / rms(right) - 1.0).max())


#: Every law is compared step by step in test_control_step.py; here with the plant.
VARIANTS = [('compensation', 'sign'), ('chattering', 'sign'), ('chattering', 'implicit_observer'),
            ('observer_feedback', 'sign')]


@pytest.mark.parametrize(('law', 'switching'), VARIANTS)
def test_random_parameters(law: str, switching: str) -> None:
    """Noise is that of the reference, so that even a run with noise is the same run."""
    differences = []
    for seed in range(4):
        setup = random_setup('friction', 100 * VARIANTS.index((law, switching)) + seed, law,
                             switching, 0.6)
        differences.append(compared(setup, truth=seed % 2 == 0))
    assert max(differences) < (RATTLING if switching == 'sign' and law == 'chattering'
                               else REGULAR)
    assert min(differences) < 1e-9


@pytest.mark.slow  # Seven joints are compiled for it.
@pytest.mark.parametrize(('law', 'switching'), [
    ('chattering', 'implicit_observer'), ('compensation', 'sign'), ('observer_feedback', 'sign')])
def test_a_robot_of_a_description(law: str, switching: str) -> None:
    setup = parameter_file.load(file('panda'), {
        'plant': {'duration': 0.5, 'payload': 1.5, 'velocity_noise': [1e-3] * 7,
                  'input_delay': 1},
        'controller': {'law': law, 'switching': switching, 'input_delay': 1}})
    assert compared(setup, truth=True) < 1e-6


@pytest.mark.slow
def test_the_payload_moves_the_plant_only() -> None:
    """The check above would pass if both arms carried it."""
    errors = []
    for payload in (0.0, 1.5):
        setup = parameter_file.load(file('panda'), {
            'plant': {'duration': 0.3, 'payload': payload}, 'controller': {'law': 'pd_gravity'}})
        errors.append(rms(by_machine_code(setup)))
    assert (np.abs(errors[1] / errors[0] - 1.0) > 0.05).any()


def test_waypoints() -> None:
    rest = ((0.0, 0.0), (0.0, 0.0))
    route = Route(('joint1', 'joint2'), (0, 400_000_000, 700_000_000), (
        ((3.0, 1.5), *rest), ((3.3, 1.2), *rest), ((3.1, 1.6), *rest)))
    for start in (0.0, 0.3):
        setup = dataclasses.replace(
            parameter_file.load(file('friction'), {'plant': {'duration': 0.8},
                                                   'reference': {'start_duration': start}}),
            route=route)
        assert compared(setup, truth=True) < 1e-9


def test_the_same_seed_is_the_same_run_and_another_is_another() -> None:
    def noisy(seed: int) -> Run:
        return by_machine_code(parameter_file.load(file('friction'), {'plant': {
            'duration': 0.2, 'velocity_noise': [1e-3, 1e-3], 'noise_seed': seed}}))
    np.testing.assert_array_equal(noisy(4).tau, noisy(4).tau)
    assert (noisy(4).tau != noisy(5).tau).any()


def ends_of(setup: Setup, speed: float) -> list[str]:
    """Return how plain Python and machine code say that a run ended, from this speed [rad/s]."""
    compile_runs(setup)
    said = []
    for compiled in (False, True):
        config = setup.plant.changed({'compiled': compiled})
        robot, q, dq = Plant(config, TwoLink()), np.array((0.1, 0.2)), np.full(2, speed)
        robot._begin(config, robot.state._replace(
            motion=robot.state.motion._replace(q=q, dq=dq), shown=Measured(q, dq)),
            np.zeros((1, 2)))
        with pytest.raises(CtcError) as error:
            closed_loop.simulate(config, setup.controller, setup.reference, robot=robot)
        said.append(str(error.value))
    return said


@pytest.mark.parametrize(('speed', 'controller', 'words'), [
    (0.0, {'error_limit': [2.5, 3.0]}, 'exceeds error_limit, 2.5 rad'),
    (1e200, {}, 'no torque can be computed at t = 0 s for [0.1, 0.2], [1e+200, 1e+200]'),
    (1e120, {}, 'diverged at t = 0 s, under a torque of [')])
def test_a_run_that_does_not_end(speed: float, controller: dict[str, Any], words: str) -> None:
    """Both say why and when; the torque of a motion that diverges is rounded otherwise."""
    plain, compiled = ends_of(parameter_file.load(file('friction'), {
        'plant': {'duration': 2.0, 'torque_saturation': [inf, inf]},
        'controller': controller}), speed)
    assert words in plain
    if 'diverged' in words:
        plain, compiled = (text.partition('[')[0] for text in (plain, compiled))
    assert compiled == plain


@pytest.mark.parametrize('changes', [
    {'plant': {'joint_stiffness': [1e4] * 2, 'motor_inertia': [1.0] * 2}},
    {'plant': {'compiled': False}}, {'controller': {'compiled': False}}])
def test_parameters_that_are_plain_python(changes: dict[str, Any]) -> None:
    """The run itself says so; without the change it is machine code."""
    for values in ({}, changes):
        setup = parameter_file.load(file('friction'), {
            **values, 'plant': {'duration': 0.02, **values.get('plant', {})}})
        compile_runs(setup)
        assert simulate(setup).run.compiled == (not values)


def test_models_and_changes_that_are_plain_python() -> None:
    setup = parameter_file.load(file('friction'), {'plant': {'duration': 0.02}})
    compile_runs(setup)
    parts = setup.plant, setup.controller, setup.reference
    assert closed_loop.simulate(*parts, model=TwoLink()).compiled
    assert not closed_loop.simulate(*parts, model=OwnTwoLink()).compiled
    assert not closed_loop.simulate(*parts, robot=Plant(setup.plant, OwnTwoLink())).compiled
    event = Event(0.01, 'controller', {'kp': [120.0, 120.0]})
    assert not closed_loop.simulate(*parts, [event]).compiled


def test_the_gravity_is_that_of_the_model() -> None:
    """Not that of the configuration."""
    setup = parameter_file.load(file('friction'), {'plant': {'duration': 0.1}})
    compile_runs(setup)
    plants = [setup.plant.changed({'compiled': compiled}) for compiled in (False, True)]
    runs = [closed_loop.simulate(
        plant, setup.controller, setup.reference, robot=Plant(plant, TwoLink(3.0)),
        model=TwoLink(9.81)) for plant in plants]
    assert [run.compiled for run in runs] == [False, True]
    np.testing.assert_allclose(runs[1].q, runs[0].q, rtol=1e-9, atol=1e-9)

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

"""Imperfections of the simulated drives: delay, saturation, viscous and Stribeck friction."""

from collections.abc import Callable
from math import inf
from typing import Any

from ctc_chattering.errors import ParameterError
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
from oracles import Array, Masses
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]

SLIDERS = [[2.0, 0.0], [0.0, 0.5]]  # two joints that know nothing of each other
COUPLED = [[2.0, 1.0], [1.0, 2.0]]
STRIBECK: dict[str, Any] = {
    'coulomb_friction': [1.5, 0.4], 'stribeck_friction': [1.0, 0.3],
    'stribeck_velocity': [0.2, 0.5], 'viscous_friction': [0.7, 0.2]}


def _plant(masses: list[list[float]] | None = None, **values: Any) -> Plant:
    return Plant(PlantConfig.from_mapping(values), Masses(masses) if masses else None)


def _state(plant: Plant) -> list[float]:
    return [*plant.q, *plant.dq]


def _energy(plant: Plant) -> float:
    dq, mass = np.array(plant.dq), np.array(plant.model.mass_matrix(plant.q))
    return float(0.5 * dq @ mass @ dq) + plant.model.potential_energy(plant.q)


def _torques(count: int, seed: int = 0) -> list[list[float]]:
    rows: list[list[float]] = (
        np.random.default_rng(seed).normal(size=(count, 2)) * [80.0, 25.0]).tolist()
    return rows


@pytest.mark.parametrize('d', [1, 2, 7])
def test_a_torque_arrives_exactly_d_samples_later(d: int) -> None:
    """Check the state bit for bit against a plant without delay fed d zeros first."""
    late, prompt, torques = _plant(input_delay=d), _plant(), _torques(60)
    for sent, due in zip(torques, [[0.0, 0.0]] * d + torques):
        late.step(sent)
        prompt.step(due)
        assert list(late.applied) == due
        assert _state(late) == _state(prompt)
    one_off = _plant(input_delay=d - 1)
    for sent in torques:
        one_off.step(sent)
    assert _state(one_off) != _state(late)


ASYMMETRIC: dict[str, Any] = {'coulomb_friction': [2.0, 1.0], 'friction_asymmetry': [0.3, -0.5]}
LOADED: dict[str, Any] = {'coulomb_friction': [2.0, 0.0], 'load_friction': [0.2, 0.0]}


@pytest.mark.parametrize(('friction', 'joint', 'level'), [
    (STRIBECK, 0, 2.5), (STRIBECK, 1, -0.7), (ASYMMETRIC, 0, 2.6), (ASYMMETRIC, 0, -1.4),
    (ASYMMETRIC, 1, 0.5), (LOADED, 0, 2.5), (LOADED, 0, -2.5)])
def test_break_away(friction: dict[str, Any], joint: int, level: float) -> None:
    """Check rest, bit-exact, up to Kf + Ks, Kf (1 ± a) and Kf / (1 - μ), and motion just above."""
    plant, load = _plant(SLIDERS, **friction), [0.0, 0.0]
    for share in (0.5, 0.99, 1.0 - 1e-12):
        load[joint] = share * level
        for _ in range(20):
            plant.step(load)
            assert _state(plant) == [0.0] * 4
    load[joint] = 1.001 * level
    plant.step(load)
    assert plant.dq[joint] * level > 0.0


@pytest.mark.parametrize(('friction', 'torque', 'moves'), [
    (ASYMMETRIC, 3.6, 1.0), (ASYMMETRIC, -2.4, -1.0), (LOADED, 8.0, 4.4), (LOADED, -5.0, -2.0)])
def test_sliding_by_direction_and_load(friction: dict[str, Any], torque: float, moves: float
                                       ) -> None:
    """Check the torque that is left, |τ| - Kf (1 ± a) or |τ| (1 - μ) - Kf, on a mass of 2 kg."""
    plant = _plant(SLIDERS, **friction)
    for k in range(1, 4):
        plant.step([torque, 0.0])
        assert plant.dq[0] == pytest.approx(k * 1e-3 * moves / 2.0, rel=1e-9)


def _rub(joint: int, tau: float) -> Callable[[float, Array], Array]:
    """Return x' of one slider that slides forwards under the formula of STRIBECK."""
    kf, ks, speed, c = (STRIBECK[name][joint] for name in (
        'coulomb_friction', 'stribeck_friction', 'stribeck_velocity', 'viscous_friction'))

    def field(t: float, x: Array) -> Array:
        del t
        friction = kf + ks * np.exp(-(x[1] / speed) ** 2) + c * x[1]
        return np.array([x[1], (tau - friction) / SLIDERS[joint][joint]])
    return field


@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_sliding_against_scipy(direction: float) -> None:
    """Check Kf + Ks exp(-(dq / vs)²) + c dq through the fall and rise of the friction."""
    start, tau = np.array([0.05, 0.02]), np.array([3.0, 1.5])
    plant = _plant(SLIDERS, **STRIBECK, initial_velocity=(direction * start).tolist())
    for _ in range(1000):
        plant.step((direction * tau).tolist())
    for joint in (0, 1):
        exact = solve_ivp(_rub(joint, tau[joint]), (0, 1), [0.0, start[joint]], method='DOP853',
                          rtol=1e-12, atol=1e-13).y[:, -1]
        assert direction * plant.q[joint] == pytest.approx(exact[0], abs=1e-9)
        assert direction * plant.dq[joint] == pytest.approx(exact[1], abs=1e-9)
        assert exact[1] > 1.5 * STRIBECK['stribeck_velocity'][joint]


def test_energy_is_always_dissipated() -> None:
    """Check that the arm, let go, loses energy at every step while it moves, down to rest."""
    plant = _plant(initial_position=[1.0, 0.5], initial_velocity=[1.0, -2.0], **STRIBECK)
    last = first = _energy(plant)
    for _ in range(2000):
        before = plant.q
        plant.step([0.0, 0.0])
        now = _energy(plant)
        assert now <= last + 1e-9
        assert now < last or np.abs(np.subtract(plant.q, before)).max() < 1e-6
        last = now
    assert first - last > 5.0


def test_stuck_beside_a_joint_that_slides_at_its_final_speed() -> None:
    """
    Check that what a sliding joint's viscous friction holds does not load the stuck one.

    At dq1 = (tau - Kf) / c joint 1 does not accelerate, so that joint 2 feels nothing; without
    the viscous part of the friction it would feel M21 (tau - Kf) / M11 = 5 > Kf.
    """
    plant = _plant(COUPLED, coulomb_friction=[1.0, 3.0], viscous_friction=[10.0, 0.0],
                   initial_velocity=[1.0, 0.0])
    for _ in range(100):
        plant.step([11.0, 0.0])
        assert plant.modes == (1, 0)
        assert (plant.q[1], plant.dq[1]) == (0.0, 0.0)
    assert plant.dq[0] == pytest.approx(1.0)
    fast = _plant(COUPLED, coulomb_friction=[1.0, 3.0], initial_velocity=[1.0, 0.0])
    fast.step([11.0, 0.0])
    assert fast.dq[1] < 0.0


EVERYTHING: dict[str, Any] = {
    **STRIBECK, 'load_friction': [0.05, 0.02], 'friction_asymmetry': [0.1, -0.2],
    'actuator_lag': [2e-3, 1e-3], 'torque_rate_limit': [5e4, 1e4], 'torque_resolution': [0.1, 0.1],
    'torque_saturation': [90.0, 30.0], 'input_delay': 1, 'late_samples': 0.1, 'sample_loss': 0.1,
    'velocity_sensor': 'filtered', 'encoder_resolution': [1e-5, 1e-5],
    'velocity_noise': [1e-3, 1e-3], 'disturbance.amplitude': [1.0, 1.0],
    'disturbance.frequency': [3.0, 4.0]}


def test_every_imperfection_at_once_hardly_depends_on_the_step() -> None:
    """Check 0.3 s of the arm, steps of 1 ms against 0.02 ms."""
    values = {**EVERYTHING, 'load_friction': [0.05, 0.02]}
    coarse, fine = _plant(**values), _plant(**values, integration_step=2e-5)
    for torque in _torques(300, 6):
        coarse.step(torque)
        fine.step(torque)
    assert np.abs(np.subtract(_state(coarse), _state(fine))).max() < 1e-5


@pytest.mark.parametrize(('name', 'value'), [
    ('load_friction', [-0.1, 0.0]), ('load_friction', [1.0, 0.0]),
    ('actuator_lag', [-1e-3, 0.0]), ('actuator_lag', [inf, 0.0]),
    ('torque_rate_limit', [0.0, 1.0]), ('torque_resolution', [-0.1, 0.0]),
    ('joint_damping', [0.0, 1.0]), ('encoder_side', 'gear'), ('motor_inertia', [0.1, 0.1]),
    ('joint_stiffness', [0.0, 1e3]),
    ('friction_asymmetry', [1.1, 0.0]), ('sample_loss', 0.6), ('late_samples', 1.1),
    ('velocity_sensor', 'none'), ('velocity_cutoff', 0.0),
    ('input_delay', -1), ('input_delay', 101), ('input_delay', 1.0),
    ('torque_saturation', [0.0, 1.0]), ('viscous_friction', [-1.0, 0.0]),
    ('stribeck_velocity', [0.0, 1.0]), ('velocity_noise', [-1e-3, 0.0]), ('noise_seed', -1)])
def test_refusals(name: str, value: object) -> None:
    """Check what none of them can be, and a spring without a motor."""
    with pytest.raises(ParameterError, match=name):
        PlantConfig.from_mapping({name: value})
    for motors in ([0.0, 0.0], [0.1, 0.0]):
        with pytest.raises(ParameterError, match='motor_inertia'):
            PlantConfig.from_mapping({'joint_stiffness': [1e3, 1e3], 'motor_inertia': motors})

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
from typing import Any

from ctc_chattering.errors import ParameterError
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
from oracles import Array, kinetic_energy, Masses, paper_field, paper_m
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]

SLIDERS = [[2.0, 0.0], [0.0, 0.5]]  # two joints that know nothing of each other
COUPLED = [[2.0, 1.0], [1.0, 2.0]]
FREE: dict[str, Any] = {'coulomb_friction': [0.0, 0.0]}
STRIBECK: dict[str, Any] = {
    'coulomb_friction': [1.5, 0.4], 'stribeck_friction': [1.0, 0.3],
    'stribeck_velocity': [0.2, 0.5], 'viscous_friction': [0.7, 0.2]}


def _plant(masses: list[list[float]] | None = None, **values: Any) -> Plant:
    return Plant(PlantConfig.from_mapping(values), Masses(masses) if masses else None)


def _state(plant: Plant) -> list[float]:
    return [*plant.q, *plant.dq]


def _energy(plant: Plant) -> float:
    return (kinetic_energy(plant.model, plant.q, plant.dq)
            + plant.model.potential_energy(plant.q))


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


def test_delayed_and_saturated() -> None:
    """Check that the limit acts on what arrives, each joint at its own, both signs."""
    limit, torques = [50.0, 10.0], _torques(60, 1)
    plant, clipped = _plant(input_delay=2, torque_saturation=limit), _plant()
    bites = np.zeros(2, int)
    for sent, due in zip(torques, [[0.0, 0.0]] * 2 + torques):
        plant.step(sent)
        cut = np.clip(due, np.negative(limit), limit)
        clipped.step(cut.tolist())
        assert list(plant.applied) == cut.tolist()
        assert _state(plant) == _state(clipped)
        bites += cut != due
    assert (bites > 10).all()
    assert (bites < 50).all()


@pytest.mark.parametrize('tau', [0.0, 2.0, -1.0])
def test_viscous_friction_decays_exponentially(tau: float) -> None:
    """Check dq(t) = tau/c + (dq(0) - tau/c) exp(-c t / m), and its integral, on each joint."""
    c, mass, start = np.array([3.0, 0.5]), np.array([2.0, 0.5]), np.array([1.5, -2.0])
    plant = _plant(SLIDERS, **FREE, viscous_friction=c.tolist(), initial_velocity=start.tolist())
    for k in range(1, 2001):
        plant.step([tau, tau])
        if k % 100 == 0:
            decay = np.exp(-c / mass * plant.t)
            np.testing.assert_allclose(
                plant.dq, tau / c + (start - tau / c) * decay, atol=1e-11)
            np.testing.assert_allclose(
                plant.q, tau / c * plant.t + (start - tau / c) * mass / c * (1.0 - decay),
                atol=1e-11)


def test_the_arm_with_viscous_friction_against_scipy() -> None:
    """Check 1 s of coupled motion; without the friction it would be elsewhere."""
    c, tau, start = np.array([4.0, 1.5]), [30.0, -5.0], [0.5, -1.0, 1.0, -2.0]
    plant = _plant(**FREE, viscous_friction=c.tolist(), initial_position=start[:2],
                   initial_velocity=start[2:])
    free = paper_field(tau)

    def field(t: float, x: Array) -> Array:
        lost = np.linalg.solve(paper_m(x[:2].tolist()), c * x[2:])
        rate: Array = free(t, x) - np.concatenate([np.zeros(2), lost])
        return rate

    for _ in range(1000):
        plant.step(tau)
    exact, other = (solve_ivp(f, (0, 1), start, method='DOP853', rtol=1e-12, atol=1e-12).y[:, -1]
                    for f in (field, free))
    np.testing.assert_allclose(_state(plant), exact, atol=1e-9)
    assert np.abs(exact - other).max() > 0.1


@pytest.mark.parametrize(('joint', 'level'), [(0, 2.5), (1, 0.7)])
def test_break_away_takes_coulomb_and_stribeck_friction(joint: int, level: float) -> None:
    """Check rest, bit-exact, up to Kf + Ks in both directions, and motion just above."""
    for sign in (1.0, -1.0):
        plant = _plant(SLIDERS, **STRIBECK)
        load = [0.0, 0.0]
        for share in (0.5, 0.99, 1.0):
            load[joint] = sign * share * level
            for _ in range(20):
                plant.step(load)
                assert _state(plant) == [0.0] * 4
        load[joint] = sign * 1.001 * level
        plant.step(load)
        assert plant.dq[joint] * sign > 0.0
        assert plant.dq[1 - joint] == 0.0
        plain = _plant(SLIDERS, coulomb_friction=[1.5, 0.4])
        load[joint] = sign * 0.9 * level  # above Kf alone
        plain.step(load)
        assert plain.dq[joint] * sign > 0.0


def _rub(joint: int, tau: float) -> Callable[[float, Array], Array]:
    """Return x' of one slider that slides forwards under the formula of STRIBECK."""
    kf, ks, speed, c = (STRIBECK[name][joint] for name in (
        'coulomb_friction', 'stribeck_friction', 'stribeck_velocity', 'viscous_friction'))

    def field(t: float, x: Array) -> Array:
        del t
        friction = kf + ks * np.exp(-(x[1] / speed) ** 2) + c * x[1]
        return np.array([x[1], (tau - friction) / SLIDERS[joint][joint]])
    return field


def test_a_stribeck_velocity_next_to_nothing_is_no_friction_in_motion() -> None:
    one, other = (_plant(SLIDERS, coulomb_friction=[1.5, 0.4], initial_velocity=[0.1, 0.1], **more)
                  for more in ({}, {'stribeck_friction': [1.0, 0.3],
                                    'stribeck_velocity': [1e-9, 1e-8]}))
    for _ in range(100):
        one.step([3.0, 1.5])
        other.step([3.0, 1.5])
    assert _state(other) == pytest.approx(_state(one), rel=1e-12)


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


def test_stops_where_scipy_says() -> None:
    """Check instant and place of rest under no torque, from either side, and rest after it."""
    plant = _plant(SLIDERS, **STRIBECK, initial_velocity=[1.0, -1.2])
    ends = []
    for joint, speed in ((0, 1.0), (1, 1.2)):
        def stopped(t: float, x: Array) -> float:
            del t
            return float(x[1])

        stopped.terminal = True  # type: ignore[attr-defined]
        found = solve_ivp(_rub(joint, 0.0), (0, 5), [0.0, speed], events=stopped,
                          method='DOP853', rtol=1e-12, atol=1e-13)
        ends.append((found.t_events[0][0], found.y_events[0][0][0]))
    while plant.t < 2.0:
        plant.step([0.0, 0.0])
        for joint, (t, _) in enumerate(ends):
            assert (plant.dq[joint] == 0.0) == (plant.t >= t)
    assert max(t for t, _ in ends) < 1.5
    np.testing.assert_allclose(plant.q, [ends[0][1], -ends[1][1]], atol=1e-9)


@pytest.mark.parametrize('friction', [
    STRIBECK, *(pytest.param(x, marks=pytest.mark.slow) for x in (
        {'viscous_friction': [2.0, 0.5], **FREE}, {**STRIBECK, **FREE},
        {**STRIBECK, 'viscous_friction': [0.0, 0.0]}))])
def test_energy_is_always_dissipated(friction: dict[str, Any]) -> None:
    """Check that the arm, let go, loses energy at every step while it moves, down to rest."""
    plant = _plant(initial_position=[1.0, 0.5], initial_velocity=[1.0, -2.0], **friction)
    last = first = _energy(plant)
    for _ in range(4000):
        before = plant.q
        plant.step([0.0, 0.0])
        now = _energy(plant)
        assert now <= last + 1e-9
        assert now < last or np.abs(np.subtract(plant.q, before)).max() < 1e-6
        last = now
    assert first - last > 10.0


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


@pytest.mark.parametrize(('name', 'value'), [
    ('viscous_friction', 1e-3), ('stribeck_friction', 1e-3), ('torque_saturation', 20.0),
    ('input_delay', 1), ('load_friction', 0.1), ('friction_asymmetry', 0.1),
    ('actuator_lag', 1e-3), ('torque_rate_limit', 1e4), ('torque_resolution', 0.1),
    ('late_samples', 0.2)])
def test_defaults_change_nothing(name: str, value: float) -> None:
    """Check that all imperfections at their off values are bit-equal to none, and each bites."""
    off: dict[str, Any] = {
        'viscous_friction': [0.0, 0.0], 'stribeck_friction': [0.0, 0.0], 'input_delay': 0,
        'stribeck_velocity': [9.0, 1e-3], 'torque_saturation': [float('inf'), 1e9],
        'position_noise': [0.0, 0.0], 'velocity_noise': [0.0, 0.0],
        'encoder_resolution': [0.0, 0.0], 'noise_seed': 5, 'load_friction': [0.0, 0.0],
        'friction_asymmetry': [0.0, 0.0], 'actuator_lag': [0.0, 0.0],
        'torque_rate_limit': [float('inf')] * 2, 'torque_resolution': [0.0, 0.0],
        'joint_stiffness': [float('inf')] * 2, 'joint_damping': [0.0, 0.0],
        'motor_inertia': [0.0, 0.0], 'encoder_side': 'link', 'velocity_sensor': 'exact',
        'velocity_cutoff': 1.0, 'sample_loss': 0.0, 'late_samples': 0.0}
    on = {**off, name: value if name in ('input_delay', 'late_samples') else [value, value]}
    plants = [_plant(), _plant(**off), _plant(**on)]
    for tau in _torques(80, 2):
        for plant in plants:
            plant.step(tau)
        assert _state(plants[0]) == _state(plants[1])
        assert plants[0].modes == plants[1].modes
    assert _state(plants[2]) != _state(plants[0])


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_break_away_depends_on_the_direction(sign: float) -> None:
    """Check rest, bit-exact, up to Kf (1 + a) forwards and Kf (1 - a) backwards, and the slide."""
    kf, a, mass = 2.0, 0.3, 2.0
    level = kf * (1.0 + sign * a)
    plant = _plant(SLIDERS, coulomb_friction=[kf, 1.0], friction_asymmetry=[a, -0.5])
    for share in (0.5, 0.99, 1.0 - 1e-12):
        for _ in range(20):
            plant.step([sign * share * level, 0.0])
            assert _state(plant) == [0.0] * 4
    plant.step([sign * 1.001 * level, 0.0])
    assert plant.dq[0] * sign > 0.0
    plant.step([sign * (level + 1.0), 0.0])
    speed = plant.dq[0]
    plant.step([sign * (level + 1.0), 0.0])
    assert plant.dq[0] - speed == pytest.approx(sign * 1e-3 / mass, rel=1e-9)
    plant.step([0.0, sign * (1.0 - sign * 0.5) + sign * 0.01])
    assert plant.dq[1] * sign > 0.0


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_load_dependent_friction(sign: float) -> None:
    """Check break-away at Kf / (1 - μ), and (|τ| (1 - μ) - Kf) / m beyond."""
    kf, share, mass = 2.0, 0.2, 2.0
    plant = _plant(SLIDERS, coulomb_friction=[kf, 0.0], load_friction=[share, 0.0])
    level = kf / (1.0 - share)
    for load in (0.5, 0.99, 1.0 - 1e-12):
        for _ in range(20):
            plant.step([sign * load * level, 0.0])
            assert _state(plant) == [0.0] * 4
    speed = 0.0
    for torque in (1.01 * level, 8.0, 3.0, 5.0):
        plant.step([sign * torque, 0.0])
        speed += sign * 1e-3 * (torque * (1.0 - share) - kf) / mass
        assert plant.dq[0] == pytest.approx(speed, rel=1e-9)


def test_load_dependent_friction_has_the_mean_torque_of_the_period() -> None:
    """Check a drive with lag from the second period on: at first the joint sticks for a while."""
    lag, c, share, mass = 2e-3, 6.0, 0.25, 2.0
    plant = _plant(SLIDERS, **FREE, load_friction=[share, 0.0], actuator_lag=[lag, lag])
    plant.step([c, 0.0])
    first, start = plant.dq[0], 1e-3 + lag * np.exp(-1e-3 / lag)
    for k in range(2, 20):
        plant.step([c, 0.0])
        impulse = c * (1e-3 * k + lag * np.exp(-1e-3 * k / lag) - start)
        assert plant.dq[0] - first == pytest.approx((1.0 - share) * impulse / mass, rel=1e-9)
    assert first > 0.0


EVERYTHING: dict[str, Any] = {
    **STRIBECK, 'load_friction': [0.05, 0.02], 'friction_asymmetry': [0.1, -0.2],
    'actuator_lag': [2e-3, 1e-3], 'torque_rate_limit': [5e4, 1e4], 'torque_resolution': [0.1, 0.1],
    'torque_saturation': [90.0, 30.0], 'input_delay': 1, 'late_samples': 0.1, 'sample_loss': 0.1,
    'velocity_sensor': 'filtered', 'encoder_resolution': [1e-5, 1e-5],
    'velocity_noise': [1e-3, 1e-3], 'disturbance.amplitude': [1.0, 1.0],
    'disturbance.frequency': [3.0, 4.0]}
ELASTIC: dict[str, Any] = {'joint_stiffness': [2e3, 1e3], 'motor_inertia': [1.0, 0.2]}


@pytest.mark.parametrize('values', [{}, {**EVERYTHING, **ELASTIC}])
def test_a_torque_may_be_an_array(values: dict[str, Any]) -> None:
    """Check arrays of floats, integers and single precision against lists, bit for bit."""
    lists, arrays = _plant(**values), _plant(**values)
    for torque in _torques(100, 5):
        for kind in (float, int, np.float32):
            tau: Array = np.array(torque).astype(kind)
            lists.step([float(x) for x in tau])
            arrays.step(tau)
            assert _state(lists) == _state(arrays)
            assert lists.measured == arrays.measured
    assert {type(x) for x in (*arrays.q, *arrays.dq, *arrays.applied)} == {float}


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
    ('friction_asymmetry', [1.1, 0.0]), ('sample_loss', 0.6), ('late_samples', 1.1),
    ('velocity_sensor', 'none'), ('velocity_cutoff', 0.0),
    ('input_delay', -1), ('input_delay', 101), ('input_delay', 1.0),
    ('torque_saturation', [0.0, 1.0]), ('viscous_friction', [-1.0, 0.0]),
    ('stribeck_velocity', [0.0, 1.0]), ('velocity_noise', [-1e-3, 0.0]), ('noise_seed', -1)])
def test_refusals(name: str, value: object) -> None:
    """Check what none of them can be."""
    with pytest.raises(ParameterError, match=name):
        PlantConfig.from_mapping({name: value})

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

"""Brakes and friction with time constants far below a step: closed forms, energy, Radau IIA."""

from __future__ import annotations

from collections.abc import Sequence
import sys
from types import SimpleNamespace
from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import record
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
from oracles import Array, Masses
import pinocchio
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]
from urdfs import joint, link, robot, UR5, urdf

#: Of a light wrist [kg·m²], and one control period [s].
INERTIA, H = 1e-3, 1e-3
START = np.array([1.0, -3.0])  # [rad/s]


def wrist(**values: Any) -> Plant:
    """Return two joints with the inertia of a wrist that know nothing of each other."""
    config = PlantConfig.from_mapping({'coulomb_friction': [0.0, 0.0], **values})
    return Plant(config, Masses([[INERTIA, 0.0], [0.0, INERTIA]]))


@pytest.mark.parametrize('kind', ['fault_damping', 'viscous_friction'])
@pytest.mark.parametrize('damping', [1e-2, 0.9, 1.1, 2.0, 5.0, 20.0, 1e3, 1e4, 1e8])
def test_a_joint_slows_down_by_the_closed_form(kind: str, damping: float) -> None:
    """Check dq exp(-d t / m) and the way from 0.01 to 1e8 time constants a step, and its sign."""
    plant = wrist(**{kind: [damping] * 2}, initial_velocity=START.tolist())
    plant.brake(kind == 'fault_damping')
    for k in range(1, 20):
        plant.step([0.0, 0.0])
        passed = damping / INERTIA * H * k
        speed, way = np.exp(-passed), -np.expm1(-passed) * INERTIA / damping
        np.testing.assert_allclose(plant.dq / START, [speed, speed], atol=0.006)
        np.testing.assert_allclose(plant.q / START, [way, way], atol=0.006 * H)


@pytest.mark.parametrize('damping', [0.5, 1.5, 6.0, 20.0, 1e4])
def test_a_braked_joint_stops_where_friction_stops_it(damping: float) -> None:
    """Check the way until dq = 0 at m/d log(1 + d dq / Kf), and that it sticks there."""
    kf, speed = 0.05, 2.0
    plant = wrist(coulomb_friction=[kf, 0.0], fault_damping=[damping] * 2,
                  initial_velocity=[speed, 0.0])
    plant.brake(True)
    end = INERTIA / damping * np.log1p(damping * speed / kf)
    way = (INERTIA * speed - kf * end) / damping
    for _ in range(int(end / H) + 2):
        plant.step([0.0, 0.0])
    assert plant.dq == [0.0, 0.0]
    assert plant.modes == (0, 0)
    assert plant.q[0] == pytest.approx(way, abs=0.005 * speed * H)
    rest = plant.q
    plant.step([0.99 * kf, 0.0])
    assert plant.q == rest


@pytest.mark.parametrize('damping', [20.0, 1e4])
def test_a_load_beyond_friction_moves_a_braked_joint_at_its_final_velocity(damping: float) -> None:
    kf, load = 0.05, np.array([0.25, -0.35])
    plant = wrist(coulomb_friction=[kf, kf], fault_damping=[damping] * 2)
    plant.brake(True)
    for _ in range(100):
        plant.step(load)
    final = np.sign(load) * (np.abs(load) - kf) / damping
    np.testing.assert_allclose(plant.dq, final, rtol=1e-9)
    np.testing.assert_allclose(plant.q, 0.1 * final, rtol=1e-3)
    assert plant.modes == (1, -1)


class Drawn(NamedTuple):
    """An arm under its brakes, and its model."""

    plant: Plant
    model: Model


def drawn_urdf(rng: np.random.Generator, n: int) -> str:
    """Return an arm whose last inertia is 1e-4 to 1e-3 kg·m²."""
    parts = [link('l0')]
    for i in range(n):
        part = i / (n - 1)
        inertia = 10.0 ** ((1.0 - part) * rng.uniform(-1.0, 0.5) + part * rng.uniform(-4.0, -3.0))
        size = np.sqrt(inertia)
        center = 0.5 * size * rng.uniform(-1.0, 1.0, 3)
        principal = inertia * rng.uniform(0.6, 1.0, 3)
        axis = ('1 0 0', '0 1 0', '0 0 1')[rng.integers(3)]
        origin = ' '.join(map(str, 2.0 * size * rng.uniform(-1.0, 1.0, 3)))
        parts += [link(f'l{i + 1}', rng.uniform(0.2, 1.0), tuple(center), tuple(principal)),
                  joint(f'j{i}', 'revolute', f'l{i}', f'l{i + 1}', axis, origin,
                        '<limit lower="-9" upper="9" effort="100" velocity="0"/>')]
    return urdf(parts)


def drawn_arm(rng: np.random.Generator, fastest: float, braked: float, **values: Any) -> Drawn:
    """Return an arm with up to `fastest` [rad/s]; `braked` is the share of damped joints."""
    n = int(rng.integers(2, 7))
    period = float(rng.choice([0.001, 0.002, 0.005, 0.01]))
    damping = np.where(rng.random(n) < braked, 10.0 ** rng.uniform(-2.0, 4.0, n), 0.0)
    config = PlantConfig.from_mapping({
        'joint_names': [f'j{i}' for i in range(n)], 'model': 'urdf', 'description': 'drawn',
        'gravity': float(rng.choice([0.0, 9.81])), 'control_period': period,
        'integration_step': float(rng.choice([0.001, period])),
        'coulomb_friction': [float(rng.choice([0.0, 0.01, 1.0]))] * n,
        'fault_damping': damping.tolist(), 'initial_position': rng.uniform(-2.0, 2.0, n).tolist(),
        'initial_velocity': (fastest * rng.uniform(-1.0, 1.0, n)).tolist(), 'compiled': False,
        **values})
    model = model_of(config, drawn_urdf(rng, n))
    plant = Plant(config, model)
    plant.brake(True)
    return Drawn(plant, model)


def energy(model: Model, q: Sequence[float], dq: Sequence[float]) -> float:
    kinetic: float = 0.5 * np.dot(dq, np.array(model.mass_matrix(q)) @ np.array(dq))
    return kinetic + model.potential_energy(q)


@pytest.mark.parametrize('seed', range(0, 40, 10))
def test_energy_never_grows_under_brakes(seed: int) -> None:
    """Check ten arms with wrists of 1e-4 to 1e-3 kg·m², dampings up to 1e4, periods to 10 ms."""
    for i in range(seed, seed + 10):
        plant, model = drawn_arm(np.random.default_rng(i), 3.0, 0.8)
        least = start = energy(model, plant.q, plant.dq)
        for _ in range(25):
            plant.step([0.0] * plant.n)
            now = energy(model, plant.q, plant.dq)
            assert now <= least + 1e-12 * abs(start), i
            least = now


def test_no_speed_makes_a_motion_without_torque_diverge() -> None:
    """Check arms at up to 800 rad/s, a turn and more in a step, with few brakes and with none."""
    for i in (16, 17, 41, 66):
        fastest = 10.0 ** np.random.default_rng(i).uniform(1.0, 3.0)
        plant, model = drawn_arm(np.random.default_rng(i), fastest, 0.3 * (i % 2))
        start = energy(model, plant.q, plant.dq)
        for _ in range(12):
            plant.step([0.0] * plant.n)
        assert energy(model, plant.q, plant.dq) < start + 1e-2 * abs(start), i


def test_a_braked_arm_against_pinocchio_and_radau() -> None:
    """Check 50 ms of a UR10 with brakes of 20 N·m·s/rad, up to 39 time constants a step."""
    description = robot('ur10_robot')
    start = np.array([0.3, -1.0, 1.2, -0.5, 0.7, 0.2])
    speed = np.array([0.5, -0.8, 1.0, 2.0, -2.0, 3.0])
    damping = np.full(6, 20.0)
    config = PlantConfig.from_mapping({
        'joint_names': list(UR5), 'model': 'urdf', 'description': 'ur10', 'gravity': 9.81,
        'coulomb_friction': [0.0] * 6, 'fault_damping': damping.tolist(), 'compiled': False,
        'initial_position': start.tolist(), 'initial_velocity': speed.tolist()})
    model = pinocchio.buildModelFromXML(description)
    data = model.createData()
    upper = np.triu(pinocchio.crba(model, data, start))
    inertia = upper + np.triu(upper, 1).T
    assert np.linalg.eigvals(np.linalg.solve(inertia, np.diag(damping))).real.max() * H > 30.0

    def field(_t: float, x: Array) -> Array:
        ddq = pinocchio.aba(model, data, x[:6], x[6:], -damping * x[6:])
        return np.concatenate((x[6:], ddq))

    times = np.arange(1, 51) * H
    exact = solve_ivp(field, (0.0, times[-1]), [*start, *speed], method='Radau', t_eval=times,
                      rtol=1e-9, atol=1e-11).y.T
    plant = Plant(config, model_of(config, description))
    plant.brake(True)
    found = []
    for _ in times:
        plant.step([0.0] * 6)
        found.append([*plant.q, *plant.dq])
    np.testing.assert_allclose(found, exact, atol=5e-3)
    np.testing.assert_allclose(np.array(found)[20:], exact[20:], atol=5e-5)


def test_an_own_friction_that_is_steep_is_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check c dq + b dq³ with c H / m = 50 from 2 rad/s against Radau IIA."""
    c, b = 50.0, 30.0

    @record
    class Steep(NamedTuple):
        none: float = 0.0

        @classmethod
        def for_joints(cls, _joint_names: Sequence[str]) -> Steep:
            return cls()

        def resistance(self, velocity: Array, _load: Array, _mode: Array) -> Array:
            return c * velocity + b * velocity ** 3

    monkeypatch.setitem(sys.modules, 'steep', SimpleNamespace(Friction=Steep))
    plant = wrist(friction_model='steep:Friction', initial_velocity=[2.0, -0.5], compiled=False)
    tau = np.array([3.0, 0.0])

    def field(_t: float, x: Array) -> Array:
        return np.concatenate((x[2:], (tau - c * x[2:] - b * x[2:] ** 3) / INERTIA))

    exact = solve_ivp(field, (0.0, 10 * H), [0.0, 0.0, 2.0, -0.5], method='Radau', rtol=1e-9,
                      atol=1e-12).y[:, -1]
    for _ in range(10):
        plant.step(tau)
    np.testing.assert_allclose([*plant.q, *plant.dq], exact, atol=2e-4)


def test_the_motor_of_an_elastic_joint_is_braked() -> None:
    """Check that links and light motors lose energy, that of the springs included."""
    n = 3
    for i in range(4):
        rng = np.random.default_rng(i)
        text = drawn_urdf(rng, n)
        config = PlantConfig.from_mapping({
            'joint_names': [f'j{k}' for k in range(n)], 'model': 'urdf', 'description': 'drawn',
            'gravity': 9.81, 'coulomb_friction': [0.0] * n,
            'joint_stiffness': (10.0 ** rng.uniform(1.0, 3.0, n)).tolist(),
            'motor_inertia': (10.0 ** rng.uniform(-3.0, -1.0, n)).tolist(),
            'fault_damping': (10.0 ** rng.uniform(0.0, 4.0, n)).tolist(),
            'initial_velocity': [2.0, -1.0, 3.0]})
        plant = Plant(config, model_of(config, text))
        plant.brake(True)
        coordinates = plant._coupled
        least = np.inf
        for _ in range(20):
            motion = plant.state.motion
            now = energy(coordinates, motion.q.tolist(), motion.dq.tolist())
            assert now <= least + 1e-12 * abs(now), i
            least = now
            plant.step([0.0] * n)


@pytest.mark.parametrize('values', [
    {'joint_stiffness': [1e9, 1e3], 'motor_inertia': [1e-4, 1e-2]},
    {'joint_damping': [1e9, 0.0]}, {'motor_inertia': [1e-11, 1e-3]}])
def test_elastic_joints_that_would_take_for_ever_are_refused(values: dict[str, list[float]]
                                                             ) -> None:
    with pytest.raises(CtcError, match=r'joint_stiffness .* allowed: at most 10000'):
        wrist(**{'joint_stiffness': [1e3, 1e3], 'motor_inertia': [1e-2, 1e-2], **values})

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

"""Elastic joints against closed forms of two masses and a spring, energy, and scipy."""

from __future__ import annotations

from math import inf, pi, sin, sqrt
from typing import Any

from ctc_chattering.dynamics.elastic_model import Elastic
from ctc_chattering.dynamics.model_check import check_dynamics
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.errors import ParameterError
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
from oracles import Array, kinetic_energy, Masses, paper_c, paper_g, paper_m
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]

SLIDERS = [[2.0, 0.0], [0.0, 0.5]]
K, J, M = np.array([800.0, 300.0]), np.array([0.4, 0.1]), np.array([2.0, 0.5])
FREE: dict[str, Any] = {'coulomb_friction': [0.0, 0.0]}
SPRINGS: dict[str, Any] = {'joint_stiffness': K.tolist(), 'motor_inertia': J.tolist()}


def plant_of(masses: list[list[float]] | None = None, **values: Any) -> Plant:
    return Plant(PlantConfig.from_mapping({**SPRINGS, **values}),
                 Masses(masses) if masses else None)


def test_the_composite_is_a_model() -> None:
    """Check M, C, G and the potential, one of the joints rigid, by the checks of any model."""
    model = Elastic(TwoLink(), (inf, 300.0), (0.0, 0.0), (0.0, 0.1))
    assert (model.n, model.motors) == (3, [0, 2])
    assert all(found.passed for found in check_dynamics(model))


def test_resonance_of_two_masses() -> None:
    """
    Check motor and link under a step of the torque c, from rest.

    The centre of gravity moves by c t² / (2 (M + J)), and θ - q = c (1 - cos ω t) / (J ω²) with
    ω² = K (1/M + 1/J).
    """
    c, omega = np.array([2.0, -1.0]), np.sqrt(K * (1.0 / M + 1.0 / J))
    plant = plant_of(SLIDERS, **FREE)
    for k in range(1, 501):
        plant.step(c.tolist())
        t = 1e-3 * k
        centre = c * t * t / (2.0 * (M + J))
        wind = c * (1.0 - np.cos(omega * t)) / (J * omega ** 2)
        assert plant.q == pytest.approx(centre - J / (M + J) * wind, abs=1e-7)
        assert plant.measured[0] == pytest.approx(centre + M / (M + J) * wind, abs=1e-7)
        speed = c * t / (M + J) + M / (M + J) * c * np.sin(omega * t) / (J * omega)
        assert plant.measured[1] == pytest.approx(speed, abs=1e-5)
    assert (omega * 0.5 / (2.0 * pi) > 3.0).all()


def test_the_encoder_is_on_the_side_that_is_asked_for() -> None:
    motor, link = (plant_of(SLIDERS, **FREE, encoder_side=side) for side in ('motor', 'link'))
    for _ in range(20):
        motor.step([2.0, -1.0])
        link.step([2.0, -1.0])
        assert list(link.measured[0]) == list(link.q) == list(motor.q)
        assert list(link.measured[1]) == list(link.dq) == list(motor.dq)
    assert np.abs(np.subtract(motor.measured[0], motor.q)).min() > 1e-5


def test_a_stiff_joint_takes_the_steps_that_it_needs() -> None:
    """Check 5 s⁻¹ · 10⁴ beside a step of 1 ms: stable, and the mean motion that of M + J."""
    plant = plant_of(SLIDERS, **FREE, joint_stiffness=[1e7, 1e7], motor_inertia=[4e-3, 4e-3])
    for _ in range(40):
        plant.step([2.0, -1.0])
    assert plant.q == pytest.approx(
        np.array([2.0, -1.0]) * 0.04 ** 2 / (2.0 * (M + 4e-3)), rel=1e-4)


def test_a_motor_that_sticks_holds_the_spring() -> None:
    """
    Check a link with d = A sin w t on it while its motor sticks, and that friction is the motor's.

    q = A / M / (ω² - w²) (sin w t - w/ω sin ω t) with ω² = K / M.
    """
    amplitude, w, omega = 3.0, 11.0, sqrt(K[0] / M[0])
    plant = plant_of(SLIDERS, coulomb_friction=[50.0, 50.0], **{
        'disturbance.amplitude': [amplitude, 0.0], 'disturbance.frequency': [w, 0.0]})
    for k in range(1, 1001):
        plant.step([10.0, 10.0])
        t = 1e-3 * k
        q = amplitude / M[0] / (omega ** 2 - w * w) * (sin(w * t) - w / omega * sin(omega * t))
        assert plant.q[0] == pytest.approx(q, abs=1e-8)
        assert list(plant.measured[0]) == list(plant.measured[1]) == [0.0, 0.0]
    assert plant.q[1] == 0.0
    assert plant.modes == (0, 0, 0, 0)
    plant.step([80.0, 0.0])
    assert plant.measured[1][0] > 0.0


def test_the_springs_carry_the_weight_at_the_start() -> None:
    """Check that the arm stays where it is while friction holds the motors, which lead by G/K."""
    stiff, q = np.array([2e4, 8e3]), [0.2, -0.5]
    plant = plant_of(joint_stiffness=stiff.tolist(), motor_inertia=[1.0, 0.1],
                     coulomb_friction=[40.0, 40.0], initial_position=q)
    weight = paper_g(q)
    assert (np.abs(weight) > 1.0).all()
    for _ in range(300):
        plant.step([0.0, 0.0])
        assert plant.q == pytest.approx(q, abs=1e-11)
        assert plant.measured[0] == pytest.approx(q + weight / stiff, abs=1e-14)


@pytest.mark.parametrize('damping', [0.0, 3.0])
def test_energy(damping: float) -> None:
    """Check kinetic energy of links and motors plus potential of weight and springs."""
    stiffness, inertia = np.array([4e3, 1e3]), np.array([1.0, 0.2])
    plant = plant_of(**FREE, joint_stiffness=stiffness.tolist(), motor_inertia=inertia.tolist(),
                     joint_damping=[damping, damping], initial_position=[1.5, 0.5],
                     initial_velocity=[0.0, 3.0])

    def energy() -> float:
        theta, speed = (np.array(x) for x in plant.measured)
        return (kinetic_energy(plant.model, plant.q, plant.dq)
                + plant.model.potential_energy(plant.q)
                + float(0.5 * inertia @ speed ** 2 + 0.5 * stiffness @ (theta - plant.q) ** 2))

    start = energy()
    series = []
    for _ in range(2000):
        plant.step([0.0, 0.0])
        series.append(energy())
    if damping:
        assert (np.diff(series) < 1e-9).all()
        assert series[-1] < start - 0.05
    else:
        assert np.abs(np.subtract(series, start)).max() < 1e-5 * start


def test_an_elastic_joint_beside_a_rigid_one_against_scipy() -> None:
    """Check the two-link arm with joint 2 elastic and damped, 1 s of it."""
    k2, d2, j2, tau = 500.0, 1.5, 0.2, np.array([40.0, 3.0])
    plant = plant_of(**FREE, joint_stiffness=[inf, k2], motor_inertia=[0.0, j2],
                     joint_damping=[0.0, d2], initial_position=[0.5, -1.0])
    theta = -1.0 + paper_g([0.5, -1.0])[1] / k2

    def field(t: float, x: Array) -> Array:
        del t
        q, dq = x[[0, 1]].tolist(), x[[3, 4]].tolist()
        spring = k2 * (x[2] - x[1]) + d2 * (x[5] - x[4])
        bias = paper_c(q, dq) @ np.array(dq) + paper_g(q)
        ddq = np.linalg.solve(paper_m(q), np.array([tau[0], spring]) - bias)
        return np.array([*x[3:], *ddq, (tau[1] - spring) / j2])

    exact = solve_ivp(field, (0, 1), [0.5, -1.0, theta, 0.0, 0.0, 0.0], method='DOP853',
                      rtol=1e-11, atol=1e-12).y[:, -1]
    for _ in range(1000):
        plant.step(tau.tolist())
    assert [*plant.q, *plant.dq] == pytest.approx(exact[[0, 1, 3, 4]], abs=1e-6)
    assert plant.measured[0] == pytest.approx(exact[[0, 2]], abs=1e-6)


def test_viscous_friction_brakes_and_lag_act_on_the_motor() -> None:
    """Check J ddθ = τ - c dθ - K θ with the link held by its weight: a link of 1e6 kg·m²."""
    heavy = [[1e6, 0.0], [0.0, 1e6]]
    lag, c = 5e-3, 2.0
    plant = plant_of(heavy, **FREE, viscous_friction=[c, c], actuator_lag=[lag, lag])

    def field(t: float, x: Array) -> Array:
        torque = 3.0 * (1.0 - np.exp(-t / lag))
        return np.array([x[1], (torque - c * x[1] - K[0] * x[0]) / J[0]])

    exact = solve_ivp(field, (0, 0.2), [0.0, 0.0], method='DOP853', rtol=1e-11, atol=1e-13,
                      max_step=1e-3).y[:, -1]
    for _ in range(200):
        plant.step([3.0, 0.0])
    assert plant.measured[0][0] == pytest.approx(exact[0], abs=1e-6)
    assert plant.measured[1][0] == pytest.approx(exact[1], abs=1e-4)


@pytest.mark.parametrize(('name', 'values'), [
    ('motor_inertia', {'joint_stiffness': [1e3, 1e3]}),
    ('motor_inertia', {'motor_inertia': [0.1, 0.1]}),
    ('motor_inertia', {'joint_stiffness': [1e3, inf], 'motor_inertia': [0.1, 0.1]}),
    ('joint_damping', {'joint_damping': [0.0, 1.0]}),
    ('joint_stiffness', {'joint_stiffness': [0.0, 1e3], 'motor_inertia': [0.1, 0.1]}),
    ('encoder_side', {'encoder_side': 'gear'})])
def test_refusals(name: str, values: dict[str, Any]) -> None:
    with pytest.raises(ParameterError, match=name):
        PlantConfig.from_mapping(values)

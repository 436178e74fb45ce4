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

from math import inf, sin, sqrt
from typing import Any

from ctc_chattering.dynamics.elastic_model import Elastic
from ctc_chattering.dynamics.model_check import check_dynamics
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
from oracles import Array, Masses, paper_c, paper_g, paper_m
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


def test_a_stiff_joint_takes_the_steps_that_it_needs() -> None:
    """Check 5 s⁻¹ · 10⁴ beside a step of 1 ms: stable, and the mean motion that of M + J."""
    plant = plant_of(SLIDERS, **FREE, joint_stiffness=[1e7, 1e7], motor_inertia=[4e-3, 4e-3])
    for _ in range(10):
        plant.step([2.0, -1.0])
    assert plant.q == pytest.approx(
        np.array([2.0, -1.0]) * 0.01 ** 2 / (2.0 * (M + 4e-3)), rel=1e-4)


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

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

"""The simulated robot and its disturbance, against closed forms, energy and scipy."""

from math import inf
from typing import Any

from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
from oracles import Array, Masses, paper_field
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]

SLIDERS = [[2.0, 0.0], [0.0, 0.5]]  # two joints that know nothing of each other


class Counting(TwoLink):
    """The two-link arm that counts how often a plant asks for its dynamics."""

    calls = 0

    def mass_and_bias(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Return M and C dq + G, and count."""
        self.calls += 1
        return super().mass_and_bias(q, dq)


def _plant(**values: Any) -> Plant:
    model = values.pop('masses', None)
    names = {'amplitude': 'disturbance.amplitude', 'frequency': 'disturbance.frequency'}
    config = PlantConfig.from_mapping({names.get(k, k): v for k, v in values.items()})
    return Plant(config, Masses(model) if model else None)


def test_smooth_motion_with_disturbance_against_scipy() -> None:
    """Check 1 s of free motion under a held torque and d(t) against an 8th-order method."""
    amplitude, frequency, tau = [5.0, -3.0], [3.0, 7.0], [20.0, -5.0]
    plant = _plant(coulomb_friction=[0, 0], initial_position=[0.5, -1.0],
                   initial_velocity=[1.0, -2.0], amplitude=amplitude, frequency=frequency,
                   control_period=5e-3, integration_step=1e-3)
    for _ in range(200):
        plant.step(tau)
    assert plant.t == 1.0

    def push(t: float) -> Array:
        return np.array(amplitude) * np.sin(np.array(frequency) * t)

    start = [0.5, -1.0, 1.0, -2.0]
    exact = solve_ivp(paper_field(tau, push), (0, 1), start, method='DOP853', rtol=1e-12,
                      atol=1e-12).y[:, -1]
    np.testing.assert_allclose([*plant.q, *plant.dq], exact, atol=1e-8)
    calm = solve_ivp(paper_field(tau), (0, 1), start, rtol=1e-9).y[:, -1]
    assert np.abs(calm - exact).max() > 0.05


@pytest.mark.parametrize('step', [1e-3, 0.05])
def test_a_sliding_joint_stops_at_the_closed_form(step: float) -> None:
    """Check m v0 / Kf and m v0² / (2 Kf) for both joints, whatever the step, and rest after."""
    plant = _plant(masses=SLIDERS, coulomb_friction=[3.0, 0.8], initial_position=[0.1, -0.2],
                   initial_velocity=[1.51, -1.37], control_period=step, integration_step=step)
    stops = [2.0 * 1.51 / 3.0, 0.5 * 1.37 / 0.8]
    ends = [0.1 + 2.0 * 1.51 ** 2 / 6.0, -0.2 - 0.5 * 1.37 ** 2 / 1.6]
    for _ in range(round(1.5 / step)):
        plant.step([0.0, 0.0])
        for i, sign in enumerate((1, -1)):
            left = max(stops[i] - plant.t, 0.0)
            speed = (1.5, 1.6)[i] * left
            assert plant.dq[i] == pytest.approx(sign * speed, abs=1e-11)
            assert plant.q[i] == pytest.approx(ends[i] - sign * speed * left / 2, abs=1e-11)
            assert left or (plant.dq[i] == 0.0 and plant.modes[i] == 0)
    rest = plant.q
    plant.step([3.0, -0.8])
    assert list(plant.q) == list(rest)


def test_passes_through_zero_when_the_load_is_large() -> None:
    """Check that a joint pushed back through rest reverses at once, by the closed form."""
    plant = _plant(masses=SLIDERS, coulomb_friction=[3.0, 0.0], initial_velocity=[1.0, 0.0],
                   control_period=0.3, integration_step=0.3)
    plant.step([-7.0, 0.0])
    turn = 2.0 * 1.0 / 10.0  # then -(7 - 3) / 2
    assert plant.dq[0] == pytest.approx(-2.0 * (0.3 - turn), abs=1e-11)
    assert plant.q[0] == pytest.approx(0.5 * turn - 0.1 ** 2, abs=1e-11)
    assert plant.modes[0] == -1


def test_no_numerical_chatter() -> None:
    """Check that loads within rounding of ±Kf do not make one step a thousand."""
    model, q = Counting(), [0.3, -0.2]
    gravity = model.gravity_torque(q)
    plant = Plant(PlantConfig(initial_position=tuple(q)), model)
    worst = 0
    for ulps in range(-6, 7):
        edge = [g + 9.9 * (1.0 + ulps * 1.1e-16) for g in gravity]
        for tau in (edge, [edge[0], gravity[1]], [gravity[0], edge[1]]):
            before = model.calls
            plant.step(tau)
            worst = max(worst, model.calls - before)
    assert worst <= 500
    assert plant.q == pytest.approx(q, abs=1e-12)


def test_configure_acts_from_the_next_step() -> None:
    """Check friction and disturbance switched in the run; state and time live on."""
    plant = _plant(masses=SLIDERS, coulomb_friction=[3.0, 3.0])
    plant.step([2.0, 0.0])
    assert list(plant.dq) == [0.0, 0.0]
    plant.configure(plant.config.changed({'coulomb_friction': [1.0, 3.0]}))
    plant.step([2.0, 0.0])
    assert plant.dq[0] == pytest.approx(0.5 * 1e-3)
    plant.configure(plant.config.changed({'coulomb_friction': [0.0, 0.0]}))
    plant.step([2.0, 0.0])
    assert plant.dq[0] == pytest.approx(1.5 * 1e-3)
    plant.configure(plant.config.changed({
        'disturbance.amplitude': [2.0, 0.0], 'disturbance.frequency': [1e-9, 0.0]}))
    plant.step([2.0, 0.0])
    assert plant.dq[0] == pytest.approx(2.5 * 1e-3)
    assert (plant.k, plant.t) == (4, 0.004)


@pytest.mark.parametrize('tau', [
    [1e300, 0.0], [1e150, -1e150], [np.nan, 0.0], [0.0, np.inf], [-np.inf, np.inf]])
@pytest.mark.parametrize(('friction', 'velocity'), [(9.9, 0.0), (0.0, 1.0)])
def test_divergence_is_an_error(tau: list[float], friction: float, velocity: float) -> None:
    """Check that no torque leads to NaN, or is swallowed by friction, without an error."""
    plant = _plant(coulomb_friction=friction, initial_velocity=velocity)
    with pytest.raises(CtcError):
        for _ in range(20):
            plant.step(tau)


def test_brakes_are_viscous_friction() -> None:
    """Check dq exp(-(c + d) t / m) and the way with brakes on, and exp(-c t / m) with them off."""
    viscous = 0.3
    plant = _plant(masses=SLIDERS, coulomb_friction=[0, 0], viscous_friction=[viscous, viscous],
                   fault_damping=[4.0, 2.5], initial_velocity=[1.0, -2.0])
    q, dq = np.zeros(2), np.array([1.0, -2.0])
    assert not plant.braking
    for braking in (False, True, False, True):
        plant.brake(braking)
        assert plant.braking == braking
        for _ in range(100):
            plant.step([0.0, 0.0])
        c, mass = viscous + np.array([4.0, 2.5]) * braking, np.array([2.0, 0.5])
        rate = np.maximum(c / mass, 1e-12)
        q, dq = q - dq * np.expm1(-rate * 0.1) / rate, dq * np.exp(-rate * 0.1)
        np.testing.assert_allclose(plant.q, q, atol=1e-9)
        np.testing.assert_allclose(plant.dq, dq, atol=1e-9)
    assert abs(dq[0]) < 0.65


def test_configure_keeps_the_brakes() -> None:
    """Check that a parameter set while they are on neither releases nor forgets them."""
    plant = _plant(masses=SLIDERS, coulomb_friction=[0, 0], initial_velocity=[1.0, 1.0],
                   fault_damping=[0.0, 0.0])
    plant.brake(True)
    plant.configure(plant.config.changed({'fault_damping': [4.0, 0.0]}))
    assert plant.braking
    plant.step([0.0, 0.0])
    assert list(plant.dq) == pytest.approx([np.exp(-2e-3), 1.0], rel=1e-12)


def test_a_push_acts_for_its_duration_after_it_was_set() -> None:
    """Check it against the same torque from the drives, which have no bounds here."""
    config = PlantConfig(torque_saturation=(inf, inf))
    pushed, driven = Plant(config), Plant(config)
    amount = (30.0, -4.0)
    for k in range(400):
        if k in (100, 250):
            pushed.configure(config)
            pushed.configure(config.changed({
                'disturbance.push': amount, 'disturbance.push_duration': 0.05}))
        acts = 100 <= k < 150 or 250 <= k < 300
        pushed.step((20.0, 5.0))
        driven.step((50.0, 1.0) if acts else (20.0, 5.0))
        assert [*pushed.q, *pushed.dq] == pytest.approx([*driven.q, *driven.dq], abs=1e-9)

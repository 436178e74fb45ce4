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

"""Lag, rate limit and resolution of the drives against closed forms and scipy's integrator."""

from __future__ import annotations

from itertools import pairwise
from math import exp, inf, log
from typing import Any

from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
from oracles import Array, Masses
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]

H = 1e-3
MASSES = np.array([2.0, 0.5])


def robot(**values: Any) -> Plant:
    """Return two masses that know nothing of each other."""
    config = PlantConfig.from_mapping({'coulomb_friction': [0.0, 0.0], **values})
    return Plant(config, Masses(np.diag(MASSES).tolist()))


def commands(count: int, seed: int = 0) -> list[list[float]]:
    """Return torques that jump at each sample."""
    rows: list[list[float]] = (
        np.random.default_rng(seed).normal(size=(count, 2)) * [8.0, 3.0]).tolist()
    return rows


@pytest.mark.parametrize('lag', [5e-3, 1e-3, 1e-6])
def test_a_step_of_the_command(lag: float) -> None:
    """
    Check τ = c (1 - exp(-t/T)) and the velocity c (t - T + T exp(-t/T)) / m, whatever the lag.

    The position is second order in the step, as it is where a torque is held.
    """
    c = np.array([3.0, -1.0])
    plant = robot(actuator_lag=[lag, lag])
    for k in range(1, 31):
        plant.step(c.tolist())
        t, fade = k * H, exp(-k * H / lag)
        assert plant.applied == pytest.approx(c * (1.0 - fade), abs=1e-13)
        assert plant.dq == pytest.approx(c / MASSES * (t - lag * (1.0 - fade)), abs=1e-13)
        way = c / MASSES * (0.5 * t * t - lag * t + lag ** 2 * (1.0 - fade))
        bound = H * H * (2e-3 if lag >= H else 0.09)
        assert (np.abs(plant.q - way) < bound * np.abs(c / MASSES)).all()


def test_a_limited_rate_is_a_ramp() -> None:
    """Check R t up to the command, which is reached within a period; the impulse is exact."""
    rate, c = np.array([1100.0, 700.0]), np.array([3.0, -1.0])
    plant = robot(torque_rate_limit=rate.tolist())
    reached = np.abs(c) / rate
    for k in range(1, 10):
        plant.step(c.tolist())
        t = k * H
        assert plant.applied == pytest.approx(np.sign(c) * np.minimum(rate * t, np.abs(c)))
        ramp = np.minimum(t, reached)
        impulse = np.sign(c) * (0.5 * rate * ramp ** 2) + c * (t - ramp)
        assert plant.dq == pytest.approx(impulse / MASSES, abs=1e-14)
    assert (reached % H > 1e-4).all()


@pytest.mark.parametrize(('lag', 'rate'), [
    (5e-3, 800.0), (1e-3, 1e4), (2e-3, inf)])
def test_lag_and_limit_together_against_scipy(lag: float, rate: float) -> None:
    """Check dτ/dt = (c - τ) / T, within ±R, under a command that jumps at each sample."""
    plant = robot(actuator_lag=[lag, lag], torque_rate_limit=[rate, rate])
    x = np.zeros(6)
    limited = 0

    def field(t: float, x: Array, c: Array) -> Array:
        del t
        return np.concatenate([np.clip((c - x[:2]) / lag, -rate, rate), x[:2] / MASSES, x[2:4]])

    for c in commands(60, 1):
        plant.step(c)
        limited += np.abs(np.array(c) - x[0]).max() > rate * lag
        x = solve_ivp(field, (0, H), x, args=(np.array(c),), rtol=1e-9, atol=1e-12,
                      max_step=H / 50).y[:, -1]
        assert plant.applied == pytest.approx(x[:2], abs=1e-6)
        assert plant.dq == pytest.approx(x[2:4], abs=1e-8)
        assert plant.q == pytest.approx(x[4:], abs=3e-8)
    assert (limited > 10) == (rate < inf)


def test_break_away_as_the_torque_rises() -> None:
    """Check rest until c (1 - exp(-t/T)) = Kf, within a period, and the velocity afterwards."""
    lag, c, kf, mass = 4e-3, 5.0, 3.1, MASSES[0]
    go = -lag * log(1.0 - kf / c)
    plant = robot(actuator_lag=[lag, lag], coulomb_friction=[kf, 9.9])
    for k in range(1, 21):
        plant.step([c, 5.0])
        t = k * H
        if t < go:
            assert list(plant.q) == list(plant.dq) == [0.0, 0.0]
        else:
            v = ((c - kf) * (t - go) + c * lag * (exp(-t / lag) - exp(-go / lag))) / mass
            assert plant.dq[0] == pytest.approx(v, abs=1e-7)
    assert 0.2 < go / H % 1.0 < 0.9
    assert plant.dq[0] > 5e-3
    assert plant.q[1] == 0.0


def test_resolution_of_the_torque() -> None:
    """Check the nearest multiple, joint by joint; the limit comes after, the delay before."""
    plant = robot(torque_resolution=[0.25, 0.0], torque_saturation=[4.1, inf],
                  input_delay=1)
    other = robot()
    for sent, c in pairwise(commands(100, 3)):
        plant.step(c)
        if plant.k == 1:
            continue
        expected = [float(np.clip(0.25 * np.round(sent[0] / 0.25), -4.1, 4.1)), sent[1]]
        assert list(plant.applied) == expected
        other.step(expected)
        assert list(plant.dq) == list(other.dq)

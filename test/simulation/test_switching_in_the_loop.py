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

"""The sampled loop's limits: h -> 0, no perturbation, a constant perturbation."""

from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.simulation.closed_loop import Run, run_closed_loop
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
import numpy as np
from oracles import Array, Masses, paper_m
import pytest

IMPLICIT = ['implicit', 'implicit_observer']
FREE = {'coulomb_friction': [0.0, 0.0]}


def _run(switching: str, h: float, duration: float, plant: dict[str, Any] | None = None,
         **controller: Any) -> Run:
    return run_closed_loop(
        PlantConfig.from_mapping({'control_period': h, 'duration': duration, **(plant or {})}),
        ControllerConfig.from_mapping(
            {'control_period': h, 'switching': switching, **controller}),
        ReferenceConfig(control_period=h))


def _held(run: Run, h: float) -> Array:
    """
    Return what v, wanted at 0, is a sample later for torque and filter being held: of order h².

    While v rests, dde = -u with u = Kv de + Kp e at the sample, and then moves away from it at the
    rate M⁻¹ dτ/dt - du/dt, which over half a period, integrated, makes -h/2 (M⁻¹ Δτ - Δu).
    """
    u = 50.0 * (run.dq_d - run.dq) + 100.0 * (run.q_d - run.q)
    rows = []
    for k in range(1, len(run.t) - 1):
        tau_rate, u_rate = (run.tau[k + 1] - run.tau[k - 1]) / 2, (u[k + 1] - u[k - 1]) / 2
        rows.append(-h / 2 * (np.linalg.solve(paper_m(run.q[k].tolist()), tau_rate) - u_rate))
    return np.array(rows)


def _reached(run: Run, band: float) -> int:
    """Return the first sample from which |v| stays within the band."""
    outside = np.flatnonzero(np.abs(run.v).max(axis=1) > band)
    return int(outside[-1]) + 1 if len(outside) else 0


@pytest.mark.parametrize('velocity', [
    pytest.param([0.0, 0.0], marks=pytest.mark.slow), [6.0, -4.0]])
def test_without_a_perturbation_v_reaches_zero_and_stays(velocity: list[float]) -> None:
    """
    Check the theorem's time, 2 √V(0) / (ka k) and a few samples, into a band of order h².

    λ is small, so that the filter's own decay does not do the work; sign's band is of order h.
    """
    alpha, mass = np.linalg.norm(paper_m([0.0, 0.0]), 2), paper_m([0.0, 0.0])
    v0 = np.array(velocity) - np.pi
    bound = 2 * np.sqrt(0.5 * v0 @ mass @ v0) / (10.0 * np.sqrt(2 / alpha))
    bands: dict[str, list[float]] = {name: [] for name in ['sign', *IMPLICIT]}
    for h in (2e-3, 1e-3):
        for name, found in bands.items():
            run = _run(name, h, 2.2 + bound, {**FREE, 'initial_velocity': velocity},
                       **{'lambda': 0.1})
            after = run.t > bound + 1.0
            found.append(float(np.abs(run.v[after]).max()))
            if name == 'implicit':
                assert _reached(run, 1000.0 * h * h) * h <= bound + 5 * h
                np.testing.assert_allclose(
                    run.v[2:][after[2:]], _held(run, h)[after[2:]], atol=0.02 * found[-1])
            elif name == 'sign':
                assert _reached(run, 1000.0 * h * h) > len(run.t) - 50
    sign, plain, observed = (np.array(bands[name]) for name in ['sign', *IMPLICIT])
    assert plain[:-1] / plain[1:] == pytest.approx([4.0], rel=0.05)
    assert (observed[:-1] / observed[1:] > 3.8).all()
    assert sign[:-1] / sign[1:] == pytest.approx([2.0], rel=0.25)
    assert plain[1] < 2e-4
    assert observed[1] < 5e-6
    assert sign[1] > 0.015


def _pulled(switching: str, force: list[float], h: float = 1e-3, b: float = 1.0,
            friction: tuple[float, float] = (0.0, 0.0)) -> tuple[Array, Array]:
    """
    Return v of all samples and M⁻¹ F: two coupled masses on a ramp, in the plant itself.

    The ramp goes forwards on joint 1 and backwards on joint 2; `friction` is the Coulomb friction.
    """
    mass = np.array([[2.0, 0.7], [0.7, 0.5]])
    model, speed = Masses(mass.tolist()), np.array([1.0, -0.7])
    plant = Plant(PlantConfig(control_period=h, coulomb_friction=friction,
                              initial_velocity=(1.0, -0.7)), model)
    law = Controller(ControllerConfig(switching=switching, control_period=h, b=b), model)
    v = []
    for k in range(800):
        s = law.step(plant.q, plant.dq, (speed * k * h).tolist(), speed.tolist(), [0.0, 0.0])
        v.append(s.v)
        plant.step([t - f for t, f in zip(s.tau, force)])
    total = np.array(force) + np.array(friction) * np.sign(speed)
    return np.array(v), np.linalg.solve(mass, total)


@pytest.mark.parametrize(('h', 'b', 'force', 'friction'), [
    (1e-3, 1.0, [5.0, -3.0], (0.0, 0.0)), (1e-3, 0.5, [0.0, 0.0], (6.0, 4.0)),
    (4e-3, 1.0, [2.0, 2.0], (3.0, 1.0)), (4e-3, 0.5, [5.0, -3.0], (0.0, 0.0))])
def test_a_constant_perturbation_on_a_ramp(
        h: float, b: float, force: list[float], friction: tuple[float, float]) -> None:
    """Check that v rests at -b h M⁻¹ F exactly, and with the observer at 0, soon and for good."""
    v, pull = _pulled('implicit', force, h, b, friction)
    np.testing.assert_allclose(v[100:], [-b * h * pull] * 700, atol=1e-9)
    assert np.abs(v[-1]).max() > 1e-3 * b
    observed, _ = _pulled('implicit_observer', force, h, b, friction)
    assert np.abs(observed[100:]).max() < 1e-9
    rattling, _ = _pulled('sign', force, h, b, friction)
    assert np.abs(rattling[100:]).max() > 2 * b * h * np.abs(pull).max()


def test_beyond_the_gain_v_leaves_zero() -> None:
    """Check the gain condition on both sides of ka = 10: the band h M⁻¹ F holds, and breaks."""
    for switching in IMPLICIT:
        v, pull = _pulled(switching, [9.5, 0.0])
        assert (np.abs(v[400:]) <= 1e-3 * np.abs(pull) + 1e-9).all()
        v, pull = _pulled(switching, [11.5, 0.0])
        assert (np.abs(v[400:]).max(axis=0) > 2e-3 * np.abs(pull)).any()

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

"""The known input delay: the predicted state, and the law for it."""

from functools import cache
import math
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.control.step import predict, State
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.simulation.closed_loop import Run, simulate
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
import numpy as np
from oracles import Array, estimate_of, Masses, paper_field, states
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]

H = 1e-3
MASS = np.array([[2.0, 0.7], [0.7, 0.5]])
Row = tuple[list[float], list[float], list[float]]


def _desired(k: int) -> Row:
    t, w = k * H, np.array([3.0, 5.0])
    return (np.sin(w * t).tolist(), (w * np.cos(w * t)).tolist(),
            (-w * w * np.sin(w * t)).tolist())


def _law(delay: int, switching: str, **values: Any) -> Controller:
    return Controller(ControllerConfig(
        switching=switching, input_delay=delay, ka=(5.0, 5.0), **values), Masses(MASS.tolist()))


def _move(q: Array, dq: Array, tau: Array) -> tuple[Array, Array]:
    """Return the state a period later: two coupled masses in closed form."""
    a = np.linalg.solve(MASS, tau)
    return q + H * dq + H * H / 2 * a, dq + H * a


@pytest.mark.parametrize('d', [1, 2, 5])
@pytest.mark.parametrize('switching', ['boundary_layer', 'implicit'])
def test_the_torque_is_the_undelayed_law_of_the_state_d_samples_later(
        switching: str, d: int) -> None:
    """
    Check tau of every sample where the prediction is exact: on two masses without gravity.

    The undelayed law watches the same motion, its first d torques not being applied.
    """
    late, prompt = _law(d, switching), _law(0, switching)
    start = np.array([0.1, -0.1]), np.array([3.3, 4.0])
    (q, dq), sent = start, []
    for k in range(600):
        ahead = [_desired(k + j) for j in range(1, d + 1)]
        sample = late.step(q.tolist(), dq.tolist(), *_desired(k), ahead)
        seen = prompt.step(q.tolist(), dq.tolist(), *_desired(k))
        sent.append(np.array(sample.tau))
        assert sample.v == seen.v
        if k >= d:
            np.testing.assert_allclose(sent[k - d], seen.tau, atol=1e-6)
        q, dq = _move(q, dq, sent[k - d] if k >= d else np.zeros(2))
    assert np.abs(sample.v).max() < 1e-3
    assert np.abs(np.subtract(sent[-1], sent[-1 - d])).max() > 0.05


@cache
def _run(switching: str, plant_delay: int, known: int, duration: float = 3.0) -> Run:
    return simulate(
        PlantConfig(duration=duration, input_delay=plant_delay, coulomb_friction=(0.0, 0.0)),
        ControllerConfig(switching=switching, input_delay=known), ReferenceConfig(), truth=True)


def _rest(run: Run) -> float:
    return float(np.abs(run.v[run.t >= 1.5]).max())


@pytest.mark.parametrize('d', [1, 3])
def test_implicit_does_as_well_as_without_delay(d: int) -> None:
    """Check the arm: |v| within 1 % of the undelayed loop, and 30 times that if unpredicted."""
    prompt, known, unknown = (
        _rest(_run('implicit', *delays)) for delays in ((0, 0), (d, d), (d, 0)))
    assert prompt < 1e-4
    assert known == pytest.approx(prompt, rel=0.01)
    assert unknown > 30 * d ** 0.5 * known


@pytest.mark.parametrize(('switching', 'd', 'bound', 'factor'), [
    ('implicit_observer', 1, 1e-4, 300.0), ('implicit_observer', 3, 3e-4, 250.0),
    ('sign', 1, 2.1e-2, 2.0), ('sign', 3, 2.1e-2, 4.5)])
def test_prediction_helps_the_others_too(
        switching: str, d: int, bound: float, factor: float) -> None:
    """
    Check |v| of the predicted loop, and that the unpredicted one is worse by a factor.

    The observer's estimate is d samples old when it is used, which adds d h² M⁻¹ dP/dt.
    """
    known, unknown = _rest(_run(switching, d, d)), _rest(_run(switching, d, 0))
    assert known < bound
    assert unknown > factor * known


def test_tracking_as_well_as_the_undelayed_loop() -> None:
    """Check e, from d samples after the start on: they differ by what was lost at the start."""
    prompt, late = _run('implicit', 0, 0, 4.0), _run('implicit', 2, 2, 4.0)
    e, e_late = (run.q_d - run.q for run in (prompt, late))
    gap = np.abs(e - e_late).max(axis=1)
    assert gap[:100].max() < 0.02  # π rad/s for two samples, with overshoot
    assert gap[-1] < 1e-4  # and decays with Kv, Kp like e itself
    assert np.abs(e[-1]).max() < 1e-2


@pytest.mark.parametrize(('law', 'switching'), [
    ('compensation', 'sign'), ('chattering', 'sign'), ('chattering', 'boundary_layer'),
    ('chattering', 'implicit')])
def test_torques_sent_by_another_law_have_no_cut(law: str, switching: str) -> None:
    """
    Check that the observer, switched back on, knows that its bound cut nothing off these.

    Kicks make its own torques cut before; afterwards P̂ = P after two samples of exact dynamics.
    """
    rng, force = np.random.default_rng(0), np.array([2.0, -1.0])
    made = _law(1, 'implicit_observer', observer_bandwidth=math.inf)
    q, dq, coming = np.zeros(2), np.zeros(2), np.zeros(2)
    rest = ([0.0, 0.0], [0.0, 0.0], [0.0, 0.0])
    for k in range(60):
        if k % 20 == 13:
            made.configure(made.config.changed({'switching': switching, 'law': law}))
        if k % 20 == 17:
            made.configure(made.config.changed(
                {'switching': 'implicit_observer', 'law': 'chattering'}))
        if k % 20 < 13:
            dq = dq + rng.normal(size=2) * 5e-3
        tau = made.step(q.tolist(), dq.tolist(), *rest, [rest]).tau
        if k % 20 == 18:
            np.testing.assert_allclose(estimate_of(made), force, atol=1e-7)
        q, dq = _move(q, dq, coming - force)
        coming = np.array(tau)


@pytest.mark.parametrize('d', [1, 3])
def test_the_estimate_is_part_of_the_prediction(d: int) -> None:
    """Check v = 0 under a constant force and a delay; `implicit` rests beside it, at h M⁻¹ F."""
    force, ends = np.array([3.0, -2.0]), {}
    for switching in ('implicit', 'implicit_observer'):
        law = _law(d, switching)
        q, dq, coming = np.zeros(2), np.zeros(2), [np.zeros(2)] * d
        rest = ([0.0, 0.0], [0.0, 0.0], [0.0, 0.0])
        for _ in range(3000):
            sample = law.step(q.tolist(), dq.tolist(), *rest, [rest] * d)
            coming.append(np.array(sample.tau))
            q, dq = _move(q, dq, coming.pop(0) - force)
        ends[switching] = np.array(sample.v)
    assert np.abs(ends['implicit_observer']).max() < 1e-8
    assert (np.abs(ends['implicit']) > 0.5 * H * np.abs(np.linalg.solve(MASS, force))).all()


TORQUES = ([0.0, 0.0], [150.0, -20.0], [-60.0, 35.0])


def _exact(q: list[float], dq: list[float], tau: list[float], h: float) -> Array:
    end: Array = solve_ivp(paper_field(tau), (0, h), [*q, *dq], method='DOP853', rtol=1e-13,
                           atol=1e-13).y[:, -1]
    return end


def _predicted(model: Model, q: Array, dq: Array, u: Array, h: float) -> tuple[Array, Array]:
    M, C, G = model.evaluate(q, dq)
    zero = np.zeros(2)
    return predict(model, State(
        q, dq, zero, zero, zero, zero, zero, zero, M, C, G, C.dot(dq) + G, zero, zero), u, h)


def _error(q: list[float], dq: list[float], tau: list[float], h: float) -> float:
    made = _predicted(TwoLink(), np.array(q), np.array(dq), np.array(tau), h)
    return float(np.linalg.norm(np.concatenate(made) - _exact(q, dq, tau, h)))


@pytest.mark.parametrize('tau', TORQUES)
def test_one_period_against_scipy(tau: list[float]) -> None:
    """Check random states at 1 kHz: far nearer to the exact state than standing still is."""
    for q, dq in states(10):
        made = np.concatenate(_predicted(
            TwoLink(), np.array(q), np.array(dq), np.array(tau), 1e-3))
        exact = _exact(q, dq, tau, 1e-3)
        np.testing.assert_allclose(made, exact, atol=1e-5)
        assert np.abs(exact - [*q, *dq]).max() > 1e-3


def test_third_order_of_one_period() -> None:
    """Check that the error of one period falls 8-fold when h is halved."""
    ratios = []
    for (q, dq), tau in zip(states(12, seed=3), TORQUES * 4):
        errors = [_error(q, dq, tau, h) for h in (4e-3, 2e-3, 1e-3)]
        ratios += [errors[0] / errors[1], errors[1] / errors[2]]
    assert np.median(ratios) == pytest.approx(8.0, rel=0.03)
    assert min(ratios) > 6.0
    assert max(ratios) < 10.0


def test_constant_acceleration_is_exact() -> None:
    """Check the closed form for two coupled masses, however long the period."""
    mass = np.array([[2.0, 0.7], [0.7, 0.5]])
    q, dq, u = np.array([1.0, -2.0]), np.array([0.3, 0.4]), np.array([3.0, -5.0])
    a = np.linalg.solve(mass, u)
    for h in (1e-3, 2.0):
        made_q, made_dq = _predicted(Masses(mass.tolist()), q, dq, u, h)
        np.testing.assert_allclose(made_q, q + h * dq + h * h / 2 * a, rtol=1e-13)
        np.testing.assert_allclose(made_dq, dq + h * a, rtol=1e-13)

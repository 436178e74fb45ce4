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

"""Each law against its equations written out in numpy, and the bounds that its page names."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.control.laws.pid_kalman import kalman_gains
from laws import B, error, GAINS, H, inputs, KP, KV, LAMBDA, rattles, run, Terms
import numpy as np
from oracles import Array, paper_m
import pytest
from scipy.optimize import brentq  # type: ignore[import-untyped]

MOST = np.array([150.0, 20.0])


class FilterByHand:
    """The filter (3), as the paper has it, exact for its pole."""

    def __init__(self) -> None:
        self.xi = np.zeros(2)

    def output(self, x: Terms) -> Array:
        """Return v."""
        v: Array = self.xi - B * x.de
        return v

    def advance(self, x: Terms) -> None:
        """Go on by a period."""
        decay = math.exp(-LAMBDA * H)
        bracket = B * ((LAMBDA * np.eye(2) - KV) @ x.de - KP @ x.e)
        self.xi = decay * self.xi + (1.0 - decay) / LAMBDA * bracket


def check_by_hand(law: str, step: Callable[[Terms], Array], size: float = 0.3, **values: Any
                  ) -> None:
    """Compare 200 torques with those of `step`, which is called once a sample, to 1e-10."""
    rng = np.random.default_rng(5)
    controller = Controller(ControllerConfig.from_mapping({'law': law, **GAINS, **values}))
    for _ in range(200):
        rows = inputs(rng, size)
        np.testing.assert_allclose(
            controller.step(*rows).tau, step(Terms(rows)), rtol=1e-10, atol=1e-10)


#: 1.33, the largest eigenvalue of M⁻¹ diag(D), 1 / D the diagonal of M⁻¹.
_INVERSE = np.linalg.inv(paper_m([np.pi, np.pi / 2]))
_EIGENVALUE = float(np.linalg.eigvals(_INVERSE / np.diag(_INVERSE)).max())
#: Values on both sides of a bound: below it the loop is calm, above it rattles or diverges.
BOUNDS: list[tuple[str, dict[str, Any], dict[str, Any], dict[str, Any]]] = [
    ('compensation', {'kv': 1900.0}, {'kv': 2100.0}, {}),  # c h Kv < 2, with M̂ = c M
    ('friction_feedforward', {'kv': 900.0}, {'kv': 1100.0}, {'inertia_scale': 2.0}),
    ('momentum_observer', {'inertia_scale': 1.9}, {'inertia_scale': 2.3},  # c < 2.1
     {'momentum_gain': 3000.0}),
    ('super_twisting', {'inertia_scale': 1.8}, {'inertia_scale': 2.2}, {}),
    ('slotine_li', {'adaptation_gain': [100.0, 1.65e4]},  # h Γ < K, about 0.55 · 50 N·m·s/rad
     {'adaptation_gain': [100.0, 5.5e4]}, {}),
    ('pd_gravity', {'kv': 1900.0 / _EIGENVALUE}, {'kv': 2100.0 / _EIGENVALUE},
     {'amplitude': 0.0, 'offset': 0.05, 'friction': 0.0})]


@pytest.mark.parametrize(('law', 'calm', 'wild', 'more'), BOUNDS, ids=lambda x: str(x)[:40])
def test_a_bound_from_both_sides(law: str, calm: dict[str, Any], wild: dict[str, Any],
                                 more: dict[str, Any]) -> None:
    assert rattles(law, calm, wild, duration=1.5, **more)


#: A law, its values, and how much smaller its error is than that of other values.
BETTER: list[tuple[str, dict[str, Any], str, dict[str, Any], float]] = [
    ('friction_feedforward', {'friction_level': 9.9}, 'compensation', {}, 0.2),
    ('integral', {'kv': 300.0, 'kp': 3e4, 'ki': 1e6}, 'integral',
     {'kv': 300.0, 'kp': 3e4, 'ki': 0.0}, 0.6),
    ('momentum_observer', {'momentum_gain': 50.0}, 'compensation', {}, 0.5),
    ('momentum_observer', {'momentum_gain': 300.0}, 'momentum_observer',
     {'momentum_gain': 50.0}, 0.5),
    ('super_twisting', {}, 'compensation', {}, 0.1)]


@pytest.mark.parametrize(('law', 'values', 'than', 'others', 'factor'), BETTER)
def test_the_error_under_friction_shrinks(law: str, values: dict[str, Any], than: str,
                                          others: dict[str, Any], factor: float) -> None:
    found, other = error(run(law, 2.0, **values)), error(run(than, 2.0, **others))
    assert (found < factor * other).all()


@pytest.mark.parametrize(('law', 'values'), [
    ('integral', {}), ('pid_kalman', {'estimator_bandwidth': 300.0})])
def test_an_integral_does_not_wind_up(law: str, values: dict[str, Any]) -> None:
    """Check the error after a second at the limit: without anti-windup it is far larger."""
    good, bad = (error(run(
        law, 3.0, 0.0, 0.5, 0.0, anti_windup=on, kv=60.0, kp=1200.0, ki=8000.0,
        effort_limit=[60.0, 10.0], **values)) for on in (True, False))
    assert (good < 0.05 * bad).all()


@pytest.mark.parametrize('anti_windup', [True, False])
def test_integral_by_hand(anti_windup: bool) -> None:
    """Check that x tracks M⁻¹ times what is cut off, within the integral time Kp / Ki."""
    x, cuts, ki = np.zeros(2), 0, np.array([300.0, 900.0])

    def step(at: Terms) -> Array:
        nonlocal x, cuts
        wanted = at.computed_torque + at.M @ x
        tau: Array = np.clip(wanted, -MOST, MOST)
        cuts += int((wanted != tau).any())
        x = x + H * ki * at.e
        if anti_windup:
            part = 1.0 - np.exp(-H * ki / np.diag(KP))
            x = x - part * np.linalg.solve(at.M, wanted - tau)
        return tau

    check_by_hand('integral', step, ki=ki.tolist(), effort_limit=MOST.tolist(),
                  anti_windup=anti_windup)
    assert cuts > 100


def test_momentum_observer_by_hand() -> None:
    """
    Check the residual of the momentum, filtered, in the torque; C enters transposed.

    It is that of the torque that was sent, so that a limit does not wind the estimate up.
    """
    gain, estimate, before, cuts = 150.0, np.zeros(2), None, 0

    def step(at: Terms) -> Array:
        nonlocal estimate, before, cuts
        p, beta = at.M @ at.dq, at.C.T @ at.dq - at.G
        if before is not None:
            found = before[2] + (before[1] + beta) / 2.0 - (p - before[0]) / H
            estimate = estimate + (1.0 - math.exp(-gain * H)) * (found - estimate)
        wanted = at.computed_torque + estimate
        tau: Array = np.clip(wanted, -10.0 * MOST, 10.0 * MOST)
        cuts += int((wanted != tau).any())
        before = p, beta, tau
        return tau

    check_by_hand('momentum_observer', step, momentum_gain=gain,
                  effort_limit=(10.0 * MOST).tolist())
    assert 20 < cuts < 180


def test_pd_gravity_by_hand() -> None:
    """Check diag(D) (Kp e + Kv de) + G, 1 / D the diagonal of M⁻¹."""
    def step(at: Terms) -> Array:
        inertia = np.diag(1.0 / np.diag(np.linalg.inv(at.M)))
        tau: Array = inertia @ (KP @ at.e + KV @ at.de) + at.G
        return tau

    check_by_hand('pd_gravity', step)


@pytest.mark.parametrize('size', [1e-3, 0.3])
def test_super_twisting_by_hand(size: float) -> None:
    """
    Check τ = N - M a, a = k1 √|v⁺| sgn(v⁺) + w⁺, w⁺ - w ∈ h k2 Sgn(v⁺), with a root finder.

    v⁺ is the next v of (S) without a perturbation: y - b h a.
    """
    k1, k2 = np.array([20.0, 35.0]), np.array([400.0, 900.0])
    filter_, w, rests = FilterByHand(), np.zeros(2), 0

    def step(at: Terms) -> Array:
        nonlocal rests
        v = filter_.output(at)
        decay = math.exp(-LAMBDA * H)
        y = decay * v + B * (H - (1.0 - decay) / LAMBDA) * (KV @ at.de + KP @ at.e)
        a = np.zeros(2)
        for i in range(2):
            def gap(x: float, xi: float, i: int = i) -> float:
                return float(x + B * H * (k1[i] * math.sqrt(abs(x)) * np.sign(x) + w[i]
                                          + H * k2[i] * xi) - y[i])
            if gap(0.0, -1.0) <= 0.0 <= gap(0.0, 1.0):
                xi, ahead, rests = (y[i] / (B * H) - w[i]) / (H * k2[i]), 0.0, rests + 1
            else:
                xi = 1.0 if gap(0.0, 1.0) < 0.0 else -1.0
                root = brentq(lambda s: gap(s * abs(s), xi), -1e3, 1e3, xtol=1e-15, rtol=1e-15)
                ahead = root * abs(root)
            w[i] = w[i] + H * k2[i] * xi
            a[i] = k1[i] * math.sqrt(abs(ahead)) * np.sign(ahead) + w[i]
        filter_.advance(at)
        tau: Array = at.computed_torque - at.M @ a
        return tau

    check_by_hand('super_twisting', step, size, super_twisting_k1=k1.tolist(),
                  super_twisting_k2=k2.tolist())
    assert (rests > 20) == (size < 0.1)


@pytest.mark.parametrize('anti_windup', [True, False])
def test_slotine_li_by_hand(anti_windup: bool) -> None:
    """Check the law in terms of dq_r and s; joints at their limit do not adapt."""
    gamma, width, slope = np.array([150.0, 40.0]), 0.3, np.linalg.inv(KV) @ KP
    level, frozen = np.array([2.0, 3.0]), 0

    def step(at: Terms) -> Array:
        nonlocal level, frozen
        dq_r, ddq_r = at.dq_d + slope @ at.e, at.ddq_d + slope @ at.de
        s, y = dq_r - at.dq, np.tanh(dq_r / width)
        damping = np.diag(1.0 / np.diag(np.linalg.inv(at.M))) @ KV
        wanted = at.M @ ddq_r + at.C @ dq_r + at.G + damping @ s + level * y
        cut = (np.abs(wanted) > MOST) & anti_windup
        frozen += int(cut.sum())
        level = np.maximum(level + np.where(cut, 0.0, H * gamma * y * s), 0.0)
        tau: Array = np.clip(wanted, -MOST, MOST)
        return tau

    check_by_hand('slotine_li', step, 1.0, adaptation_gain=gamma.tolist(), friction_velocity=width,
                  friction_level=level.tolist(), effort_limit=MOST.tolist(),
                  anti_windup=anti_windup)
    assert (frozen > 50) == anti_windup


@pytest.mark.parametrize('bandwidth', [0.1, 2.0])
def test_the_kalman_gains_are_those_of_the_filter_after_many_samples(bandwidth: float) -> None:
    """Check against the covariance, sample by sample, from a large one on."""
    A = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    G, C = np.array([1.0 / 6.0, 0.5, 1.0]), np.array([1.0, 0.0, 0.0])
    variance = 1e3 * np.eye(3)
    for _ in range(400):
        gain = variance @ C / (C @ variance @ C + 1.0)
        variance = A @ (variance - np.outer(gain, C @ variance)) @ A.T + (
            bandwidth ** 6 * np.outer(G, G))
    np.testing.assert_allclose(kalman_gains(bandwidth), gain, rtol=1e-8)

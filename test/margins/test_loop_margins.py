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

"""Margins, against the controller itself on robots written here, and closed forms."""

from __future__ import annotations

from collections.abc import Iterable
import dataclasses
from math import exp

from ctc_chattering.control.controller import Controller
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.margins.linear_law import Frozen
from ctc_chattering.margins.loop_margins import stable_range
from ctc_chattering.numerics.linear_algebra import Array
from margin_loops import LAG, loops, REAL_ARM
import numpy as np
import pytest
from scipy.linalg import expm  # type: ignore[import-untyped]

#: A model of two joints that are coupled [kg·m²].
MASS = np.array([[3.0, 0.8], [0.8, 0.5]])
#: Period [s].
H = 1e-3


def period(inverse: Array, lag: float) -> Array:
    """Return q, dq and torque a period later, shape (6, 8), of those and the command."""
    two, flow = np.eye(2), np.zeros((8, 8))
    flow[:2, 2:4], flow[2:4, 4:6] = two, inverse
    flow[4:6, 4:6], flow[4:6, 6:] = -two / lag, two / lag
    found: Array = expm(H * flow)[:6]
    return found


def errors(config: ControllerConfig, periods: Iterable[Array]) -> Array:
    """Return |e| of each sample of a robot whose periods are given, in a motion of 1 rad/s."""
    controller, found = Controller(config, Frozen(MASS)), []
    x, transit = np.array([1e-9, 0.0, 1.0, 1.0, 0.0, 0.0]), [np.zeros(2)] * config.input_delay
    for k, each in enumerate(periods):
        q, dq, *_ = x.reshape(3, 2).tolist()
        points = [([H * (k + j)] * 2, [1.0, 1.0], [0.0, 0.0]) for j in range(len(transit) + 1)]
        sample = controller.step(q, dq, *points[0], ahead=points[1:])
        transit.append(np.array(sample.tau))
        x = each @ np.concatenate([x, transit.pop(0)])
        found.append(float(np.abs(x[:2] - H * (k + 1)).max()))
    return np.array(found)


def robot(ratios: Array, rng: np.random.Generator) -> Array:
    """Return M⁻¹ such that M̂ M⁻¹ has these eigenvalues, in random directions."""
    half = np.linalg.inv(np.linalg.cholesky(MASS))
    turn, _ = np.linalg.qr(rng.standard_normal((2, 2)))
    inverse: Array = half.T @ turn @ np.diag(ratios) @ turn.T @ half
    return inverse


def test_poles_are_the_growth_of_the_controller_itself() -> None:
    """Within the bounds of one eigenvalue errors decay, beyond them they grow, at that rate."""
    found, config = loops(REAL_ARM, LAG, 1), ControllerConfig().changed(REAL_ARM)
    span, rng = found.ratios(), np.random.default_rng(1)
    assert span is not None
    for worst, grows in ((1.08 * span.high, True), (0.92 * span.high, False),
                         (0.9 * span.low, True)):
        e = errors(config, [period(robot(np.array([worst, 1.0]), rng), LAG)] * 200)
        rate = (e[150:].max() / e[80:130].max()) ** (1.0 / 70.0)
        assert (rate > 1.0) == grows
        assert rate == pytest.approx(found.radius(worst), abs=5e-3)


def test_errors_that_vary_within_the_guarantee_decay() -> None:
    """A robot that is another one at each sample, at the ends of what is guaranteed."""
    found, config = loops(REAL_ARM, LAG, 1), ControllerConfig().changed(REAL_ARM)
    span, exact, rng = found.guaranteed(), found.ratios(), np.random.default_rng(2)
    assert span is not None
    assert exact is not None
    assert exact.low < span.low < 0.8 < 1.25 < span.high < exact.high
    e = errors(config, [period(robot(np.where(rng.random(2) < 0.5, *span), rng), LAG)
                        for _ in range(200)])
    assert e[-30:].max() < 1e-2 * e[:30].max()


@pytest.mark.parametrize(('switching', 'bandwidth', 'most'), [
    ('implicit', 1.0, 2.0), ('implicit_observer', 200.0, 4.0 / (3.0 - exp(-0.2)))])
def test_bounds_that_have_a_closed_form(switching: str, bandwidth: float, most: float) -> None:
    """docs/theory.md has those of the paper's term, for slow gains and filter."""
    span = loops({'switching': switching, 'observer_bandwidth': bandwidth, 'kp': [1e-2] * 2,
                  'kv': [0.2] * 2, 'lambda': 1e-2}).ratios()
    assert span is not None
    assert span.high == pytest.approx(most, rel=2e-3)


def largest_root(c: float, ratio: float) -> float:
    """Return the largest real part of a root of (SO4), in units of p."""
    exact = np.poly([-1.0] * 2 + [-ratio] * 3)
    more = [(ratio + 6.0) * ratio + 3.0, (2.0 * ratio + 3.0) * ratio, ratio ** 2]
    return float(np.roots(exact + (c - 1.0) * ratio * np.array([0.0] * 3 + more)).real.max())


@pytest.mark.parametrize('ratio', [1.0, 2.0, 4.0])
def test_without_a_slope_the_bounds_are_those_of_the_polynomial(ratio: float) -> None:
    """(SO4) is of continuous time, so the law is slow; with a slope it tolerates less."""
    slow = {'law': 'observer_feedback', 'kp': [400.0] * 2, 'kv': [40.0] * 2,
            'estimator_bandwidth': 20.0 * ratio, 'ka': [1e6] * 2, 'actuator_lag': [0.0] * 2}
    span = loops({**slow, 'estimator_slope': False}).ratios()
    with_slope = loops(slow).ratios()
    assert span is not None
    assert with_slope is not None
    for c in span:
        assert largest_root(0.97 * c, ratio) * largest_root(1.03 * c, ratio) < 0.0
    assert largest_root(1.0, ratio) < 0.0
    assert span.low < with_slope.low < with_slope.high < span.high


def test_lags_and_delays() -> None:
    found = loops(REAL_ARM, LAG, 1)
    span = found.lags()
    assert span is not None
    assert span.low == 0.0
    for part, grows in ((0.99, False), (1.01, True)):
        slow = dataclasses.replace(found, lag=np.array([part * span.high]))
        assert (slow.radius() > 1.0) == grows
    assert 1 in found.delays()
    assert 9 not in found.delays()
    assert stable_range(lambda x: abs(x), 2.0, np.array([0.0, 2.0])) is None

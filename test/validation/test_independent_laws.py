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

"""The package's laws beside programs written by hand from their docs; what counts as worse."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.runs.conditions import Case
from ctc_chattering.runs.recommended import recommended_setup
from held_out_study import verdict
from imperfections import case_setup
from independent_laws import Array, Gains, Known, ObserverFeedback, Point, Sliding
from independent_rivals import RIVALS
import numpy as np
import pytest
from rigid_bodies import dynamics, PAPER, planar

DRIVES = {
    'known': Known(), 'model too light': Known(scale=0.9),
    'slow': Known(1.1, 5e-4, 3, (4e-3, 1e-3), (300.0, 150.0)),
    'one has a lag': Known(lag=(0.0, 2e-3)),
    'ideal': Known(delay=0, lag=(0.0, 0.0), rate=(inf, inf))}


#: Parameters of the rivals that are not at their defaults.
_FRICTION = {'friction_level': [9.0, 10.0], 'friction_velocity': 0.3}
NUMBERS: dict[str, dict[str, Any]] = {
    'compensation': {'lambda': 12.0, 'b': 1.5}, 'integral': {'ki': [2e4, 1e4]},
    'friction_feedforward': _FRICTION, 'slotine_li': {**_FRICTION, 'adaptation_gain': [20.0, 9.0]},
    'pid_kalman': {**_FRICTION, 'ki': [2e4, 1e4], 'estimator_bandwidth': 150.0,
                   'friction_lead': 4e-3, 'lead_ratio': 0.4},
    'extended_state_observer': {**_FRICTION, 'ka': [60.0, 30.0], 'estimator_bandwidth': 150.0,
                                'friction_lead': 4e-3}}


def of_the_package(law: str, known: Known, numbers: dict[str, Any]) -> Controller:
    """Return the package's controller with the same parameters."""
    return Controller(ControllerConfig.from_mapping({
        'law': law, **numbers, 'control_period': known.period, 'actuator_lag': list(known.lag),
        'torque_rate_limit': list(known.rate), 'input_delay': known.delay,
        'inertia_scale': known.scale, 'gravity_scale': known.scale, 'compiled': False}))


def numbers_of(gains: Gains) -> dict[str, Any]:
    """Return gains as parameters of the package."""
    return {name: 2 * [x] if name in ('kp', 'kv') else x
            for name, x in gains._asdict().items() if name != 'guarded'}


def motion(rng: np.random.Generator, period: float) -> Callable[[int], Point]:
    """Return a random motion by samples."""
    centre, size, w = rng.uniform(-2, 2, 2), rng.uniform(0.02, 0.4, 2), rng.uniform(3, 25, 2)
    phase = rng.uniform(0.0, 6.0, 2)
    return lambda k: Point(
        centre + size * np.sin(phase + w * k * period), size * w * np.cos(phase + w * k * period),
        -size * w * w * np.sin(phase + w * k * period))


def check(law: Controller, hand: Any, known: Known, rng: np.random.Generator, size: float
          ) -> None:
    """Compare torques of a few samples from a random state, with errors of `size`, to 1e-9."""
    at, offset = motion(rng, known.period), size * rng.normal(size=2)
    for k in range(5):
        points = [at(k + j) for j in range(known.delay + 1)]
        q: Array = points[0].q + offset + 0.01 * size * rng.normal(size=2)
        dq = points[0].dq + size * rng.normal(size=2)
        first, *ahead = ((x.q.tolist(), x.dq.tolist(), x.ddq.tolist()) for x in points)
        tau = law.step(q.tolist(), dq.tolist(), *first, ahead).tau
        np.testing.assert_allclose(tau, hand.step(q, dq, points), rtol=1e-9, atol=1e-8)


@pytest.mark.parametrize('drives', DRIVES)
def test_torques_are_those_of_a_program_by_hand(drives: str) -> None:
    rng, known = np.random.default_rng(24), DRIVES[drives]
    for size in (3e-1, 3e-2, 1e-2, 1e-3, 1e-4, 1e-5):
        gains = Gains(rng.uniform(50, 2e4), rng.uniform(10, 300), (60.0, 30.0),
                      rng.uniform(40, 250), 20.0, tuple(rng.uniform(0.0, 12.0, 2)), True)
        law = of_the_package('observer_feedback', known, numbers_of(gains))
        check(law, ObserverFeedback(known, gains), known, rng, size)


def test_a_loop_that_learns_and_loses_bandwidth_is_that_by_hand() -> None:
    """Compare 150 torques, on measurements with errors that reach every branch."""
    rng, known = np.random.default_rng(2), Known()
    gains = Gains(estimator_bandwidth=100.0, friction_level=(4.0, 4.0), guarded=True)
    law = of_the_package('observer_feedback', known, numbers_of(gains))
    hand = ObserverFeedback(known, gains)
    at, offset = motion(rng, known.period), np.array([0.02, -0.01])
    for k in range(150):
        points = [at(k), at(k + 1)]
        offset = 0.98 * offset + 1e-4 * rng.normal(size=2)
        q, dq = points[0].q + offset, points[0].dq
        now, then = ((x.q.tolist(), x.dq.tolist(), x.ddq.tolist()) for x in points)
        tau = law.step(q.tolist(), dq.tolist(), *now, [then]).tau
        np.testing.assert_allclose(tau, hand.step(q, dq, points), rtol=1e-6, atol=1e-6)
    assert hand.part < 0.7


def test_a_joint_that_rests_is_held_as_by_hand() -> None:
    """Compare torques while joints come to rest, are held, and are released by a push."""
    known = Known()
    gains = Gains(1e4, 200.0, (20.0, 10.0), 200.0, 20.0, (9.0, 4.0), True)
    law = of_the_package('observer_feedback', known, numbers_of(gains))
    hand = ObserverFeedback(known, gains)
    point, held = Point(np.array([1.0, 0.5]), np.zeros(2), np.zeros(2)), set()
    row = point.q.tolist(), [0.0, 0.0], [0.0, 0.0]
    for k in range(140):
        q = point.q + 1e-5 * np.array([3.0, -2.0]) + (2e-4 if k == 110 else 0.0)
        tau = law.step(q.tolist(), [0.0, 0.0], *row, [row]).tau
        np.testing.assert_allclose(tau, hand.step(q, point.dq, [point, point]), rtol=1e-9)
        held.add((k < 110, *hand.held.tolist()))
    assert {(True, True, True), (True, False, False), (False, False, False)} <= held


@pytest.mark.parametrize('rival', NUMBERS)
def test_rivals_are_those_of_a_program_by_hand(rival: str) -> None:
    rng = np.random.default_rng(25)
    for size, drives in zip((1e-1, 1e-2, 1e-4), ('known', 'slow', 'model too light')):
        known = DRIVES[drives]
        numbers = {**NUMBERS[rival], 'kp': [2e3] * 2, 'kv': [80.0] * 2}
        check(of_the_package(rival, known, numbers), RIVALS[rival](known, numbers), known, rng,
              size)


def test_the_law_that_docs_paper_tries() -> None:
    """It is `observer_feedback` without a horizon, within a wide box, and another with one."""
    known, gains, expected = Known(), Gains(ka=(1e6, 1e6)), []
    point = Point(np.array([0.3, 0.0]), np.zeros(2), np.zeros(2))
    for law in (ObserverFeedback(known, gains), Sliding(known, gains, np.inf),
                Sliding(known, gains, 0.1)):
        rng = np.random.default_rng(3)
        expected.append([law.step(point.q + 1e-3 * rng.normal(size=2), np.zeros(2), [point] * 2)
                         for _ in range(6)])
    np.testing.assert_allclose(expected[1], expected[0], rtol=1e-9, atol=1e-9)
    assert np.abs(np.subtract(expected[2], expected[0])).max() > 0.1


@pytest.mark.parametrize('h, lag, delay, pole', [
    (1e-3, 0.0, 0, 100.0), (1e-3, 2e-3, 1, 100.0), (1e-2, 0.0, 0, 40.0),
    (2e-3, 6e-3, 2, 100.0 / 3.0)])
def test_gains_follow_what_is_slow(h: float, lag: float, delay: int, pole: float) -> None:
    """Check p (T + h (1 + delay)) <= 0.4, and what is made of p."""
    case = Case('x', {'/**': {'control_period': h}, 'controller': {'input_delay': delay},
                      'plant': {'actuator_lag': [lag, lag], 'duration': 1.0}})
    config = recommended_setup(case_setup(case), 'observer_feedback').controller
    assert (config.kp[0], config.kv[0]) == pytest.approx((pole ** 2, 2.0 * pole))
    assert config.estimator_bandwidth == pytest.approx(2.0 * pole)
    setup = recommended_setup(case_setup(case), 'integral')
    p = 0.6 * pole
    assert (setup.controller.kp[0], setup.controller.kv[0], setup.controller.ki[0]
            ) == pytest.approx((3.0 * p ** 2, 3.0 * p, p ** 3))
    assert setup.reference.start_duration == 2.0


def test_bodies_of_the_paper_have_its_equations() -> None:
    mass, bias = np.empty((2, 2)), np.empty(2)
    for q, dq in np.random.default_rng(1).normal(size=(3, 2, 2)):
        dynamics(planar(*PAPER), q, dq, mass, bias)
        for mine, other in zip((mass, bias), Known().model(q, dq)):
            np.testing.assert_allclose(mine, other, rtol=1e-12)


def row(telling: str, diverged: float | None, *rms: float) -> dict[str, Any]:
    """Return a row of one condition."""
    return {'label': 'x', 'seed': 1, 'telling': telling, 'diverged': diverged, 'rms': list(rms),
            'condition': 'trapezoid', 'tripped': diverged and [0.5 * diverged, 1.0]}


def test_what_counts_as_worse() -> None:
    base = row('compensation', None, 0.1, 0.2)
    assert verdict(row('rough', 3.0), base) == 'diverged'
    assert verdict(row('rough', None, 0.01, 0.3), base) == 'worse'
    assert verdict(row('rough', None, 0.11, 0.2), base) == 'held'
    assert verdict(row('rough', None, 5.0, 5.0), row('compensation', 1.0)) == 'held'

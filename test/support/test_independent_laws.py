"""The package's `observer_feedback` beside the program that was written by hand from its docs."""

from __future__ import annotations

from collections.abc import Callable
from math import inf

from ctc_chattering.control.controller import Controller, ControllerConfig
from independent_laws import Array, Gains, Known, ObserverFeedback, Point
import numpy as np
import pytest

DRIVES = {
    'known': Known(), 'model too light': Known(scale=0.9), 'no lag': Known(1.2, 2e-3, 0, (0., 0.)),
    'slow': Known(1.1, 5e-4, 3, (4e-3, 1e-3), (300.0, 150.0)),
    'one has a lag': Known(lag=(0.0, 2e-3)),
    'no rate limit': Known(lag=(1e-3, 1e-3), rate=(inf, inf)),
    'ideal': Known(delay=0, lag=(0.0, 0.0), rate=(inf, inf))}


def of_the_package(known: Known, gains: Gains) -> Controller:
    """Return the package's controller with the same parameters."""
    return Controller(ControllerConfig.from_mapping({
        'law': 'observer_feedback', 'kp': [gains.kp] * 2, 'kv': [gains.kv] * 2,
        'ka': list(gains.ka), 'estimator_bandwidth': gains.estimator_bandwidth,
        'friction_learning': gains.friction_learning, 'control_period': known.period,
        'friction_level': list(gains.friction_level), 'actuator_lag': list(known.lag),
        'torque_rate_limit': list(known.rate), 'input_delay': known.delay,
        'inertia_scale': known.scale, 'gravity_scale': known.scale, 'compiled': False}))


def motion(rng: np.random.Generator, period: float) -> Callable[[int], Point]:
    """Return a random motion by samples."""
    centre, size, w = rng.uniform(-2, 2, 2), rng.uniform(0.02, 0.4, 2), rng.uniform(3, 25, 2)
    phase = rng.uniform(0.0, 6.0, 2)
    return lambda k: Point(
        centre + size * np.sin(phase + w * k * period), size * w * np.cos(phase + w * k * period),
        -size * w * w * np.sin(phase + w * k * period))


@pytest.mark.parametrize('drives', DRIVES)
def test_torques_are_those_of_a_program_by_hand(drives: str) -> None:
    """Compare torques of a few samples from random states, errors and gains, to 1e-9."""
    rng, known = np.random.default_rng(24), DRIVES[drives]
    for _ in range(8):
        gains = Gains(rng.uniform(50, 2e4), rng.uniform(10, 300), (60.0, 30.0),
                      rng.uniform(40, 250), 20.0, tuple(rng.uniform(0.0, 12.0, 2)))
        law, hand = of_the_package(known, gains), ObserverFeedback(known, gains)
        at, offset = motion(rng, known.period), 10.0 ** rng.uniform(-5, -0.5) * rng.normal(size=2)
        for k in range(5):
            points = [at(k + j) for j in range(known.delay + 1)]
            q: Array = points[0].q + offset + 1e-4 * rng.normal(size=2)
            dq = points[0].dq + 0.1 * rng.normal(size=2)
            first, *ahead = ((x.q.tolist(), x.dq.tolist(), x.ddq.tolist()) for x in points)
            tau = law.step(q.tolist(), dq.tolist(), *first, ahead).tau
            np.testing.assert_allclose(tau, hand.step(q, dq, points), rtol=1e-9, atol=1e-8)

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


"""The response to the reference, against closed forms and against the law itself in time."""

from __future__ import annotations

from typing import Any

from ctc_chattering.control.controller import Controller
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.margins.linear_law import Frozen, linear_law
from ctc_chattering.margins.loop_margins import Loops
from ctc_chattering.margins.reference_response import reference_response
from ctc_chattering.numerics.linear_algebra import Array, ComplexArray
import numpy as np
import pytest
from scipy.linalg import expm  # type: ignore[import-untyped]

MASS = np.array([[3.0, 0.8], [0.8, 0.5]])
KP, KV = 400.0, 30.0
GAINS: dict[str, Any] = {'kp': [KP] * 2, 'kv': [KV] * 2}
OMEGA = 2.0 * np.pi * np.array([0.3, 2.0, 15.0, 80.0])
PERIOD = 1e-3
#: Frequencies in time [Hz], of which all periods are a part of 1 s.
FREQUENCIES = np.array([1.0, 5.0, 20.0])
PERIOD_SAMPLES = 500
#: Samples of a run, at whose end the start has decayed; a slow law takes longer.
SAMPLES = 2000
MANY_SAMPLES = 3500
#: Size of a sinusoid in time [rad].
SIZE = 1e-4


def config_of(law: str, lag: float = 0.0, delay: int = 0, **values: Any) -> ControllerConfig:
    config = ControllerConfig().changed({'law': law, **GAINS, **values})
    known = {'actuator_lag': [lag] * 2} if config.takes('actuator_lag') else {}
    return config.changed({'input_delay': delay, 'friction_level': 0.0, **known}
                          if config.takes('friction_level') else {'input_delay': delay, **known})


def response_of(config: ControllerConfig, lag: float = 0.0, differenced: bool = False,
                ratio: float = 1.0, omega: Array = OMEGA) -> ComplexArray:
    """Return T of the two joints."""
    law = linear_law(config, MASS, with_reference=True)
    loops = Loops([law], [MASS], config.control_period, np.full(2, lag), config.input_delay,
                  differenced)
    T: ComplexArray = reference_response(loops, omega, ratio)[0]
    return T


def held_torque(period: float, omega: Array, differenced: bool
                ) -> tuple[ComplexArray, ComplexArray]:
    """Return q and measured dq of an unit mass for a torque that is held."""
    z = np.exp(1j * omega * period)
    q = 0.5 * period ** 2 * (z + 1.0) / (z - 1.0) ** 2
    return q, q * (1.0 - 1.0 / z) / period if differenced else period / (z - 1.0)


@pytest.mark.parametrize('differenced', [False, True])
@pytest.mark.parametrize('ratio', [0.75, 1.0, 4 / 3])
def test_computed_torque_has_its_closed_form(ratio: float, differenced: bool) -> None:
    """It is P (kp + kv s + s²) / (1 + P_q kp + P_dq kv), for each joint alone."""
    q, dq = held_torque(PERIOD, OMEGA, differenced)
    s = 1j * OMEGA
    expected = ratio * q * (KP + KV * s + s * s) / (1.0 + ratio * (q * KP + dq * KV))
    T = response_of(config_of('compensation'), ratio=ratio, differenced=differenced)
    assert expected[:, np.newaxis, np.newaxis] * np.eye(2) == pytest.approx(T, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize('ratio', [0.75, 1.0, 4 / 3])
def test_pd_has_its_closed_form_with_coupled_inertia(ratio: float) -> None:
    """The joints are not independent: (I + X (P_q kp + P_dq kv))⁻¹ X P_q (kp + kv s)."""
    q, dq = held_torque(PERIOD, OMEGA, differenced=True)
    X = ratio * np.linalg.inv(MASS) / np.diag(np.linalg.inv(MASS))
    T = response_of(config_of('pd_gravity'), ratio=ratio, differenced=True)
    for k, s in enumerate(1j * OMEGA):
        loop = np.eye(2) + X * (q[k] * KP + dq[k] * KV)
        expected = np.linalg.solve(loop, X * q[k] * (KP + KV * s))
        assert T[k] == pytest.approx(expected, rel=1e-4, abs=1e-6)
    assert np.abs(T[:, 0, 1]).max() > 0.1


def test_it_is_1_for_exact_feedforward_up_to_the_held_torque() -> None:
    """Half a period is lost by holding ω² r, and nothing without it."""
    gaps = []
    for period in (1e-3, 0.5e-3):
        T = response_of(config_of('compensation', control_period=period), omega=OMEGA[:3])
        gaps.append(np.abs(T - np.eye(2)).max())
    assert gaps[0] < 0.05
    assert gaps[1] == pytest.approx(0.5 * gaps[0], rel=0.05)


def follow(config: ControllerConfig, lag: float, friction: float, samples: int) -> ComplexArray:
    """
    Return the answers of q to a sinusoid of each joint on a steady motion, as T.

    The robot is `MASS` with drives of first order, exactly integrated. The law is the real one.
    """
    h = config.control_period
    zero = np.zeros((2, 2))
    flow = np.zeros((8, 8))
    flow[:2, 2:4] = np.eye(2)
    flow[2:4, 4:6] = np.linalg.inv(MASS)
    if lag:
        flow[4:6] = np.hstack([zero, zero, -np.eye(2) / lag, np.eye(2) / lag])
    step = expm(h * flow)
    omega = 2.0 * np.pi * FREQUENCIES
    t = h * np.arange(samples + config.input_delay)
    waves = np.exp(1j * omega * t[:, np.newaxis])
    runs = []
    for joint in (None, 0, 1):
        reference = np.zeros((len(t), 3, 2))
        reference[:, 0] = t[:, np.newaxis]
        reference[:, 1] = 1.0
        if joint is not None:
            for order in range(3):
                reference[:, order, joint] += SIZE * ((1j * omega) ** order * waves).imag.sum(1)
        runs.append(_positions(config, step, lag, friction, reference))
    last = slice(samples - PERIOD_SAMPLES, samples)
    conjugate = 2j / PERIOD_SAMPLES * waves[last].conj().T
    answers = [conjugate @ (run - runs[0])[last] / SIZE for run in runs[1:]]
    return np.stack(answers, axis=-1)


def _positions(config: ControllerConfig, step: Array, lag: float, friction: float, reference: Array
               ) -> Array:
    """Return q at all samples of a reference but those of the delay."""
    h = config.control_period
    delay = config.input_delay
    controller = Controller(config, Frozen(MASS))
    x = np.concatenate([np.zeros(2), np.ones(2), np.zeros(4)])
    last_q = x[:2] - h
    transit = [np.zeros(2)] * delay
    positions = []
    for k in range(len(reference) - delay):
        q = x[:2]
        (q_d, dq_d, ddq_d), *ahead = reference[k:k + delay + 1].tolist()
        dq = (q - last_q) / h
        sample = controller.step(q.tolist(), dq.tolist(), q_d, dq_d, ddq_d, ahead)
        transit.append(np.array(sample.tau) - friction)
        last_q = q
        x[6:] = transit.pop(0)
        if not lag:
            x[4:6] = x[6:]
        x = step @ x
        positions.append(last_q)
    return np.array(positions)


@pytest.mark.parametrize('law, lag, delay, samples, values', [
    ('pd_gravity', 2e-3, 1, SAMPLES, {}),
    ('compensation', 3e-3, 2, SAMPLES, {}),
    ('slotine_li', 2e-3, 1, SAMPLES, {'adaptation_gain': [1000.0, 200.0]}),
    ('observer_feedback', 2e-3, 1, SAMPLES, {'ka': [60.0, 30.0]}),
    pytest.param('integral', 2e-3, 1, MANY_SAMPLES, {}, marks=pytest.mark.slow),
    pytest.param('momentum_observer', 2e-3, 1, SAMPLES, {}, marks=pytest.mark.slow),
    pytest.param('extended_state_observer', 1e-3, 1, SAMPLES, {}, marks=pytest.mark.slow),
    pytest.param('pid_kalman', 1e-3, 0, MANY_SAMPLES, {}, marks=pytest.mark.slow),
])
def test_the_law_itself_answers_so(
        law: str, lag: float, delay: int, samples: int, values: dict[str, Any]) -> None:
    """Amplitude and phase of all joints, with drives, delay and the velocity as a difference."""
    config = config_of(law, lag, delay, control_period=2 * PERIOD, **values)
    adapts = config.takes('adaptation_gain')
    T = response_of(config, lag, differenced=True, omega=2.0 * np.pi * FREQUENCIES)
    level = 5.0 if adapts else 0.0  # Adapted friction is linear while there is friction.
    real = config.changed({'friction_level': level}) if adapts else config
    assert follow(real, lag, level, samples) == pytest.approx(T, rel=2e-3, abs=5e-4)

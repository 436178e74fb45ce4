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

"""The laws (2) and (6) against the equations written out in numpy."""

import math
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.control.laws.registry import SWITCHINGS
from ctc_chattering.control.switching import Perturbation
from laws import GAINS, inputs
import numpy as np
from oracles import Array, Masses, paper_c, paper_m
import pytest

FULL = {**GAINS, 'ka': [10.0, 4.0]}


def _config(**values: Any) -> ControllerConfig:
    return ControllerConfig.from_mapping(values)


def estimate_of(controller: Controller) -> Array:
    """Return P̂ of law chattering."""
    memory = controller.memories.law
    assert isinstance(memory, Perturbation)
    return memory.perturbation


@pytest.mark.parametrize('law', ['compensation', 'chattering'])
def test_parts_add_up_to_the_torque(law: str) -> None:
    """Check tau and every part at random states."""
    rng = np.random.default_rng(0)
    controller = Controller(_config(law=law, **FULL))
    for _ in range(100):
        q, dq, q_d, dq_d, _ = rows = inputs(rng, 2.0)
        sample = controller.step(*rows)
        parts = np.array(sample.nominal) - sample.compensation - sample.robust
        assert list(sample.tau) == parts.tolist()
        assert sample.e == (np.array(q_d) - q).tolist()
        assert sample.de == (np.array(dq_d) - dq).tolist()
        np.testing.assert_allclose(sample.compensation, paper_c(q, dq) @ sample.v, atol=1e-12)
        expected = np.array([10.0, 4.0]) * np.sign(sample.v) * (law == 'chattering')
        assert list(sample.robust) == expected.tolist()
        assert controller.lyapunov(q, sample.v) == pytest.approx(
            0.5 * np.array(sample.v) @ paper_m(q) @ sample.v)


def test_defaults_are_the_paper_s() -> None:
    """Check section 4's numbers."""
    c = ControllerConfig()
    assert (c.kp, c.kv, c.ka) == ((100.0, 100.0), (50.0, 50.0), (10.0, 10.0))
    assert (c.lambda_, c.b, c.gravity, c.law) == (10.0, 1.0, 9.81, 'chattering')


LIMITS = {'effort_limit': [6.0, 2.0], 'effort_rate_limit': [2e3, 1e3]}
MASS = np.array([[2.0, 0.7], [0.7, 0.5]])


def _saturated(switching: str, delay: int, law: str, **values: Any) -> tuple[Array, Array, int]:
    """
    Return by how much v misses a v without limits, the least it could by what is cut, and cuts.

    The plant is two masses in closed form; without limits, the v after next is exactly
    exp(-λ h) v + (b h - c) u - b h M⁻¹ (N - w), with w the torque wanted `delay` samples ago.
    """
    h, b, pole = 1e-3, 1.3, 7.0
    made = Controller(_config(
        switching=switching, input_delay=delay, law=law, b=b, ka=[3.0, 1.0],
        **{'lambda': pole}, **values), Masses(MASS.tolist()))
    decay = math.exp(-pole * h)
    rng, q, dq = np.random.default_rng(19), np.array([0.0, 0.3]), np.array([0.4, 0.0])
    q_d, dq_d = np.zeros(2), np.zeros(2)
    on_way = [(np.zeros(2), np.zeros(2))] * delay
    wanted_v, misses, effects, cuts = None, [], [], 0
    for _ in range(300):
        ddq_d = rng.normal(size=2) * [5.0, 9.0]
        goal = q_d.tolist(), dq_d.tolist(), ddq_d.tolist()
        s = made.step(q.tolist(), dq.tolist(), *goal, [goal] * delay)
        if wanted_v is not None:
            misses.append(np.abs(s.v - wanted_v))
        u = 50.0 * np.array(s.de) + 100.0 * np.array(s.e)
        saturation = np.zeros(2) if s.saturation_error is None else np.array(s.saturation_error)
        cuts += s.saturation_error is not None
        on_way.append((np.array(s.tau), saturation))
        tau, saturation = on_way.pop(0)
        residual = MASS @ (ddq_d + u) - tau - saturation
        wanted_v = (decay * np.array(s.v) + b * (h - (1.0 - decay) / pole) * u
                    - b * h * np.linalg.solve(MASS, residual))
        effects.append(np.abs(b * h * np.linalg.solve(MASS, saturation)))
        a = np.linalg.solve(MASS, tau)
        q, dq = q + h * dq + h * h / 2 * a, dq + h * a
        q_d, dq_d = q_d + h * dq_d, dq_d + h * ddq_d
    return np.array(misses), np.array(effects[:-1]), cuts


@pytest.mark.parametrize('delay', [0, 3])
@pytest.mark.parametrize(('switching', 'law'), [
    *((name, 'chattering') for name in SWITCHINGS), ('sign', 'compensation')])
def test_anti_windup_keeps_what_is_cut_off_out_of_v(
        switching: str, law: str, delay: int) -> None:
    """Check v at every sample: on, as if nothing were cut; off, less what the cut has cost."""
    misses, _, cuts = _saturated(switching, delay, law, **LIMITS)
    assert cuts > 200
    assert misses.max() < 1e-10
    misses, effects, cuts = _saturated(switching, delay, law, anti_windup=False, **LIMITS)
    assert cuts > 200
    assert effects.max() > 0.02
    np.testing.assert_allclose(misses, effects, atol=1e-10)
    misses, effects, cuts = _saturated(switching, delay, law)
    assert (cuts, effects.max()) == (0, 0.0)
    assert misses.max() < 1e-10

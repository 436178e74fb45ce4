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

"""Law (6): its closed loop, and the bound of its term."""

from __future__ import annotations

import math

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.control.laws.registry import SWITCHINGS
from ctc_chattering.control.switching import Perturbation
from ctc_chattering.dynamics.two_link import TwoLink
from laws import GAINS, inputs
import numpy as np
from oracles import paper_c, paper_m
import pytest

FULL = {**GAINS, 'ka': [10.0, 4.0]}


def test_closed_loop_is_equation_7() -> None:
    """Check M (dv/dt + λ v) + C v + Ka sgn(v) = 0 with dv/dt from (4), for b = 1."""
    rng = np.random.default_rng(2)
    kv, kp = (np.array(FULL[k]).reshape(2, 2) for k in ('kv', 'kp'))
    controller = Controller(ControllerConfig.from_mapping({**FULL, 'b': 1.0}))
    for _ in range(50):
        q, dq, _, _, ddq_d = rows = inputs(rng, 2.0)
        sample = controller.step(*rows)
        v = np.array(sample.v)
        ddq = TwoLink().forward(*map(np.array, (q, dq, sample.tau)))
        rate = -(ddq_d - ddq + kv @ sample.de + kp @ sample.e) - 7.0 * v
        left = paper_m(q) @ (rate + 7.0 * v) + paper_c(q, dq) @ v + [10.0, 4.0] * np.sign(v)
        assert np.abs(left).max() < 1e-9


@pytest.mark.parametrize('switching', SWITCHINGS)
def test_the_term_is_within_the_gain(switching: str) -> None:
    """Check |tau - inverse + C v| <= Ka at every sample, the estimate being part of it."""
    rng = np.random.default_rng(10)
    controller = Controller(ControllerConfig.from_mapping(
        {**FULL, 'switching': switching, 'observer_bandwidth': math.inf}))
    worst = np.zeros(2)
    for _ in range(300):
        s = controller.step(*inputs(rng, 1.0))
        memory = controller.memories.law
        assert isinstance(memory, Perturbation)
        both = np.abs(np.array([s.robust, memory.perturbation]))
        assert (both <= [10.0, 4.0]).all()
        added = np.abs(np.subtract(s.nominal, s.compensation) - s.tau)
        assert (added <= [10.0 + 1e-9, 4.0 + 1e-9]).all()
        worst = np.maximum(worst, added)
    assert worst == pytest.approx([10.0, 4.0])

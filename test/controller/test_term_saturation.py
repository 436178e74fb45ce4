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

"""How often the chattering term is at its bound, counted by hand and seen in closed loop."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan
from typing import Any

from ctc_chattering.analysis.terms import terms
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.controller.health import ControllerHealth
from ctc_chattering.controller.term_saturation import Saturation, term_saturation
from ctc_chattering.simulation.closed_loop import run_closed_loop
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
import numpy as np
import pytest

KA = (2.0, 3.0)


def counted(rows: Sequence[tuple[float, ...]], switching: str = 'implicit',
            ka: tuple[float, ...] = KA) -> list[Saturation]:
    return term_saturation([(np.array(rows), ka, switching)])


def test_by_hand() -> None:
    """Check two stretches on the first joint, three on the second, one of which changes side."""
    rows = [(2.0, 0.0), (2.0, 3.0), (1.9, -3.0), (-2.0, -3.0), (-1.0, 0.0), (0.0, 3.0)]
    assert counted(rows) == [Saturation(3 / 6, 1.5), Saturation(4 / 6, 4 / 3)]


def test_sign_counts_long_stretches_only() -> None:
    long = [(2.0, 3.0 * side) for side in (1, -1) for _ in range(150)]
    assert counted(long, 'sign') == [Saturation(1.0, 300.0), Saturation(0.0, 0.0)]
    assert counted(long)[1] == Saturation(1.0, 150.0)


def test_gaps_and_parts() -> None:
    """Check that a stretch ends where samples are missing, and that all parts count."""
    rows = [(1.0,)] * 4 + [(nan,)] + [(1.0,)]
    assert counted(rows, ka=(1.0,)) == [Saturation(1.0, 2.5)]
    parts = [(np.ones((20, 1)), (1.0,), 'implicit'), (np.zeros((20, 1)), (2.0,), 'sign')]
    assert term_saturation(parts) == [Saturation(0.5, 20.0)]


def test_a_running_controller_looks_at_the_last_thousand_samples() -> None:
    health = ControllerHealth(('joint1', 'joint2'), 1_000_000)
    config = ControllerConfig(switching='implicit')
    x = (0.1, 0.2)
    sample = Controller(config).step(x, x, x, x, x)

    def reported(*robust: float) -> Sequence[tuple[int, str]]:
        for z in robust:
            health.add(sample._replace(robust=(z, 0.0)))
        return health.saturation(config)

    assert reported() == []
    assert reported(*([10.0] * 5 + [0.0]) * 17) == [(
        1, 'joint1: chattering term at its bound for 83 % of the samples, 5 at a stretch: noise, '
        'lag or delay too large')]
    assert reported(*[0.0] * 1000) == reported(*[10.0] * 50) == []
    text = reported(*[10.0] * 50)[0][1]
    assert 'for 10 % of the samples, 100 at a stretch: ka too small' in text
    assert health.saturation(config.changed({'law': 'compensation'})) == []


def loop(switching: str, ka: float, **plant: Any) -> list[Saturation]:
    """Return what a simulated loop shows in the second second; its friction is 9.9 N·m."""
    config = ControllerConfig(switching=switching, ka=(ka, ka), observer_bandwidth=200.0)
    run = run_closed_loop(PlantConfig(duration=2.0, **plant), config, ReferenceConfig())
    rows = terms(run, [(0.0, config)]).robust[1000:]
    return term_saturation([(rows, config.ka, switching)])


@pytest.mark.parametrize('switching', ['sign', 'implicit_observer'])
def test_the_cause_in_closed_loop(switching: str) -> None:
    """Check friction below, at and above ka, and noise: each is recognized on joint 2."""
    assert [x.cause for x in loop(switching, 12.0)] == ['', '']
    assert loop(switching, 8.0)[1].cause == 'ka too small'
    noisy = loop(switching, 12.0, velocity_noise=(0.02, 0.02))
    expected = '' if switching == 'sign' else 'noise, lag or delay too large'
    assert [x.cause for x in noisy] == [expected, expected]

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

"""The studies: what is recommended, and what counts as worse."""

from __future__ import annotations

from typing import Any

from ctc_chattering.runs.recommended import recommended_setup
from held_out_table import verdict
from imperfections import Case
import pytest


@pytest.mark.parametrize('h, lag, delay, pole', [
    (1e-3, 0.0, 0, 100.0), (1e-3, 2e-3, 1, 100.0), (1e-2, 0.0, 0, 40.0),
    (2e-3, 6e-3, 2, 100.0 / 3.0)])
def test_gains_follow_what_is_slow(h: float, lag: float, delay: int, pole: float) -> None:
    """Check p (T + h (1 + delay)) <= 0.4, and what is made of p."""
    case = Case('x', 'y', {'/**': {'control_period': h}, 'controller': {'input_delay': delay},
                           'plant': {'actuator_lag': [lag, lag], 'duration': 1.0}})
    config = recommended_setup(case.setup(), 'observer_feedback').controller
    assert (config.kp[0], config.kv[0]) == pytest.approx((pole ** 2, 2.0 * pole))
    assert config.estimator_bandwidth == pytest.approx(2.0 * pole)
    setup = recommended_setup(case.setup(), 'integral')
    p = 0.6 * pole
    assert (setup.controller.kp[0], setup.controller.kv[0], setup.controller.ki[0]
            ) == pytest.approx((3.0 * p ** 2, 3.0 * p, p ** 3))
    assert setup.reference.start_duration == 2.0


def row(telling: str, diverged: float | None, *rms: float, slips: float = 0.0) -> dict[str, Any]:
    """Return a row of one condition."""
    return {'label': 'x', 'seed': 1, 'telling': telling, 'diverged': diverged, 'rms': list(rms),
            'slips': slips, 'condition': 'trapezoid',
            'tripped': diverged and [0.5 * diverged, 1.0]}


def test_what_counts_as_worse() -> None:
    base = row('compensation', None, 0.1, 0.2)
    assert verdict(row('rough', 3.0), base) == 'diverged'
    assert verdict(row('rough', None, 0.01, 0.3), base) == 'worse'
    assert verdict(row('rough', None, 0.11, 0.2), base) == 'held'
    assert verdict(row('rough', None, 5.0, 5.0), row('compensation', 1.0)) == 'held'

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

"""What is recommended for the laws that the study has."""

from ctc_chattering.runs.recommended import recommended_setup
from imperfections import Case
from imperfections import EVERY_LAW as LAWS
import pytest

LAG = Case('2 ms', 'Drive lag', {
    'plant': {'duration': 1.0, 'actuator_lag': [2e-3, 2e-3], 'torque_rate_limit': [5e3, 1e3],
              'compiled': False},
    'controller': {'law': 'chattering', 'ka': [12.0, 12.0]}})


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
    coarse = Case('x', 'y', {**case.overrides, 'plant': {
        **case.overrides['plant'], 'encoder_resolution': [1e-4, 0.0]}})
    assert recommended_setup(coarse.setup(), 'observer_feedback'
                             ).controller.estimator_bandwidth == pytest.approx(pole)
    setup = recommended_setup(case.setup(), 'integral')
    p = 0.6 * pole
    assert (setup.controller.kp[0], setup.controller.kv[0], setup.controller.ki[0]
            ) == pytest.approx((3.0 * p ** 2, 3.0 * p, p ** 3))
    assert setup.reference.start_duration == 2.0


def test_what_a_lab_knows_is_given() -> None:
    """Check friction, lag and rate, and that every law can be recommended."""
    for law in LAWS:
        config = recommended_setup(LAG.setup(), law).controller
        assert (config.law, config.actuator_lag) == (law, (2e-3, 2e-3))
        assert config.friction_level == (
            (9.9, 9.9) if law in ('slotine_li', 'friction_feedforward') else (0.0, 0.0))

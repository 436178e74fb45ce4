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

"""Settings of the control step from parameters, and the limits of the torque."""

import math

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.control.settings import ControlSettings
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.errors import CtcError
import numpy as np
import pytest


@pytest.mark.parametrize('limits', [(-1.0, 10.0), (0.0, 10.0), (math.nan, 10.0), (10.0,)])
def test_effort_limits_of_a_model_that_are_none_are_refused(limits: tuple[float, ...]) -> None:
    """A limit of -1 N*m would clamp every torque to -1 N*m."""
    model = TwoLink(9.81)
    model.effort_limits = limits
    with pytest.raises(CtcError, match=r'effort_limits of the model: .* 2 numbers > 0'):
        Controller(ControllerConfig(), model)


def test_the_rate_limit_is_that_of_a_period_and_the_effort_limit_comes_after() -> None:
    settings = ControlSettings.from_config(ControllerConfig(
        effort_limit=(6.0, math.inf), effort_rate_limit=(2e3, 1e3)), (9.0, 5.0))
    limited = settings.limit(np.array([9.0, -9.0]), np.array([5.0, -4.5]))
    assert limited.tolist() == [6.0, -5.0]
    assert settings.limit(np.array([5.5, -4.0]), np.array([5.0, -4.5])).tolist() == [5.5, -4.0]


def test_without_limits_no_torque_is_changed() -> None:
    settings = ControlSettings.from_config(ControllerConfig(), ())
    assert settings.limited == 0.0
    assert settings.limit(np.array([1e12, -1e12]), np.zeros(2)).tolist() == [1e12, -1e12]

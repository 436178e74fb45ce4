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
"""Weight in the torque of a joint."""

from __future__ import annotations

from ctc_chattering.identification.torque_shape import fit_model
from panda_torques import scaled_torque
import pytest


def test_a_weight_shows_unless_the_axis_is_vertical() -> None:
    """The first axis is vertical: its torque tells nothing of weight."""
    assert not fit_model(scaled_torque(), 0).factors[0].is_known
    for joint in (1, 3):
        factor = fit_model(scaled_torque(1.3), joint).factors[0]
        assert factor.value == pytest.approx(1.3, abs=3.0 * factor.error)
        assert factor.sign == 1.0

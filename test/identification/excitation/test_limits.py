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

"""What a motion that excites a robot must keep."""

from __future__ import annotations

from ctc_chattering.errors import ParameterError
from ctc_chattering.identification.excitation.limits import bounds_of, ExcitationConfig
from ctc_chattering.trajectory.joint_limits import DescribedLimits
import pytest
from urdfs import joint, link, urdf

ARM = urdf([
    link('base'), link('a', 2.0, (0.2, 0.0, 0.0), (0.1, 0.1, 0.1)),
    link('b', 1.0, (0.1, 0.0, 0.0), (0.05, 0.05, 0.05)),
    joint('turn', 'revolute', 'base', 'a', '0 1 0', more=(
        '<limit lower="-1" upper="3" velocity="2" effort="30" acceleration="5"/>')),
    joint('slide', 'prismatic', 'a', 'b', '1 0 0', more=(
        '<limit lower="0" upper="0.2" velocity="0.1" effort="40"/>'))])


def test_bounds_of_a_description_with_acceleration_and_a_short_slide() -> None:
    limits = DescribedLimits(ARM, ('turn', 'slide')).joints
    config = ExcitationConfig(('turn', 'slide'), center=(1.0, 0.08), start=(0.0, 0.0))
    bounds = bounds_of(config, limits)
    assert bounds.room == pytest.approx([0.8, 0.07])
    assert bounds.velocity == pytest.approx([1.0, 0.05])
    assert bounds.acceleration == pytest.approx([2.5, 0.2])
    bounds = bounds_of(config.changed({
        'velocity_limit': [0.3, 0.1], 'acceleration_limit': [5.0, float('inf')]}), limits)
    assert bounds.velocity == pytest.approx([0.3, 0.1])
    assert bounds.acceleration == pytest.approx([5.0, 0.4])
    with pytest.raises(ParameterError, match=r'start of slide: 0\.3 is not allowed'):
        bounds_of(config.changed({'start': [0.0, 0.3]}), limits)

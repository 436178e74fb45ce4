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

"""The reference of compiled runs: one layout, for which the loop is compiled once."""

from ctc_chattering.trajectory.reference import make_motion, reference_table, ReferenceConfig
import numpy as np
import pytest

MS = 1_000_000


@pytest.mark.parametrize('start', [0.0, 0.05])
def test_the_layout_is_the_same_for_every_motion(start: float) -> None:
    """The rows are those of the motion, in the order of the joints that is asked for."""
    config = ReferenceConfig(start_duration=start)
    where = {'joint1': (0.1, 0.0), 'joint2': (-0.2, 0.3)} if start else {}
    table = reference_table(
        config, None, tuple(where.items()), config.joint_names[::-1], MS, 100)
    assert table.flags.c_contiguous
    motion = make_motion(config, None, where)
    expected = [[row[::-1] for row in motion.at(k * MS)] for k in range(100)]
    np.testing.assert_allclose(table, expected, rtol=1e-12, atol=1e-12)

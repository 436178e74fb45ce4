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

"""Computed torque plus the friction of the desired velocity."""

from laws import error, rattles, run
import numpy as np


def test_the_error_shrinks_with_the_right_level() -> None:
    """Check 0, half, all and twice the level: the error is that of what is left of friction."""
    none, half, all_, twice = (
        error(run('friction_feedforward', 4.0, friction_level=[f] * 2))
        for f in (0.0, 4.95, 9.9, 19.8))
    np.testing.assert_allclose(half, 0.5 * none, rtol=0.2)
    np.testing.assert_allclose(twice, none, rtol=0.3)
    assert (all_ < 0.2 * none).all()


def test_too_large_a_gain_rattles() -> None:
    """Check condition (2), c h Kv < 2, from both sides, with M̂ = c M."""
    assert rattles('friction_feedforward', {'kv': [1900.0] * 2}, {'kv': [2100.0] * 2})
    assert rattles('friction_feedforward', {'kv': [900.0] * 2, 'inertia_scale': 2.0},
                   {'kv': [1100.0] * 2, 'inertia_scale': 2.0})

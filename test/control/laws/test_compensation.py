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

"""Law (2); test/control/test_control_steps.py has its torques."""

from laws import rattles


def test_too_large_a_gain_rattles() -> None:
    """Check c h Kv < 2 from both sides, with M̂ = c M."""
    assert rattles('compensation', {'kv': [1900.0] * 2}, {'kv': [2100.0] * 2})
    assert rattles('compensation', {'kv': [900.0] * 2, 'inertia_scale': 2.0},
                   {'kv': [1100.0] * 2, 'inertia_scale': 2.0})

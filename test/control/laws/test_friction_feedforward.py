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

"""Feedforward of friction: its bound, and what it gains."""

from __future__ import annotations

from laws import error, rattles, run


def test_the_bound_of_kv_from_both_sides() -> None:
    """With M̂ = 2 M the loop is stable if 2 h Kv < 2."""
    assert rattles(
        'friction_feedforward', {'kv': 900.0}, {'kv': 1100.0}, duration=1.5, inertia_scale=2.0)


def test_a_known_friction_shrinks_the_error() -> None:
    found = error(run('friction_feedforward', 2.0, friction_level=9.9))
    assert (found < 0.2 * error(run('compensation', 2.0))).all()

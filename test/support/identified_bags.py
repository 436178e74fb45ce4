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

"""A short bag of the paper's arm, for the tests that read one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from identified_robots import record, Recorded
from motion_bags import messages_of, write


def recorded_bag(path: Path, made: Recorded, **more: Any) -> Path:
    """Write a recording into a bag; arguments as `messages_of` has them."""
    x = made.recording
    fields = {'q': x.q, 'dq': x.dq, 'effort': x.effort, 'command': x.command, **more}
    t = fields.pop('t', x.t)
    return write(path, messages_of(t, x.joints, **fields))


def short(seed: int = 1, duration: float = 8.0) -> Recorded:
    """Return a short recording."""
    return record('two_link', seed, duration)

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

"""What an identification has noticed: a reason for care with a joint, or to refuse it."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

#: In place of a joint: all of them.
ALL_JOINTS = -1


class Severity(IntEnum):
    """What follows for a joint."""

    NOTE = 0
    CARE = 1
    REFUSED = 2


class Finding(NamedTuple):
    """
    Something that makes the numbers of a joint doubtful.

    Attributes
    ----------
    severity : Severity
        Worth knowing, usable with care, or not usable.
    joint : int
        Index of the joint; `ALL_JOINTS` for all.
    reason : str
        What was noticed, with its numbers, and the physical cause that it points to.
    cure : str
        What to record, or which option to give; empty for nothing.

    """

    severity: Severity
    joint: int
    reason: str
    cure: str = ''

    @property
    def text(self) -> str:
        """Return the reason with the cure."""
        return f'{self.reason}; {self.cure}' if self.cure else self.reason

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

"""A number with its interval, or the reason why there is none."""

from __future__ import annotations

import dataclasses
from typing import Any

from ctc_chattering.analysis.number_format import with_interval
from ctc_chattering.errors import CtcError

#: The reason where the data would show a quantity, and do not; and where they would, beyond a
#: bound that follows.
NONE, NONE_ABOVE = 'none shows', 'none above '


@dataclasses.dataclass(frozen=True)
class Estimate:
    """
    What was identified of one quantity.

    Attributes
    ----------
    value : float or None
        None where it is not identifiable.
    half : float
        Half the interval of 95 %; 0 where none is given.
    unit : str
        As in ``N*m``.
    reason : str
        Why there is no value.

    """

    value: float | None
    half: float = 0.0
    unit: str = ''
    reason: str = ''

    @classmethod
    def none(cls, reason: str) -> Estimate:
        """Return what is not identifiable."""
        return cls(None, reason=reason)

    @property
    def shows_none(self) -> bool:
        """Whether the data show that there is none, at least beyond a bound."""
        return self.value is None and self.reason.startswith((NONE, NONE_ABOVE))

    def __str__(self) -> str:
        """Return value, interval and unit, or the reason."""
        if self.value is None:
            return self.reason if self.shows_none else f'not identifiable: {self.reason}'
        return with_interval(self.value, self.half, self.unit)

    def number(self) -> float:
        """Return the value, 0 if the data show that there is none; raise `CtcError` without."""
        if self.value is None and not self.shows_none:
            raise CtcError(f'not identifiable: {self.reason}')
        return self.value or 0.0

    def as_mapping(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        if self.value is None:
            return {'value': None, 'reason': self.reason}
        return {'value': self.value, 'interval_95': [self.value - self.half,
                                                     self.value + self.half]} if self.half else {
            'value': self.value}

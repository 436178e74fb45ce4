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

"""Arguments of public functions that are checked beyond what their types say."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import Any

from ctc_chattering.errors import ParameterError
import numpy as np
import numpy.typing as npt


def check_some(name: str, values: Sequence[object]) -> None:
    """Raise `ParameterError` for an empty sequence."""
    if not values:
        raise ParameterError(name, values, 'one or more')


def whole(name: str, value: Any, least: int | None = None, most: int = 2 ** 32 - 1) -> int:
    """Return a whole number as an `int`; raise `ParameterError` if it is none, or out of range."""
    if not isinstance(value, Integral) or isinstance(value, bool) or (
            least is not None and not least <= int(value) <= most):
        raise ParameterError(name, value, 'a whole number' + (
            '' if least is None else f' >= {least} and <= {most}'))
    return int(value)


def vector(name: str, values: Any, n: int) -> npt.NDArray[np.float64]:
    """Return `n` numbers as an array; raise `ParameterError` if they are something else."""
    try:
        found = np.array(values, float)
    except (TypeError, ValueError, OverflowError):
        found = np.empty(0)
    if found.shape != (n,):
        raise ParameterError(name, values, f'{n} numbers')
    return found

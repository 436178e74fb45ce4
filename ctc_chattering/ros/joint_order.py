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

"""Matching the joints of a message to our own by name, never by place."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from ctc_chattering.errors import RejectedMessage


def select(ours: Sequence[str], names: Sequence[str], *rows: Sequence[float]
           ) -> list[tuple[float, ...]]:
    """
    Return our joints' values out of each row of a message.

    Parameters
    ----------
    ours : sequence of str
        Our joints in our order.
    names : sequence of str
        Joints of the message.
    *rows : sequence of float
        A value for each of them.

    Raises
    ------
    RejectedMessage
        If a joint of ours is missing, a name stands there twice, a row has another length, or a
        value of ours is not finite.

    """
    n = len(names)
    if names != ours and (len(set(names)) != n or not set(names).issuperset(ours)):
        raise RejectedMessage('joints', (
            f'joints {list(names)}; needed: each of {list(ours)} once'))
    lengths = {len(row) for row in rows}
    if lengths - {n}:
        raise RejectedMessage('length', (
            f'{" or ".join(map(str, sorted(lengths)))} values for {n} joints'))
    values = [tuple(row) for row in rows]
    if names != ours:
        order = [names.index(name) for name in ours]
        values = [tuple([row[i] for i in order]) for row in rows]
    if not isfinite(sum(map(sum, values))):
        raise RejectedMessage('not_finite', f'{[list(row) for row in values[:3]]}')
    return values

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

"""Whether the position error is within its limit."""

from __future__ import annotations

from ctc_chattering.numerics.linear_algebra import Vector


def joint_beyond(e: Vector, limit: Vector) -> int | None:
    """
    Return the first joint whose error is beyond its limit; None if all are within.

    Parameters
    ----------
    e : sequence of float, shape (n,)
        Position error [rad]; NaN is beyond any limit.
    limit : sequence of float, shape (n,)
        Largest magnitude allowed [rad].

    """
    for i, (x, most) in enumerate(zip(e, limit)):
        if not -most <= x <= most:
            return i
    return None

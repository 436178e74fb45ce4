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

"""Velocities of joints that slide or stick, exactly, as machine code."""

from __future__ import annotations

import numpy as np
from rigid_bodies import Array, compiled

#: Steps in which every joint may change between sliding and sticking, before it is one a step.
_TOGETHER = 10
_ATTEMPTS = 200


@compiled
def solve(w: Array, rhs: Array, free: Array, out: Array) -> None:
    """Write the solution of the rows and columns of a positive definite w that are free."""
    n = len(rhs)
    low = np.empty((n, n))
    for i in range(n):
        if free[i] == 0.0:
            out[i] = 0.0
            continue
        y = rhs[i]
        for j in range(i + 1):
            if free[j] == 0.0:
                continue
            value = w[i, j]
            for k in range(j):
                if free[k] != 0.0:
                    value -= low[i, k] * low[j, k]
            low[i, j] = np.sqrt(value) if i == j else value / low[j, j]
            if j < i:
                y -= low[i, j] * out[j]
        out[i] = y / low[i, i]
    for i in range(n - 1, -1, -1):
        if free[i] == 0.0:
            continue
        y = out[i]
        for j in range(i + 1, n):
            if free[j] != 0.0:
                y -= low[j, i] * out[j]
        out[i] = y / low[i, i]


@compiled
def with_friction(w: Array, rhs: Array, most: Array, least: Array, way: Array, v: Array) -> None:
    """
    Write velocities v for w v = rhs - f, with friction f in its set, and f into rhs.

    f_i = most_i where v_i > 0, least_i where v_i < 0, and between them where v_i = 0. `way` is
    the guess, 1, -1 or 0 for each coordinate, and becomes what is found.
    """
    n = len(rhs)
    free, known = np.empty(n), np.empty(n)
    for attempt in range(_ATTEMPTS):
        for i in range(n):
            held = most[i] > least[i] and way[i] == 0.0
            free[i] = 0.0 if held else 1.0
            known[i] = rhs[i] - (most[i] if way[i] > 0.0 else least[i] if way[i] < 0.0 else 0.0)
        solve(w, known, free, v)
        changed = False
        for i in range(n):
            if most[i] <= least[i] or (changed and attempt > _TOGETHER):
                continue
            if way[i] == 0.0:
                need = rhs[i]
                for j in range(n):
                    need -= w[i, j] * v[j]
                known[i] = need
                if need > most[i] or need < least[i]:
                    way[i] = 1.0 if need > most[i] else -1.0
                    changed = True
            elif way[i] * v[i] <= 0.0:
                way[i] = 0.0
                changed = True
        if not changed:
            break
    for i in range(n):
        rhs[i] = 0.0 if most[i] <= least[i] else (
            most[i] if way[i] > 0.0 else least[i] if way[i] < 0.0 else known[i])

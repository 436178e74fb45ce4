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

"""
A known input delay: the law is evaluated at the state predicted for when its torque is applied.

The prediction runs model, reference and filter ahead under the torques in transit. Filter and
observer themselves advance with what is measured and applied.
"""

from __future__ import annotations

from typing import Any

from ctc_chattering.control.evaluation import (
    Context,
    ControlMemory,
    evaluated,
    Evaluates,
    LastSample,
    losing,
    State,
)
from ctc_chattering.numerics.compilable import function, solve
from ctc_chattering.numerics.linear_algebra import Array

#: Rows of a torque in transit.
ROWS = 4


@function
def arriving(law: Any, law_memory: Any, now: State, context: Context, memory: ControlMemory,
             points: Array) -> State:
    """
    Return the state in which the torque of this sample is applied; `now` without a delay.

    Parameters
    ----------
    law, law_memory
        Law in force, and its memory: of what acts until the torque arrives.
    now : State
        Measured.
    context, memory, points
        As of the control step.

    """
    settings, at, xi = context.settings, now, memory.xi
    if settings.delay == 0.0:
        return now
    delay, perturbation, h = int(settings.delay), law.acting(law_memory, now), settings.period
    lossy, turn = losing(settings, memory), int(memory.turn)
    for j in range(delay):
        row = ROWS * ((turn + j) % delay)
        xi = settings.filter.next_state(xi, at.de, at.u)
        if lossy:
            xi = xi + settings.limiter.correction(at.M, context.transit[row + 2])
        q, dq = predict(context.models.arriving, at, context.transit[row] - perturbation, h)
        at = evaluated(settings, context.models.arriving, q, dq, points, 3 * j + 3, xi)
    return at


@function
def next_state(law: Any, law_memory: Any, last: LastSample, context: Context,
               memory: ControlMemory, points: Array) -> tuple[Array, Array]:
    """
    Return q and dq, shape (n,), a period after the last sample.

    Parameters
    ----------
    law, law_memory
        Law in force, and its memory: of what has acted since.
    last : LastSample
        State and torque.
    context, memory, points
        As of the control step.

    """
    at = evaluated(context.settings, context.models.now, last.q, last.dq, points, 0, memory.xi)
    return predict(context.models.now, at, last.applied - law.acting(law_memory, at),
                   context.settings.period)


@function
def predict(model: Evaluates, at: State, u: Array, h: float) -> tuple[Array, Array]:
    """
    Return q and dq after one period under a held torque, by the midpoint rule.

    Parameters
    ----------
    model : Model
        As the controller knows it.
    at : State
        Now.
    u : array, shape (n,)
        Torque less the perturbation [N·m].
    h : float
        Period [s].

    """
    middle = at.dq + 0.5 * h * solve(at.M, u - at.bias)
    return at.q + h * middle, at.dq + h * model.forward(at.q + 0.5 * h * at.dq, middle, u)

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
Prediction of the state in which a delayed torque is applied.

A torque is applied d samples after it is sent. Under this known delay the control step asks for
the state at that time, and the law answers it. The prediction runs model, reference and filter
ahead under the torques in transit. Filter and observers themselves advance with measured states
and applied torques.
"""

from __future__ import annotations

from typing import Any

from ctc_chattering.compiled.compilable import function
from ctc_chattering.control.sample import Applied, Context, evaluate_state, predict_state, State
from ctc_chattering.numerics.linear_algebra import Array


@function
def predict_arrival(law: Any, law_memory: Any, now: State, context: Context) -> State:
    """
    Return the state at the arrival of the torque.

    Without a delay that is `now`.

    Parameters
    ----------
    law, law_memory
        Law in force, and its memory, which estimates the perturbation until then.
    now : State
        Measured.
    context : Context
        Of the sample.

    """
    settings = context.settings
    model = context.models.arriving
    if settings.delay == 0.0:
        return now
    state = now
    xi = context.memory.xi
    perturbation = law.acting(law_memory, now)
    modified = context.torque_is_modified()
    for j in range(int(settings.delay)):
        row = context.transit_row(j)
        xi = settings.filter.next_state(xi, state.de, state.u)
        if modified:
            excess = settings.anti_windup * context.transit[row + 2]
            xi = xi + settings.filter.correction(state.M, excess)
        torque = context.transit[row] - perturbation
        q, dq = predict_state(model, state, torque, settings.period)
        state = evaluate_state(settings, model, q, dq, context.reference_at(j + 1), xi)
    return state


@function
def exchange_torque(transit: Array, row: int, sent: Applied) -> Applied:
    """Replace a torque in transit, and return it."""
    applied = Applied(
        1.0 * transit[row],
        1.0 * transit[row + 1],
        1.0 * transit[row + 2],
        1.0 * transit[row + 3])
    transit[row] = sent.tau
    transit[row + 1] = sent.saturation_error
    transit[row + 2] = sent.excess
    transit[row + 3] = sent.clipping_error
    return applied

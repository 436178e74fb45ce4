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
Hand-over from one law to another, without a step of the torque.

`Controller` calls `take_over` before the first sample of the new law. The new law begins from the
perturbation that the old one estimates. If it acts on v and the old one did not, it begins with
v = 0. Its first torque then still differs from the last one sent. That offset is added and fades
within `HANDOVER_DURATION_S`: after j of J samples there remains 1 - j / J of it. Anti-windup keeps
it out of the filter (3). Between the two laws of the paper the chattering term comes and goes at
once instead.
"""

from __future__ import annotations

from typing import Any

from ctc_chattering.compiled.compilable import function
from ctc_chattering.control.sample import ControlMemory, Desired, evaluate_state, Memories
from ctc_chattering.control.settings import ControlSettings
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Array


def take_over(settings: ControlSettings, old: Any, old_memory: Any, new: Any, memories: Memories,
              model: Model, rows: Array) -> Memories:
    """
    Return the memories with which a law takes over.

    Parameters
    ----------
    settings : ControlSettings
        Of the control step.
    old, old_memory
        The old law and its memory.
    new : Law
        The new one.
    memories : Memories
        After the last sample, with the initial memory of the new law.
    model : Model
        M, C and G.
    rows : array
        Measured q, dq and desired q, dq, ddq of the sample to come, and more.

    """
    control = memories.control
    law_memory = memories.law
    if new.acts_on_v and not old.acts_on_v:
        control = control._replace(xi=settings.filter.b * (rows[3] - rows[1]))
    q, dq = rows[:2]
    now = evaluate_state(settings, model, q, dq, Desired(*rows[2:5]), control.xi)
    if not (old.of_the_paper and new.of_the_paper):
        control = control._replace(handover_samples_left=settings.handover_samples)
    if old.estimates:
        law_memory = new.initialized(now, old.estimate(old_memory, now))
    return Memories(control, law_memory, memories.last)


@function
def handover_offset(settings: ControlSettings, memory: ControlMemory, torque: Array) -> Array:
    """Return the torque step hidden at the hand-over."""
    if memory.handover_samples_left == settings.handover_samples:
        return memory.held - torque
    return memory.handover_offset

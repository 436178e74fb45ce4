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
From one law to another without a step of the torque.

The new law begins from the perturbation that the old one estimates; if it acts on v and the old
one did not, with v = 0. What its first torque then still differs from the last one sent is added
to it, and fades: after j samples there remains 1 - j / J of it, with J h = `FADE`. Anti-windup
keeps it out of the filter (3), as what the limits take from a torque. Between the two laws of the
paper the chattering term comes and goes at once instead.
"""

from __future__ import annotations

from typing import Any

from ctc_chattering.control.evaluation import (
    ControlMemory,
    ControlSettings,
    evaluated,
    Evaluates,
)
from ctc_chattering.control.laws.base import Law
from ctc_chattering.numerics.linear_algebra import Array


def taken_over(settings: ControlSettings, before: tuple[Law, Any], law: Law, law_memory: Any,
               memory: ControlMemory, model: Evaluates, rows: Array) -> tuple[ControlMemory, Any]:
    """
    Return the memories with which a law goes on after another one.

    Parameters
    ----------
    settings : ControlSettings
        Of the control step.
    before : tuple
        The old law and its memory.
    law, law_memory
        The new one, with what it remembers from before.
    memory : ControlMemory
        Of the control step, after its last sample.
    model : Model
        M, C and G.
    rows : array, shape (5, n)
        Measured q, dq and desired q, dq, ddq of the sample to come.

    """
    old, known = before
    if law.acts_on_v and not old.acts_on_v:
        memory = memory._replace(xi=settings.filter.b * (rows[3] - rows[1]))
    now = evaluated(settings, model, rows[0], rows[1], rows[2:], 0, memory.xi)
    if not (old.of_the_paper and law.of_the_paper):
        memory = memory._replace(fading=settings.fading, fresh=1.0)
    return memory, law.initialized(
        law_memory, now, old.estimate(known, now) if old.estimates else None)

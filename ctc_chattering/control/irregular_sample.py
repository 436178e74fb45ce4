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
Irregular samples, whose states come late, early or never.

The samples of a law are a period h apart, whatever the stamps say. For each period without a
state the law goes on with the state that it predicts, under the torque that acted. A state that
was measured a time δ after a sample is taken back to it along the predicted motion::

    q - δ (dq + ½ δ a),     dq - δ a,     a = (dq - dq of the sample before) / h         (LS1)

Where clocks differ the samples follow the stamps, so that |δ| stays below 0.45 h. `Controller`
locates the sample of each stamp. The control step then takes the state to it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import function, record
from ctc_chattering.control.sample import Context, LastSample
from ctc_chattering.numerics.linear_algebra import Array

#: After more periods without a state the law goes on as if none were missing.
MAX_MISSED_PERIODS = 50


@record
class SampleIrregularity(NamedTuple):
    """
    Deviation of a sample from a regular one.

    Attributes
    ----------
    offset : float
        Time δ from the sample to the measurement of its state [s].
    reference_offset : float
        Time from the instants of the reference to the sample [s].
    is_measured : float
        Truth of: the state has come. Otherwise the predicted state replaces it.
    keeps_torque : float
        Truth of: the torque sent last stays in force.

    """

    offset: float
    reference_offset: float
    is_measured: float
    keeps_torque: float


#: A state that was measured at its sample.
REGULAR = SampleIrregularity(0.0, 0.0, 1.0, 0.0)


def missing_state(reference_offset_ns: int, keeps_torque: bool) -> SampleIrregularity:
    """Return the irregularity of a sample without a state."""
    return SampleIrregularity(0.0, reference_offset_ns / 1e9, 0.0, float(keeps_torque))


@function
def locate_sample(h: int, offset: int, elapsed: int) -> tuple[int, int]:
    """
    Return the missed periods before a state, and its offset [ns].

    Parameters
    ----------
    h, offset : int
        Period, and time of the state before after its sample, 0 for the first [ns].
    elapsed : int
        Since that state [ns].

    """
    since = offset + elapsed
    periods = max((since + h // 2) // h, 1)
    if since <= 0 or periods > MAX_MISSED_PERIODS + 1:
        return 0, 0
    largest = h * 9 // 20
    new_offset = min(max(since - periods * h, -largest), largest)
    return periods - 1, new_offset


@function
def state_at_sample(law: Any, law_memory: Any, last: LastSample, context: Context,
                    irregularity: SampleIrregularity, q: Array, dq: Array
                    ) -> tuple[Array, Array]:
    """Return q and dq, predicted or by (LS1)."""
    next_q, next_dq = law.predicted_state(law_memory, last, context)
    if irregularity.is_measured == 0.0:
        return next_q, next_dq
    offset = irregularity.offset
    a = (next_dq - last.dq) / context.settings.period
    mean_dq = next_dq + 0.5 * offset * a
    return q - offset * mean_dq, dq - offset * a

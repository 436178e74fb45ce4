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

"""Settings of the control step, from the parameters of the controller."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from ctc_chattering.compiled.compilable import record
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.filter import design_filter, ErrorFilter
from ctc_chattering.numerics.box_qp import clip
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.numerics.time_grid import period_ns, seconds
from ctc_chattering.parameters import matrix
import numpy as np

#: Time over which the torque offset of a hand-over fades [s].
HANDOVER_DURATION_S = 0.2


@record
class ControlSettings(NamedTuple):
    """
    Settings that all laws share, from a `ControllerConfig`.

    Attributes
    ----------
    period : float
        h [s].
    delay, handover_samples : float
        Input delay, and `HANDOVER_DURATION_S`, in samples.
    kp, kv : ndarray, shape (n, n)
        Kp [1/s²] and Kv [1/s].
    filter : ErrorFilter
        Filter (3).
    effort_limit, effort_step : ndarray, shape (n,)
        Largest torque, and its largest change in a period, inf for unlimited [N·m].
    limited, anti_windup : float
        Truth of: there are limits, and anti-windup is on.
    zero : ndarray, shape (n,)
        Zeros.

    """

    period: float
    delay: float
    handover_samples: float
    kp: Array
    kv: Array
    filter: ErrorFilter  # noqa: A003
    effort_limit: Array
    effort_step: Array
    limited: float
    anti_windup: float
    zero: Array

    @classmethod
    def from_config(cls, config: ControllerConfig, model_limits: Vector) -> ControlSettings:
        """
        Return the settings of a configuration.

        `model_limits` are the model's effort limits [N·m].
        """
        n = len(config.joint_names)
        h = seconds(period_ns(config.control_period))
        effort_limit = np.array(config.largest_torque(model_limits))
        effort_step = h * np.array(config.effort_rate_limit)
        least_limit = min(effort_limit.min(), effort_step.min())
        return cls(
            period=h,
            delay=float(config.input_delay),
            handover_samples=float(max(round(HANDOVER_DURATION_S / h), 1)),
            kp=np.array(matrix(config.kp, n)),
            kv=np.array(matrix(config.kv, n)),
            filter=design_filter(config.lambda_, config.b, h),
            effort_limit=effort_limit,
            effort_step=effort_step,
            limited=float(least_limit < inf),
            anti_windup=float(config.anti_windup),
            zero=np.zeros(n))

    def limit(self, torque: Array, held: Array) -> Array:
        """Return `torque` within the limits, after `held` [N·m]."""
        step = self.effort_step
        reachable = clip(torque, held - step, held + step)
        return clip(reachable, -self.effort_limit, self.effort_limit)

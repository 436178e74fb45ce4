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
Switching `implicit`: the backward-Euler discretisation of Ka sgn(v).

The term z is the element of Ka Sgn(v) at the *next* sample, so that it can rest anywhere between
-Ka and Ka once v is 0 (Acary & Brogliato 2010; Huber, Acary & Brogliato 2016; see
docs/theory.md)::

    z ∈ Ka Sgn(v⁺),     v⁺ = b h M⁻¹ (w - z),     w = M y / (b h) - C v                     (SW1)

Where w is within ±Ka it is the solution. Otherwise joints at their bound push the others through
M⁻¹: z is the point of the box |z_i| ≤ ka_i nearest to w in the metric of M⁻¹, whatever b h.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.evaluation import ErrorFilter, filter_of, State
from ctc_chattering.control.perturbation_observer import Perturbation
from ctc_chattering.control.switching.base import switching
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.compilable import dot, function
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@switching
class Implicit(NamedTuple):
    """The term for which v vanishes at the next sample, as far as Ka allows."""

    #: Ka [N·m], shape (n,), and the filter (3), which predicts v.
    ka: Array
    filter: ErrorFilter  # noqa: A003

    @classmethod
    def made(cls, config: ControllerConfig, period: float) -> Implicit:
        """Return the switching of a configuration."""
        return cls(np.array(config.ka), filter_of(config, period))

    def term(self, memory: Perturbation, at: State, compensation: Array) -> tuple[Array, Array]:
        """Return z for no perturbation."""
        return nearest(at.M, unclipped(self.filter, at, compensation), self.ka), at.zero


@function
def unclipped(filter_: ErrorFilter, at: State, compensation: Array) -> Array:
    """Return w of (SW1), shape (n,) [N·m]."""
    return dot(at.M, filter_.nominal_response(at.v, at.u) / filter_.scale) - compensation


#: What the name of this module stands for.
SWITCHING = Implicit

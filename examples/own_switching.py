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
A switching of your own for law (6): Ka tanh(v / width) in the place of Ka sgn(v).

Put the module where Python finds it, and name the class: ``law: chattering`` with
``switching: own_switching:Smooth``. It then runs in nodes and in `ctc simulate`, and compiled in
maps. What it may use is in `ctc_chattering/compiled/compilable.py`.
"""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering import ControllerConfig, State, switching
from ctc_chattering.control.switching import Perturbation
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@switching
class Smooth(NamedTuple):
    """Ka tanh(v / width)."""

    #: Ka [N·m], shape (n,), and the width [rad/s].
    ka: Array
    width: float

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> Smooth:
        """Return the switching of a configuration."""
        return cls(np.array(config.ka), config.boundary_layer)

    def term(self, memory: Perturbation, at: State, compensation: Array) -> tuple[Array, Array]:
        """Return z, and what ±Ka has taken from it."""
        return self.ka * np.tanh(at.v / self.width), at.zero

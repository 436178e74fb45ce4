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

"""Switching `boundary_layer`: a slope in the place of the jump."""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.evaluation import State
from ctc_chattering.control.perturbation_observer import Perturbation
from ctc_chattering.control.switching.base import switching
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@switching
class BoundaryLayer(NamedTuple):
    """Ka sat(v / width)."""

    #: Ka [N·m], shape (n,), and half the width of the layer around v = 0 [rad/s].
    ka: Array
    width: float

    @classmethod
    def made(cls, config: ControllerConfig, period: float) -> BoundaryLayer:
        """Return the switching of a configuration."""
        del period
        return cls(np.array(config.ka), config.boundary_layer)

    def term(self, memory: Perturbation, at: State, compensation: Array) -> tuple[Array, Array]:
        """Return Ka sat(v / width)."""
        return self.ka * np.minimum(np.maximum(at.v / self.width, -1.0), 1.0), at.zero


#: What the name of this module stands for.
SWITCHING = BoundaryLayer

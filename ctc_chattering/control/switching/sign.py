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

"""Switching `sign`: the paper's term, discontinuous at v = 0."""

from __future__ import annotations

from typing import NamedTuple

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.evaluation import State
from ctc_chattering.control.perturbation_observer import Perturbation
from ctc_chattering.control.switching.base import switching
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@switching
class Sign(NamedTuple):
    """Ka sgn(v), with sgn(0) = 0 as in the paper."""

    #: Ka [N·m], shape (n,).
    ka: Array

    @classmethod
    def made(cls, config: ControllerConfig, period: float) -> Sign:
        """Return the switching of a configuration."""
        del period
        return cls(np.array(config.ka))

    def term(self, memory: Perturbation, at: State, compensation: Array) -> tuple[Array, Array]:
        """Return Ka sgn(v)."""
        return self.ka * np.sign(at.v), at.zero


#: What the name of this module stands for.
SWITCHING = Sign

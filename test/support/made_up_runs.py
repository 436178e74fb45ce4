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

"""Runs that no model here has, for what shows them."""

from __future__ import annotations

from typing import Any

from ctc_chattering.analysis.result import Result
from ctc_chattering.analysis.terms import RunTerms
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.simulation.closed_loop import Run
import numpy as np


def made_up(n: int, samples: int = 300, **values: Any) -> Result:
    """Return a result for `n` joints that no model here has."""
    t = np.array([i * 1e-3 for i in range(samples)])
    x = np.sin(np.outer(t, 20.0 + np.arange(n)))
    config = ControllerConfig.from_mapping({
        'model': 'other:Arm', 'joint_names': [f'axis{i}' for i in range(n)], **values})
    run = Run(t, x, x, x + 0.1, x, x, 5.0 * x, 0.1 * x)
    terms = RunTerms(t, run.tau, run.tau, x, 10.0 * np.sign(x), run.v,
                     1e-6 + np.square(x).sum(axis=1))
    return Result('friction', [(0.0, config)], run, terms)

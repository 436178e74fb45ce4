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

"""Loops of the two-link arm, for tests of stability margins."""

from __future__ import annotations

from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.margins.loop_margins import Loops
from ctc_chattering.runs.stability import loops_of

#: Lag of the drives [s].
LAG = 2e-3
#: The law, told all but the model.
REAL_ARM = {'law': 'observer_feedback', 'kp': [1e4] * 2, 'kv': [200.0] * 2, 'ka': [1e6] * 2,
            'estimator_bandwidth': 200.0, 'actuator_lag': [2e-3] * 2, 'input_delay': 1}


def loops(controller: dict[str, Any], lag: float = 0.0, delay: int = 0, **plant: Any) -> Loops:
    return loops_of(parameter_file.load(find_config('friction'), {
        'controller': controller,
        'plant': {'actuator_lag': [lag] * 2, 'input_delay': delay, **plant}}))

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

"""A short search for gains, for the tests that show one."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from ctc_chattering.runs.tune import search_gains, Tuning
from ctc_chattering.runs.tune_spec import parse_tune, TuneSpec

#: A spec in a file, and the robot that it names.
SPEC = """
params_file: robot.yaml
duration: 0.5
repeats: 2
uncertain:
  friction: {parameter: plant.coulomb_friction, uniform: [0.8, 1.2], factor: true}
tune:
  law: chattering
  torque_limit: 5000
  search: {pole: [5, 50]}
"""
ROBOT = """
/**: {ros__parameters: {control_period: 0.005, compiled: false}}
plant: {ros__parameters: {duration: 10.0, integration_step: 0.005}}
"""


def short_spec(**more: Any) -> TuneSpec:
    """Return a spec of the paper's arm, short, at 200 Hz, with two draws."""
    return parse_tune({
        'duration': 0.5, 'repeats': 2,
        'overrides': {'/**': {'control_period': 5e-3},
                      'plant': {'integration_step': 5e-3, 'compiled': False}},
        'uncertain': {'friction': {'parameter': 'plant.coulomb_friction', 'uniform': [5, 15]}},
        **more, 'tune': {'law': 'chattering', **more.get('tune', {})}}, Path('spec.yaml'))


@lru_cache(4)
def short_tuning(torque_limit: float = 5e3, percentile: float = 100.0) -> Tuning:
    """Return a search of 12 trials."""
    found = short_spec(tune={'torque_limit': torque_limit})
    return search_gains(found, 12, percentile, 1)

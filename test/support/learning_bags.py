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

"""Setups whose reference learns, and bags of their runs, such as the recorder makes them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bags import entries, Entry, nanoseconds, parameters, write_bag
from ctc_chattering.analysis.result import Result, simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from motion_bags import joint_state, point, trajectory
import numpy as np


def repeated_setup(duration: float = 4.0, control_period: float = 1e-3, **reference: Any
                   ) -> Setup:
    """Return a sinusoid with a period of 0.5 s, under a law that leaves much to learn."""
    return parameter_file.load(None, {
        '/**': {'control_period': control_period, 'compiled': False},
        'plant': {'duration': duration, 'integration_step': control_period},
        'controller': {'law': 'pd_gravity', 'kp': 900.0, 'kv': 60.0},
        'reference': {'amplitude': 0.2, 'frequency': 2.0, **reference}})


def learning_entries(setup: Setup, result: Result) -> list[Entry]:
    """Return what the nodes send in lockstep, with errors and the desired motion."""
    run = result.run
    names = result.joint_names
    times = [nanoseconds(t) for t in run.t]
    found = [*entries(result, setup.plant),
             parameters('reference', 0, setup.reference.as_mapping(), True)]
    labels = [f'{name}/{x}' for x in ('desired', 'error') for name in names]
    for k in range(0, len(times), setup.controller.state_decimation):
        q = np.concatenate([run.q_d[k], run.q_d[k] - run.q[k]])
        dq = np.concatenate([run.dq_d[k], run.dq_d[k] - run.dq[k]])
        found.append(Entry('/controller/tracking', times[k], joint_state(
            times[k], labels, q, dq, None)))
    if setup.reference.learning:
        desired = run.desired
        for begin in range(0, len(times), 25):
            points = [point(times[k] - times[begin], *(x[k] for x in desired))
                      for k in range(begin, min(begin + 25, len(times)))]
            found.append(Entry('/reference/desired', times[begin],
                               trajectory(times[begin], names, points)))
    return found


def record_run(path: Path, setup: Setup) -> Result:
    """Write the bag of a simulated run, and return the run."""
    result = simulate(setup)
    write_bag(path, learning_entries(setup, result))
    return result

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

"""Specs of small maps."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.runs.compare_page import Outcome, outcomes
from ctc_chattering.runs.recommended import LawSettings
from ctc_chattering.runs.run_lists import MapRuns, result_row
from ctc_chattering.runs.score import Score, score
from ctc_chattering.runs.spec import Failure, MapSpec, parse_spec
import pandas  # type: ignore[import-untyped]
import yaml

#: On the reference at the start, so that short runs have small errors.
ON_TRACK = {'initial_position': [3.141592653589793, 1.5707963267948966],
            'initial_velocity': [3.141592653589793, 3.141592653589793]}
#: Two axes, two laws, two draws: 24 runs of a tenth of a second, not compiled.
SMALL: dict[str, Any] = {
    'params_file': 'friction', 'duration': 0.1,
    'overrides': {'plant': {**ON_TRACK, 'velocity_noise': [1e-3, 1e-3], 'compiled': False}},
    'laws': ['compensation', 'chattering implicit'],
    'axes': {'friction': {'parameter': 'plant.coulomb_friction', 'values': [2, 5, 10]},
             'rate': {'parameter': 'control_period', 'values': [1e-3, 2e-3]}},
    'uncertain': {'model': {'parameters': ['controller.inertia_scale', 'controller.gravity_scale'],
                            'uniform': [0.9, 1.1]}},
    'repeats': 2, 'seed': 7}


def spec(**changes: Any) -> MapSpec:
    """Return `SMALL` with other keys; None leaves one out."""
    tree = {key: x for key, x in {**SMALL, **changes}.items() if x is not None}
    return parse_spec(yaml.safe_load(yaml.safe_dump(tree, sort_keys=False)), Path('small.yaml'))


def runs(**changes: Any) -> MapRuns:
    """Return the runs of `spec`."""
    return MapRuns(spec(**changes))


def evaluate(setup: Setup, window: tuple[float, float], failure: Failure) -> dict[str, Any]:
    """Return the columns of a run's results."""
    return result_row(score(setup, window), len(setup.controller.joint_names), failure)


def compared(experiment: str, *results: tuple[LawSettings, float, float, str]) -> list[Outcome]:
    """Return what laws do on two joints: RMS error and torque variation of one, or a failure."""
    return outcomes(pandas.DataFrame([{
        'file': 'friction.yaml', 'experiment': experiment, 'condition': '', 'held_out': 0,
        **x.columns, 'passes_of_run': '[]', 'learning': '',
        'joints': json.dumps((f'1{experiment}', f'2{experiment}')), 'controller': '{}',
        **result_row(Score(failure=failure) if failure else Score(
            (rms, 2.0 * rms), (1.0, 1.0), (variation, 50.0), (1.0, 2.0), (1e3, 2e3), (9.0, 3.0),
            (1.0, 1.0), saturated=0.0, slips=(0.0, 0.0)), 2, Failure())}
        for x, rms, variation, failure in results]))


def written(path: Path, **changes: Any) -> Path:
    """Write `SMALL` with other keys; return the path."""
    path.write_text(yaml.safe_dump({**SMALL, **changes}, sort_keys=False), encoding='utf-8')
    return path


#: 60 runs, each of which the error limit ends at once, and each a chunk of its own.
BRIEF: dict[str, Any] = {
    **SMALL, 'duration': 40.0, 'repeats': 10, 'laws': ['compensation', 'chattering'],
    'axes': {'limit': {'parameter': 'controller.error_limit', 'range': [1e-5, 1e-3], 'count': 3,
                       'spacing': 'log'}}}

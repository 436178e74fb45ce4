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

"""One run of a map: its row of the results, and whether it is a failure."""

from __future__ import annotations

from typing import Any

from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.errors import CtcError
from ctc_chattering.robustness.columns import of_results
from ctc_chattering.robustness.spec import Failure
from ctc_chattering.simulation.registry import make_plant
from ctc_chattering.studies.score import OVERALL, PER_JOINT, Score, score
import numpy as np


def evaluate(setup: Setup, window: tuple[float, float], failure: Failure) -> dict[str, Any]:
    """
    Return the columns of a run's results, `of_results`; None where there is no number.

    Parameters
    ----------
    setup : Setup
        What to run.
    window : (float, float)
        Evaluated interval [s].
    failure : Failure
        What counts as one.

    Raises
    ------
    MachineError
        If the machine cannot run it: that is no property of the run.

    """
    row = {**dict.fromkeys(of_results(len(setup.controller.joint_names))), 'engine': ''}
    if (count := steps(setup)) > failure.steps_above:
        return {**row, 'failure': 'too long', 'reason': (
            f'{count:.3g} steps of the integrator > {failure.steps_above}')}
    found = score(setup, window)
    if found.failure:
        return {**row, 'failure': 'diverged', 'reason': found.failure}
    row.update({f'{key}_{i}': _finite(x) for name, key in PER_JOINT.items()
                for i, x in enumerate(getattr(found, name), 1)})
    row.update({key: _finite(getattr(found, name)) for name, key in OVERALL.items()})
    row.update(engine=found.engine, error=found.error, variation=_finite(found.most_variation),
               saturated=found.saturated, slips=found.most_slips)
    row['failure'], row['reason'] = _judged(found, setup, failure)
    return row


def steps(setup: Setup) -> float:
    """Return how many steps of the integrator a run has; stiff elastic joints have many."""
    plant = setup.plant
    if plant.elastic:
        return make_plant(plant, setup.descriptions.get('plant', '')).steps
    return plant.duration / min(plant.control_period, plant.integration_step)


def refused(n: int, error: CtcError) -> dict[str, Any]:
    """Return the columns of a run of `n` joints whose parameters are not allowed."""
    return {**dict.fromkeys(of_results(n)), 'engine': '', 'failure': 'refused',
            'reason': str(error)}


def _finite(x: float | None) -> float | None:
    return x if x is not None and np.isfinite(x) else None


def _judged(found: Score, setup: Setup, failure: Failure) -> tuple[str, str]:
    """Return kind and reason of a failure; empty for none."""
    if found.error > failure.error_above:
        joint = setup.controller.joint_names[found.rms.index(found.error)]
        return 'error', f'{joint}: {found.error:.3g} > {failure.error_above:g} rad'
    if (found.saturated or 0.0) > failure.saturated_above:
        return 'saturated', (f'a torque at its limit in {found.saturated:.3g} > '
                             f'{failure.saturated_above:g} of the samples')
    if found.most_slips > failure.slips_above:
        return 'slips', f'{found.most_slips:.3g} > {failure.slips_above:g} stick-slips a second'
    if failure.not_reached and found.reaching_time is None:
        return 'not reached', 'v never stays within its band'
    return '', ''

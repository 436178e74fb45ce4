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

"""Margins of parameter files, against the two-link arm in its motion with friction."""

from __future__ import annotations

from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.errors import CtcError
from ctc_chattering.runs.score import score
from ctc_chattering.runs.spec import read_spec
from margin_loops import LAG, loops, REAL_ARM
import pytest


@pytest.mark.slow
def test_the_real_arm_is_stable_where_the_theorem_says() -> None:
    """The two-link arm, which is not linear, in its motion with friction, around the bounds."""
    setup = read_spec(find_config('stability', folder='maps')).setup
    law = {**REAL_ARM, 'ka': [60.0, 30.0], 'estimator_bandwidth': 100.0}
    found = loops(law, LAG, 1)
    exact, guaranteed = found.ratios(), found.guaranteed()
    assert exact is not None
    assert guaranteed is not None
    for ratio, stays in ((0.92 * exact.low, False), (1.05 * guaranteed.low, True),
                         (0.95 * guaranteed.high, True), (0.9 * exact.high, True),
                         (1.05 * exact.high, False)):
        error = score(setup.changed({
            'controller': {**law, 'inertia_scale': ratio},
            'plant': {'actuator_lag': [LAG] * 2}}), (4.0, 6.0)).error
        assert (error < 3e-3) == stays, (ratio, error)


@pytest.mark.slow
@pytest.mark.parametrize('friction', [0.0, 9.9])
def test_with_enough_ka_the_upper_bound_is_sharp(friction: float) -> None:
    """At 0.99 of it the arm follows as with an exact model, at 1.02 it oscillates."""
    setup = read_spec(find_config('stability', folder='maps')).setup
    law = {**REAL_ARM, 'ka': [600.0, 300.0], 'estimator_bandwidth': 100.0}
    span = loops(law, LAG, 1).ratios()
    assert span is not None
    inside, beyond = (score(setup.changed({
        'controller': {**law, 'inertia_scale': ratio * span.high},
        'plant': {'actuator_lag': [LAG] * 2, 'coulomb_friction': [friction] * 2}}),
        (4.0, 6.0)).error for ratio in (0.99, 1.02))
    assert inside < 1e-4
    assert beyond > 4.0 * inside


def test_loops_that_are_not_linear_are_refused() -> None:
    with pytest.raises(CtcError, match='chattering sign is not linear'):
        loops({'switching': 'sign'})
    with pytest.raises(CtcError, match='law pd_gravity: its torque is not proportional'):
        loops({'law': 'pd_gravity'})
    with pytest.raises(CtcError, match='velocity_sensor: filtered is not allowed'):
        loops({'law': 'compensation'}, velocity_sensor='filtered', velocity_cutoff=500.0)
    assert loops(REAL_ARM, velocity_sensor='filtered', velocity_cutoff=500.0).radius() < 1.0

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

"""The recommended poles are damped even where nothing makes up for the lag."""

from __future__ import annotations

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.laws.registry import LAWS
from ctc_chattering.control.recommended_gains import (
    estimator_bandwidth,
    GainChoice,
    GAINS,
    KnownLoop,
    largest_pole,
    lateness,
    model_torque,
    POLE,
    recommended_gains,
    unknown_torque,
)
from ctc_chattering.control.recommended_gains import (
    RECOMMENDED_LAW as LAW,
)
from ctc_chattering.dynamics.two_link import TwoLink
import numpy as np
import pytest


def behind_a_lag(p: float, lag: float) -> float:
    """Return the least damping ratio of e'' = -(2 p e' + p² e) behind a lag."""
    roots = np.roots([lag, 1.0, 2.0 * p, p * p])
    return float((-roots.real / np.abs(roots)).min())


@pytest.mark.parametrize('lag', [1e-4, 2e-3, 1e-2, 0.1])
def test_the_pole_is_damped_behind_a_lag(lag: float) -> None:
    p = largest_pole(lateness(lag, 0.0, -1))
    assert p <= POLE
    assert behind_a_lag(p, lag) > 0.45
    assert behind_a_lag(2.5 / lag, lag) < 0.0


def test_the_observer_is_faster_where_positions_are_fine() -> None:
    assert estimator_bandwidth(100.0, 1e-5) == 200.0
    assert estimator_bandwidth(100.0, 1e-4) == 100.0


def test_ka_has_room_for_a_fifth_of_the_torque_that_the_model_takes_within_the_limits() -> None:
    """Compare with M and G of the two-link arm, written out at its worst positions."""
    config = ControllerConfig(ka=(10.0, 5.0), effort_limit=(1e9, 10.0))
    arm, straight = TwoLink(9.81), [0.0, 0.0]
    most = (np.abs(arm.gravity_torque([0.5 * np.pi, 0.0]))
            + 20.0 * np.diagonal(arm.mass_matrix(straight)))
    found = model_torque(config, arm)
    assert found is not None
    assert found == pytest.approx([most[0], 10.0], rel=0.03)
    known, unknown = (KnownLoop(config, x) for x in (lambda: found, unknown_torque))
    assert recommended_gains(LAW, known)['ka'] == pytest.approx(
        [10.0 + 0.2 * most[0], 7.0], rel=0.03)
    assert recommended_gains(LAW, unknown)['ka'] == (10.0, 5.0)


def test_a_law_takes_gains_of_its_own_kind_and_gets_those_it_had_again() -> None:
    """Go from law to law; those of one kind keep the gains, and what a user sets is not lost."""
    choice, config = GainChoice(), ControllerConfig().changed({'kp': 300.0, 'kv': 40.0, 'ka': 7.0})
    others = [law for law in LAWS if law != LAW]
    assert {law for law in others if choice.of_law(law, config)} == set()
    own = choice.of_law(LAW, config)
    assert own == recommended_gains(LAW, KnownLoop(config))
    tuned = config.changed({**own, 'law': LAW, 'kp': 8100.0, 'estimator_bandwidth': 90.0})
    assert choice.of_law(LAW, tuned) == {}
    back = choice.of_law('integral', tuned)
    assert back == {name: config.as_mapping()[name] for name in GAINS}
    again = choice.of_law(LAW, tuned.changed({**back, 'law': 'integral'}))
    assert (again['kp'], again['estimator_bandwidth']) == ((8100.0, 8100.0), 90.0)
    assert GainChoice().of_law('chattering', tuned) == {'kp': (100.0, 100.0), 'kv': (50.0, 50.0)}

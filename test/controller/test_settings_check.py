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

"""Settings that the diagnostics warn of: each does what the line says, and others do not."""

from __future__ import annotations

from math import inf
from typing import Any

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.control.laws.registry import LAWS
from ctc_chattering.controller.trips import (
    check_change,
    FACTOR,
    missing_limits,
    unsafe_settings,
)
from ctc_chattering.errors import CtcError
from laws import rattles
import numpy as np
import pytest

RATES = [5e3, 1e3]


def found(**values: Any) -> list[str]:
    return list(unsafe_settings(ControllerConfig.from_mapping(values)))


def test_the_defaults_of_every_law_are_not_warned_of() -> None:
    for law in LAWS:
        assert found(law=law, switching='implicit_observer') == []


@pytest.mark.parametrize('lag', [0.0, 1e-3, 5e-3])
def test_the_largest_integral_gain(lag: float) -> None:
    """Check the bound by the poles of T s⁴ + s³ + Kv s² + Kp s + Ki, joint by joint."""
    rng = np.random.default_rng(4)
    for _ in range(20):
        kv = rng.uniform(10.0, 150.0, 2)
        kp = kv * rng.uniform(1.0, 60.0, 2)
        ki = kp * kv * rng.uniform(0.3, 1.2, 2)
        stable = [np.roots([lag, 1.0, *row]).real.max() < 0.0 for row in zip(kv, kp, ki)]
        texts = found(law='integral', kp=kp.tolist(), kv=kv.tolist(), ki=ki.tolist(),
                      actuator_lag=[lag, lag])
        assert len(texts) == stable.count(False)
        assert all(f'joint{i + 1}: ki' in '; '.join(texts) for i in (0, 1) if not stable[i])


@pytest.mark.parametrize('law', ['momentum_observer', 'super_twisting'])
def test_drives_that_are_slower_than_a_law_knows(law: str) -> None:
    """Check that the loop diverges, and does not with the limit that silences the line."""
    assert found(law=law, torque_rate_limit=RATES) != []
    assert found(law=law, torque_rate_limit=RATES, effort_rate_limit=RATES) == []
    assert found(law='observer_feedback', torque_rate_limit=RATES) == []
    known, wild = {'effort_rate_limit': RATES}, dict[str, Any]()
    assert rattles(law, known, wild, duration=1.5, plant={'torque_rate_limit': RATES}, offset=0.1)


def test_joints_without_a_limit_are_named() -> None:
    """Limits of the description count; that of the rate only under the law that takes it."""
    config = ControllerConfig()
    assert missing_limits(config, ()) == 'effort_limit is infinite for joint1, joint2'
    assert missing_limits(config, (50.0, inf)) == 'effort_limit is infinite for joint2'
    assert missing_limits(config.changed({'effort_limit': 50.0}), ()) == ''


#: A parameter, its value in force and another one, and whether that is too much at once.
CHANGES: list[tuple[str, Any, Any, bool]] = [
    ('kp', (100.0, 100.0), (1e4, 1.0), False), ('kp', (100.0, 100.0), (1.1e4, 100.0), True),
    ('kp', (100.0, 100.0), (100.0, 0.9), True), ('kp', (100.0, 100.0), (1e9, 1e9), True),
    ('kp', (100.0, 5.0, 5.0, 100.0), (1e4, 2e3, 2e3, 1e4), False),
    ('kp', (100.0, 5.0, 5.0, 100.0), (1e6, 2e5, 2e5, 1e6), True), ('lambda', 10.0, 1e-3, True),
    ('ka', (0.0, 10.0), (1e3, 1e3), False), ('ka', (0.0, 10.0), (1.1e3, 10.0), True),
    ('ka', (10.0, 10.0), (0.0, 5e-324), True), ('ka', (10.0, 10.0), (0.0, 10.0), False),
    ('friction_level', (0.0, 0.0), (100.0, 100.0), False),
    ('friction_level', (0.0, 0.0), (110.0, 1.0), True),
    ('effort_limit', (inf, 5.0), (5.0, inf), False),
    ('law', 'chattering', 'compensation', False), ('anti_windup', True, False, False)]


@pytest.mark.parametrize(('name', 'before', 'after', 'refused'), CHANGES)
def test_a_large_change_is_refused(name: str, before: Any, after: Any, refused: bool) -> None:
    config = ControllerConfig.from_mapping({name: before})
    try:
        check_change(config, config.changed({name: after}))
    except CtcError as error:
        assert refused and str(error).startswith(f'{name}: ')
        assert f'a factor of at most {FACTOR:g} at once' in str(error)
    else:
        assert not refused

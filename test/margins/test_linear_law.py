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

"""A law as a linear system, compared with the law itself."""

from __future__ import annotations

import sys
from types import ModuleType

from ctc_chattering.control.controller import Controller
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.laws.registry import law_class
from ctc_chattering.margins.linear_law import Frozen, linear_law
import numpy as np
import pytest

#: A reference at rest.
REST = (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)
MASS = np.array([[3.0, 0.8], [0.8, 0.5]])


def test_computed_torque_has_its_gains() -> None:
    found = linear_law(ControllerConfig(law='compensation'), MASS)
    assert found.A.shape == (0, 0)
    assert np.allclose(found.D, -MASS @ np.kron([[100.0, 50.0]], np.eye(2)), rtol=1e-5)


@pytest.mark.parametrize('delay', [0, 2, 3])
def test_it_answers_as_the_law_does(delay: int) -> None:
    """Small noise on the positions of a robot at rest, through the law and through (LL1)."""
    config = ControllerConfig().changed({
        'law': 'observer_feedback', 'kp': [1e4] * 2, 'kv': [200.0] * 2, 'ka': [60.0, 30.0],
        'actuator_lag': [2e-3, 1e-3], 'input_delay': delay, 'torque_rate_limit': [5000.0, 1000.0]})
    found, controller = linear_law(config, MASS), Controller(config, Frozen(MASS))
    assert len(found.A) == 2 * (5 + delay)
    rng = np.random.default_rng(0)
    x = np.zeros(len(found.A))
    for k in range(40):
        y = np.concatenate([1e-8 * rng.standard_normal(2), [0.0, 0.0]]) * (k > 5)
        tau = controller.step(y[:2].tolist(), (0.0, 0.0), *REST, [REST] * delay).tau
        assert tau == pytest.approx(found.C @ x + found.D @ y, rel=1e-3, abs=1e-7)
        x = found.A @ x + found.B @ y


def test_a_rate_of_drives_without_lag_is_no_obstacle() -> None:
    """It bounds large torques only, and so changes nothing of the linear system."""
    config = ControllerConfig().changed({
        'law': 'observer_feedback', 'kp': [1e4] * 2, 'kv': [200.0] * 2, 'ka': [60.0, 30.0],
        'actuator_lag': [0.0, 0.0], 'input_delay': 3})
    free = linear_law(config, MASS)
    limited = linear_law(config.changed({'torque_rate_limit': [50.0, 50.0]}), MASS)
    assert all(np.array_equal(x, y) for x, y in zip(free, limited))


def test_adapted_friction_integrates_the_error() -> None:
    """While there is friction, its level rises and falls alike."""
    found = linear_law(ControllerConfig(law='slotine_li', friction_level=(0.0, 0.0)), MASS)
    assert np.allclose(found.A, np.eye(2))


def test_an_own_law_that_became_another_class_is_not_the_old_one(
        monkeypatch: pytest.MonkeyPatch) -> None:
    """A user changes a law and loads its module again, or runs a notebook's cell again."""
    module = ModuleType('own_laws')
    monkeypatch.setitem(sys.modules, 'own_laws', module)
    config = ControllerConfig(law='own_laws:Law')
    for name in ('compensation', 'integral'):
        monkeypatch.setattr(module, 'Law', law_class(name), raising=False)
        own = linear_law(config, MASS)
        assert own.A.shape == linear_law(ControllerConfig(law=name), MASS).A.shape

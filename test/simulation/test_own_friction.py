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

"""Friction and model of a user's own: those of `examples/`, against scipy's integrator."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
import sys
from types import SimpleNamespace
from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import record
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.simulation.friction import own_friction
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
from oracles import Array, Masses
import pytest
from scipy.integrate import solve_ivp  # type: ignore[import-untyped]

MASSES = np.array([2.0, 0.5])
KF = np.array([4.0, 5.0])


@pytest.fixture(autouse=True)
def examples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / 'examples')


def test_the_fall_of_friction_against_scipy() -> None:
    """Both joints break away and slide; the slower one would stay at rest without the fall."""
    tau = np.array([4.5, -5.5])

    def field(_t: float, x: Array) -> Array:
        v = x[2:]
        friction = np.sign(tau) * (KF - 3.0 * np.abs(v) / (np.abs(v) + 0.05))
        return np.concatenate((v, (tau - friction) / MASSES))

    own = PlantConfig(coulomb_friction=tuple(KF), friction_model='own_friction:Hyperbolic')
    plant = Plant(own, Masses(np.diag(MASSES).tolist()))
    for _ in range(500):
        plant.step(tau)
    exact = solve_ivp(field, (0.0, 0.5), [0.0] * 4, method='DOP853', rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose([*plant.q, *plant.dq], exact.y[:, -1], rtol=1e-7)
    plant = Plant(PlantConfig(coulomb_friction=tuple(KF)), Masses(np.diag(MASSES).tolist()))
    for _ in range(500):
        plant.step(tau)
    assert (np.abs(plant.dq) < 0.5 * np.abs(exact.y[2:, -1])).all()


@pytest.mark.parametrize(('values', 'error'), [
    ({'friction_model': 'hyperbolic'}, ParameterError),
    ({'friction_model': 'own_friction:Hyperbolic', 'joint_stiffness': [1e4, 1e4],
      'motor_inertia': [1.0, 1.0]}, ParameterError),
    ({'friction_model': 'own_friction:none'}, CtcError),
    ({'friction_model': 'nowhere:none'}, CtcError)])
def test_what_is_refused(values: dict[str, Any], error: type[Exception]) -> None:
    with pytest.raises(error, match='friction_model'):
        Plant(PlantConfig.from_mapping(values))


@pytest.mark.parametrize('at_rest', [[0.0], [1.0, 0.0], [float('nan'), 0.0]])
def test_a_friction_at_rest_is_refused(at_rest: list[float], monkeypatch: pytest.MonkeyPatch
                                       ) -> None:
    """It would hold a joint, or push it, where the plant takes the parameters for what holds."""
    @record
    class Wrong(NamedTuple):
        none: float = 0.0

        @classmethod
        def for_joints(cls, _joint_names: Sequence[str]) -> Wrong:
            return cls()

        def resistance(self, *_: object) -> list[float]:
            return at_rest
    monkeypatch.setitem(sys.modules, 'wrong', SimpleNamespace(Friction=Wrong))
    with pytest.raises(CtcError, match='at rest'):
        own_friction('wrong:Friction', ('a', 'b'))


def test_a_friction_with_the_old_name_of_its_constructor(monkeypatch: pytest.MonkeyPatch) -> None:
    @record
    class Old(NamedTuple):
        none: float = 0.0

        @classmethod
        def made(cls, _joint_names: Sequence[str]) -> Old:
            return cls(2.0)

        def resistance(self, velocity: Array, *_: object) -> Array:
            return 0.0 * velocity
    monkeypatch.setitem(sys.modules, 'old', SimpleNamespace(Friction=Old))
    with pytest.warns(FutureWarning, match='Call it for_joints'):
        assert own_friction('old:Friction', ('a', 'b')) == Old(2.0)

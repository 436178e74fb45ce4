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

"""Traits of a law: the package treats a law of the user's as it treats its own."""

from __future__ import annotations

from inspect import isfunction
from pathlib import Path
from typing import Any, NamedTuple

from ctc_chattering.analysis.result import simulate
from ctc_chattering.compiled.compilable import RECORDS
from ctc_chattering.configuration import parameter_file
from ctc_chattering.control.controller import Controller, ControllerConfig, Sample
from ctc_chattering.control.laws.base import Law, law
from ctc_chattering.control.laws.registry import law_class, laws_by_parameter, switchings_of
from ctc_chattering.control.sample import State, Terms
from ctc_chattering.controller.trips import TripMonitor, unsafe_settings
from ctc_chattering.errors import CtcError
from ctc_chattering.runs.recommended import recommended_setup
from ctc_chattering.runs.tune_spec import space
import numpy as np
from oracles import Array
import pytest

OWN = 'own_law:LeakyIntegral'
ZERO = [0.0, 0.0]


@law()
class Undeclared(NamedTuple):
    nothing: float = 0.0

    def terms(self, memory: Any, state: State) -> tuple[Terms, Any]:
        return Terms(state.N, state.zero, state.zero, state.zero), memory


@pytest.fixture(autouse=True)
def examples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(Path(__file__).parents[3] / 'examples')


def config(law: Any = OWN, **values: Any) -> ControllerConfig:
    return ControllerConfig.from_mapping({'law': law, 'compiled': False, **values})


def test_an_own_law_takes_the_parameters_that_it_declares() -> None:
    assert config().takes('ki')
    assert config().takes('effort_limit')
    assert not config().takes('ka')
    assert not config().takes('switching')
    assert config().switching_in_force == ''
    assert OWN not in laws_by_parameter()['ki']


def test_an_own_law_that_declares_none_takes_all() -> None:
    own = config(Undeclared)
    assert all(map(own.takes, own.parameters()))
    assert own.law_parameters == switchings_of(own.law) == ()


def test_tune_searches_what_an_own_law_declares() -> None:
    assert set(space(config())) == {'pole', 'damping', 'ki'}
    assert set(space(config(Undeclared))) == {'pole', 'damping'}


def test_a_result_has_the_gains_that_an_own_law_declares() -> None:
    setup = parameter_file.load(None, {
        'plant': {'duration': 0.01}, 'controller': {'law': OWN, 'ki': 70.0}})
    assert list(simulate(setup).gains) == ['kp', 'kv', 'ki']


def test_a_watched_own_law_trips_when_its_error_grows() -> None:
    far = Sample(ZERO, ZERO, ZERO, ZERO, ZERO, [0.0, 1.1], ZERO, None)

    def trip(law: Any) -> str:
        monitor, controller = TripMonitor(['a', 'b'], 1_000_000), Controller(config(law))
        assert monitor.check(controller, far._replace(e=ZERO)) == ''
        return monitor.check(controller, far._replace(e=[0.0, 1.1]))
    assert trip(OWN).startswith('the position error of b has grown by 1.10 rad')
    assert trip(Undeclared) == ''


def test_an_unbounded_own_law_is_warned_of_where_drives_are_slower() -> None:
    drives = {'torque_rate_limit': [5e3, 1e3]}
    line, = unsafe_settings(config(**drives))
    assert f'the estimate of {OWN} grows' in line
    assert list(unsafe_settings(config(Undeclared, **drives))) == []


def test_a_bound_of_ki_that_an_own_law_says_is_checked() -> None:
    @law(parameters=('ki',))
    class Bounded(NamedTuple):
        nothing: float = 0.0

        @classmethod
        def largest_ki(cls, _config: ControllerConfig) -> Array:
            return np.array([50.0, 200.0])
    globals()['Bounded'] = Bounded
    line, = unsafe_settings(config(f'{__name__}:Bounded', ki=[100.0, 100.0]))
    assert line == 'joint1: ki is 100, but the loop is unstable from 50 on; lower ki'


def test_gains_are_recommended_for_an_own_law_with_a_rule() -> None:
    setup = parameter_file.load(None, {'plant': {
        'actuator_lag': [2e-3, 1e-3], 'torque_rate_limit': [5e3, 1e3],
        'coulomb_friction': [5.0, 1.0]}})
    found = recommended_setup(setup, OWN).controller
    p = 0.3 / (2e-3 + 1e-3 + 0.7 * 1e-3)
    assert p > 60.0  # The fastest that the rule allows.
    assert (found.law, found.kp, found.kv, found.ki) == (
        OWN, (3600.0,) * 2, (120.0,) * 2, (240.0,) * 2)
    assert found.effort_rate_limit == (5e3, 1e3)
    with pytest.raises(CtcError, match='declares no gain_rule'):
        recommended_setup(setup, config(Undeclared).law)


def test_a_constructor_of_the_old_name_is_taken_with_a_warning() -> None:
    with pytest.warns(FutureWarning, match='Old.made is deprecated. Call it from_config.'):
        @law()
        class Old(NamedTuple):
            gain: float

            @classmethod
            def made(cls, _config: ControllerConfig, period: float) -> Old:
                return cls(period)
    kind: Any = Old
    assert kind.from_config(config(), 0.5) == Old(0.5)


def test_no_method_of_a_record_has_the_name_of_a_field() -> None:
    """Compiled code looks up both by their name alone, whatever the class."""
    laws_by_parameter()  # Imports all laws.
    fields = {name for kind in RECORDS for name in kind._fields}  # type: ignore[attr-defined]
    methods = {(kind.__name__, name) for kind in RECORDS for name, x in vars(kind).items()
               if isfunction(x) and not name.startswith('_')}
    assert not {(kind, name) for kind, name in methods if name in fields}


def test_a_law_has_the_defaults_of_what_it_does_not_define() -> None:
    kind = law_class('pd_gravity')
    names = [name for name in vars(Law) if not name.startswith('_')]
    assert all(hasattr(kind, name) for name in names)
    assert not kind.estimates
    assert law_class('integral').estimates

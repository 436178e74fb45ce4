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

"""What is tuned: defaults, limits, ranges, draws; and one line for what is wrong."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.control.controller import LAWS
from ctc_chattering.errors import CtcError
from ctc_chattering.runs.points import Runs
from ctc_chattering.runs.spec import applied
from ctc_chattering.runs.tune_spec import DRAWS, parse_tune, SPACE, TuneSpec
import pytest

LOAD = {'load': {'parameter': 'plant.coulomb_friction', 'uniform': [5.0, 9.0]}}


def spec(tree: dict[str, Any] | None = None, **tune: Any) -> TuneSpec:
    return parse_tune({'duration': 4.0, **(tree or {}), **({'tune': tune} if tune else {})},
                      Path('spec.yaml'))


def test_by_default_the_recommended_law_is_tuned_for_friction_model_lag_and_noise() -> None:
    found = spec()
    config = found.setup.controller
    assert config.law == 'observer_feedback'
    assert set(found.ranges) == {
        'pole', 'damping', 'ka', 'estimator_bandwidth', 'friction_learning'}
    assert {x.name: (x.factor, x.numbers) for x in found.uncertain} == {
        'model': (False, (0.9, 1.1)), 'friction': (True, (0.8, 1.2)),
        'lag': (False, (0.0, 2e-3)), 'noise': (False, (1e-4, 2e-3))}
    assert len(Runs(found).setups) == DRAWS
    assert found.window == (2.0, 4.0)
    assert (found.file.controller.law, found.file.controller.switching) == ('chattering', 'sign')


def test_what_the_file_has_is_uncertain_by_a_factor() -> None:
    """Check lag and noise that are known, and a robot without friction."""
    plant = {'actuator_lag': [0.01, 0.02], 'coulomb_friction': [0.0, 0.0]}
    found = {x.name: x for x in spec({'overrides': {'plant': plant}}).uncertain}
    assert list(found) == ['model', 'lag', 'noise']
    assert (found['lag'].factor, found['lag'].numbers) == (True, (0.8, 1.2))
    assert spec({'uncertain': {}}).uncertain == ()


def test_every_run_starts_smoothly_and_has_no_events() -> None:
    found = parse_tune({'params_file': 'switch'}, Path('spec.yaml'))
    assert parameter_file.load(config_directory() / 'switch.yaml').events
    for setup in (found.file, found.setup, *Runs(found).setups):
        assert setup.events == ()
        assert setup.reference.start_duration == 2.0
    slow = spec({'overrides': {'reference': {'start_duration': 3.0}}})
    assert slow.setup.reference.start_duration == 3.0


def test_draws_are_robots_with_seeds_of_their_own_and_fresh_ones_are_others() -> None:
    found = spec({'uncertain': LOAD, 'repeats': 4, 'seed': 7})
    drawn, fresh = Runs(found), Runs(found.fresh())
    assert len(drawn.setups) == 4
    assert len(fresh.setups) == 16
    for draws in (drawn, fresh):
        for k, ((x,), setup) in enumerate(zip(draws.draws.tolist(), draws.setups)):
            assert 5.0 <= x <= 9.0
            assert setup.plant.coulomb_friction == (x, x)
            assert setup.plant.noise_seed == draws.spec.repeats.seed + k
    seeds = [{x.plant.noise_seed for x in draws.setups} for draws in (drawn, fresh)]
    assert not seeds[0] & seeds[1]
    assert not {*drawn.draws.ravel()} & {*fresh.draws.ravel()}
    assert Runs(found).setups == drawn.setups


def test_limits_are_the_least_of_what_is_known() -> None:
    assert spec().limits == ((5100.0, 850.0), (inf, inf))
    known = {'overrides': {
        'controller': {'effort_limit': [400.0, 900.0], 'effort_rate_limit': [1e4, 1e5]},
        'plant': {'torque_rate_limit': [2e4, 3e4]}}}
    assert spec(known).limits == ((400.0, 850.0), (1e4, 3e4))
    given = spec(known, torque_limit=100, torque_rate_limit=[1e3, 2e3])
    assert given.limits == ((100.0, 100.0), (1e3, 2e3))


def test_a_description_limits_the_torque() -> None:
    assert spec({'params_file': 'panda'}).limits.torque == (87.0,) * 4 + (12.0,) * 3


def test_ranges_are_those_of_the_law_or_of_the_spec() -> None:
    found = spec(law='chattering', search={'pole': [10, 20], 'lambda': 5.0})
    assert found.ranges['pole'][:2] == (10.0, 20.0)
    assert found.ranges['lambda'][:2] == (5.0, 5.0)
    assert found.ranges['ka'] == SPACE['ka']
    chattering = spec(law='chattering').setup.controller
    assert chattering.switching == 'implicit_observer'


@pytest.mark.parametrize('law', LAWS)
def test_every_law_has_gains_that_are_allowed_and_short(law: str) -> None:
    found = spec(law=law)
    numbers = {name: 1.23456789 * x.low for name, x in found.ranges.items()}
    values = found.gains(numbers)
    found.setup.controller.changed(values)
    assert 'b' not in values
    assert {'kp', 'kv'} <= set(values)
    assert values['kp'] == pytest.approx([numbers['pole'] ** 2] * 2, rel=1e-3)
    for value in values.values():
        for x in value if isinstance(value, list) else [value]:
            assert len(f'{x:g}'.replace('.', '').lstrip('0')) <= 4


def test_the_values_to_be_written_have_the_duration_of_the_file() -> None:
    found = spec({'overrides': {'plant': {'velocity_noise': [1e-3, 1e-3]}}})
    assert found.setup.plant.duration == 4.0
    assert found.values['plant']['duration'] == 10.0
    assert list(found.values['plant']['velocity_noise']) == [1e-3, 1e-3]
    assert found.values['reference']['start_duration'] == 2.0


@pytest.mark.parametrize(('tree', 'tune', 'words'), [
    ({'axes': {}}, {}, 'spec: .axes. is not allowed; allowed: a mapping of '),
    ({'laws': ['integral']}, {}, 'spec: .laws. is not allowed'),
    ({'refine': 1}, {}, 'spec: .refine. is not allowed'),
    ({'sampling': 'saltelli', 'repeats': 8}, {}, 'saltelli'),
    ({'tune': {'rate': 1}}, {}, 'tune: .rate. is not allowed; allowed: a mapping of law, '),
    ({'tune': 3}, {}, 'tune: 3 is not allowed'),
    ({}, {'law': 'pid'}, 'tune.law: .pid. is not allowed'),
    ({}, {'law': 'integral', 'switching': 'sign'}, 'tune.switching: .sign. is not allowed'),
    ({}, {'torque_limit': [1.0] * 3}, r'tune.torque_limit: \[1.0, .* is not .*got 3 values'),
    ({}, {'torque_limit': 0}, r'tune.torque_limit: \[0.0, 0.0\] is not allowed'),
    ({}, {'torque_rate_limit': 'high'}, 'tune.torque_rate_limit: .high. is not allowed'),
    ({}, {'search': {'kp': [1, 2]}}, 'tune.search: .kp. is not allowed; .* pole, damping'),
    ({}, {'search': {'pole': [2, 1]}}, r'tune.search.pole: \[2, 1\] is not allowed; .* ascending'),
    ({}, {'search': {'pole': 0}}, r'tune.search.pole: \[0.0, 0.0\] is not allowed'),
    ({}, {'law': 'pid_kalman', 'search': {'lead_ratio': [0.1, 1e4]}},
     'tune.search.lead_ratio: 10000.0 is not allowed'),
    ({'uncertain': {'gain': {'parameter': 'controller.ka', 'uniform': [1, 2]}}}, {},
     'uncertain.gain: controller.ka is tuned'),
    ({'uncertain': {'noise': {'parameter': 'plant.velocity_noise', 'uniform': [-1, 2]}}}, {},
     'noise = -1: '),
    ({'repeats': 0}, {}, 'repeats: 0 is not allowed'),
    ({'params_file': 'nothing'}, {}, 'nothing: no such file')])
def test_what_is_wrong_is_one_line(tree: dict[str, Any], tune: dict[str, Any], words: str
                                   ) -> None:
    with pytest.raises(CtcError, match=words) as caught:
        spec(tree, **tune)
    assert '\n' not in str(caught.value)


def test_a_spec_is_a_mapping() -> None:
    with pytest.raises(CtcError, match='spec: 3 is not allowed; allowed: a mapping of'):
        parse_tune(3, Path('spec.yaml'))


def test_a_setup_of_a_draw_has_the_gains_of_a_candidate_as_if_they_stood_in_the_file() -> None:
    """Check that the order, draw or gains first, does not matter."""
    found = spec({'repeats': 1})
    draws, values = Runs(found), {'kp': [9.0, 9.0], 'ka': [20.0, 20.0]}
    first = found.setup.changed({'controller': values})
    whole = applied(first, zip(found.uncertain, draws.draws[0].tolist()), found.repeats.seed)
    assert draws.setups[0].controller.changed(values) == whole.controller
    assert draws.setups[0].plant == whole.plant

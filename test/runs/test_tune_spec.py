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

"""What is tuned, from a spec or what identify wrote, gains by rule; a line for what is wrong."""

from __future__ import annotations

import json
from math import inf, pi
from pathlib import Path
from typing import Any

from ctc_chattering.cli.ctc import main
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.control.laws.registry import LAWS
from ctc_chattering.errors import CtcError
from ctc_chattering.runs.compare import ComparisonSpec
from ctc_chattering.runs.recommended import gains_by_rule, LawSettings
from ctc_chattering.runs.run_lists import MapRuns
from ctc_chattering.runs.tune_spec import (
    DRAWS,
    first_numbers,
    gains,
    identified_spec,
    parse_tune,
    SPACE,
    space,
    TuneSpec,
)
from identified_bags import recorded_bag, short
import numpy as np
from processes import CONFIG
import pytest
from urdfs import two_links

LOAD = {'load': {'parameter': 'plant.coulomb_friction', 'uniform': [5.0, 9.0]}}


def spec(tree: dict[str, Any] | None = None, **tune: Any) -> TuneSpec:
    return parse_tune({'duration': 4.0, **(tree or {}), **({'tune': tune} if tune else {})},
                      Path('spec.yaml'))


def setups_of(draws: MapRuns) -> list[Setup]:
    return list(map(draws.setup, range(len(draws))))


def test_by_default_the_recommended_law_is_tuned_for_friction_model_lag_and_noise() -> None:
    found = spec()
    config = found.setup.controller
    assert config.law == 'observer_feedback'
    assert set(found.ranges) == {
        'pole', 'damping', 'ka', 'estimator_bandwidth', 'friction_learning'}
    assert {x.name: (x.factor, x.numbers) for x in found.uncertain} == {
        'model': (False, (0.9, 1.1)), 'friction': (True, (0.8, 1.2)),
        'lag': (False, (0.0, 2e-3)), 'noise': (False, (1e-4, 2e-3))}
    assert len(setups_of(MapRuns(found))) == DRAWS
    assert found.window == (2.0, 4.0)
    assert (found.file.controller.law, found.file.controller.switching) == ('chattering', 'sign')


def test_known_lag_and_noise_are_uncertain_by_a_factor() -> None:
    """Check lag and noise that are known, and a robot without friction."""
    plant = {'actuator_lag': [0.01, 0.02], 'coulomb_friction': [0.0, 0.0]}
    found = {x.name: x for x in spec({'overrides': {'plant': plant}}).uncertain}
    assert list(found) == ['model', 'lag', 'noise']
    assert (found['lag'].factor, found['lag'].numbers) == (True, (0.8, 1.2))
    assert spec({'uncertain': {}}).uncertain == ()


def test_every_run_starts_smoothly_and_has_no_events() -> None:
    found = parse_tune({'params_file': 'switch'}, Path('spec.yaml'))
    assert parameter_file.load(config_directory() / 'switch.yaml').events
    for setup in (found.file, found.setup, *setups_of(MapRuns(found))):
        assert setup.events == ()
        assert setup.reference.start_duration == 2.0
    slow = spec({'overrides': {'reference': {'start_duration': 3.0}}})
    assert slow.setup.reference.start_duration == 3.0


def test_fresh_draws_differ_from_those_of_the_search() -> None:
    found = spec({'uncertain': LOAD, 'repeats': 4, 'seed': 7})
    drawn, fresh = MapRuns(found), MapRuns(found.fresh())
    assert len(setups_of(drawn)) == 4
    assert len(setups_of(fresh)) == 16
    for draws in (drawn, fresh):
        for k, ((x,), setup) in enumerate(zip(draws.draws.tolist(), setups_of(draws))):
            assert 5.0 <= x <= 9.0
            assert setup.plant.coulomb_friction == (x, x)
            assert setup.plant.noise_seed == draws.spec.repeats.seed + k
    seeds = [{x.plant.noise_seed for x in setups_of(draws)} for draws in (drawn, fresh)]
    assert not seeds[0] & seeds[1]
    assert not {*drawn.draws.ravel()} & {*fresh.draws.ravel()}
    assert setups_of(MapRuns(found)) == setups_of(drawn)


def test_limits_are_the_least_of_the_known_ones() -> None:
    assert spec().limits == ((5100.0, 850.0), (inf, inf))
    known = {'overrides': {
        'controller': {'effort_limit': [400.0, 900.0], 'effort_rate_limit': [1e4, 1e5]},
        'plant': {'torque_rate_limit': [2e4, 3e4]}}}
    assert spec(known).limits == ((400.0, 850.0), (1e4, 3e4))
    given = spec(known, torque_limit=100, torque_rate_limit=[1e3, 2e3])
    assert given.limits == ((100.0, 100.0), (1e3, 2e3))


def test_ranges_are_those_of_the_law_or_of_the_spec() -> None:
    found = spec(law='chattering', search={'pole': [10, 20], 'lambda': 5.0})
    assert found.ranges['pole'][:2] == (10.0, 20.0)
    assert found.ranges['lambda'][:2] == (5.0, 5.0)
    assert found.ranges['ka'] == SPACE['ka']
    chattering = spec(law='chattering').setup.controller
    assert chattering.switching == 'implicit_observer'


@pytest.mark.parametrize(('tree', 'tune', 'words'), [
    ({'axes': {}}, {}, 'spec: .axes. is not allowed; allowed: a mapping of '),
    ({'sampling': 'saltelli', 'repeats': 8}, {}, 'saltelli'),
    ({'tune': {'rate': 1}}, {}, 'tune: .rate. is not allowed; allowed: a mapping of law, '),
    ({}, {'law': 'pid'}, 'tune.law: .pid. is not allowed'),
    ({}, {'law': 'integral', 'switching': 'sign'}, 'tune.switching: .sign. is not allowed'),
    ({}, {'torque_limit': [1.0] * 3}, r'tune.torque_limit: \[1.0, .* is not .*got 3 values'),
    ({}, {'search': {'kp': [1, 2]}}, 'tune.search: .kp. is not allowed; .* pole, damping'),
    ({}, {'search': {'pole': [2, 1]}}, r'tune.search.pole: \[2, 1\] is not allowed; .* ascending'),
    ({}, {'law': 'pid_kalman', 'search': {'lead_ratio': [0.1, 1e4]}},
     'tune.search.lead_ratio: 10000.0 is not allowed'),
    ({'uncertain': {'gain': {'parameter': 'controller.ka', 'uniform': [1, 2]}}}, {},
     'uncertain.gain: controller.ka is tuned'),
    ({'uncertain': {'noise': {'parameter': 'plant.velocity_noise', 'uniform': [-1, 2]}}}, {},
     'noise = -1: '),
    ({'params_file': 'nothing'}, {}, 'nothing: there is no such file')])
def test_an_error_in_a_spec_is_one_line(
        tree: dict[str, Any], tune: dict[str, Any], words: str) -> None:
    with pytest.raises(CtcError, match=words) as caught:
        spec(tree, **tune)
    assert '\n' not in str(caught.value)


FRICTION = (9.9, 4.0)
TUNED = [x for x in ComparisonSpec(['friction']).law_settings if not x.is_recommended]


def config_of(variant: LawSettings) -> ControllerConfig:
    return ControllerConfig(**variant.parameters, observer_bandwidth=1200.0, ka=(12.0, 3.0),
                            kp=(225.0, 225.0), kv=(40.0, 40.0), friction_lead=0.01)


@pytest.mark.parametrize('variant', TUNED, ids=lambda x: x.switching or x.law)
def test_the_first_trial_has_the_gains_of_the_file_the_second_those_that_are_recommended(
        variant: LawSettings) -> None:
    config = config_of(variant)
    known = {'kp': [1e4, 1e4], 'kv': [200.0, 200.0], 'ka': [24.0, 6.0],
             'estimator_bandwidth': 90.0}
    file, better = first_numbers(config, FRICTION, known, space(config))
    first = config.changed(gains(file, config, FRICTION))
    expected = config
    for name, value in first.as_mapping().items():
        if name == 'adaptation_gain' and first.takes(name):
            assert value == pytest.approx((100.0, 100.0 * 4.0 / 9.9))  # As joint 1 has it.
        else:
            assert value == (pytest.approx(expected.as_mapping()[name])
                             if name in gains(file, config, FRICTION) else
                             expected.as_mapping()[name])
    second = config.changed(gains(better, config, FRICTION))
    assert second.kp == pytest.approx((1e4, 1e4))
    assert second.kv == pytest.approx((200.0, 200.0))
    if config.takes('ka'):
        assert second.ka == pytest.approx((24.0, 6.0))
    if variant.switching == 'implicit_observer':
        assert second.observer_bandwidth == pytest.approx(200.0)
    if variant.law == 'observer_feedback':
        assert second.estimator_bandwidth == pytest.approx(90.0)


@pytest.mark.parametrize('variant', TUNED, ids=lambda x: x.switching or x.law)
def test_all_ends_of_ranges_are_allowed_and_every_gain_is_searched(
        variant: LawSettings) -> None:
    config = config_of(variant)
    for end in (0, 1):
        config.changed(gains({name: r[:2][end] for name, r in space(config).items()}, config,
                             FRICTION))
    taken = {name for name, spec in config.parameters().items()
             if config.law in spec.laws and spec.kind.startswith('float')}
    of_others = {'boundary_layer', 'observer_bandwidth'} - {
        {'boundary_layer': 'boundary_layer', 'implicit_observer': 'observer_bandwidth'}.get(
            variant.switching)}
    given = {'friction_level', 'actuator_lag', 'torque_rate_limit', 'b'}
    assert set(space(config)) - {'pole', 'damping'} == taken - of_others - given


def test_recommended_settings_follow_lag_delay_and_the_model() -> None:
    """Check ka against the torque of the paper's equations on its sinusoid, by finite steps."""
    slow = {'actuator_lag': [0.006, 0.001], 'input_delay': 1}
    setup = parameter_file.load(CONFIG / 'friction.yaml', {'controller': slow})
    found = gains_by_rule(setup, 'observer_feedback')
    pole = 0.4 / (0.006 + 2 * 0.001)
    assert found['kp'] == pytest.approx([pole ** 2] * 2)
    assert found['kv'] == pytest.approx([2.0 * pole] * 2)
    assert found['estimator_bandwidth'] == pytest.approx(2.0 * pole)
    known = parameter_file.load(CONFIG / 'friction.yaml')
    assert gains_by_rule(known, 'observer_feedback')['kp'] == (1e4, 1e4)
    t = np.linspace(0.0, 1.0, 2001)
    a, w = 0.5 * np.sin(2 * pi * t), 2 * pi
    q1, q2, v, acc = pi + a, 0.5 * pi + a, 0.5 * w * np.cos(w * t), -w * w * a
    c2, s2, g = np.cos(q2), np.sin(q2), 9.81
    tau1 = ((8.77 + 1.02 * c2 + 0.76 + 0.51 * c2) * acc - 0.51 * s2 * 3.0 * v * v
            + g * (7.6 * np.sin(q1) + 0.63 * np.sin(q1 + q2)))
    tau2 = (0.76 + 0.51 * c2 + 0.62) * acc + 0.51 * s2 * v * v + g * 0.63 * np.sin(q1 + q2)
    assert gains_by_rule(known, 'observer_feedback')['ka'] == pytest.approx(
        [10.0 + 0.2 * np.abs(tau1).max(), 10.0 + 0.2 * np.abs(tau2).max()], rel=0.01)


def test_gains_by_rule_follow_what_the_controller_knows() -> None:
    """Check pid_kalman by hand, and that every law becomes slower with a larger delay."""
    known = {'actuator_lag': [2e-3, 1e-3], 'input_delay': 1, 'friction_level': [9.9, 9.9],
             'torque_rate_limit': [5e3, 1e3]}
    late, reversal = 2e-3 + 1e-3 * 2, 9.9 / 1e3
    p = 0.41 / (late + 0.7 * reversal)
    for law in (x for x in LAWS if x != 'chattering'):
        setups = [parameter_file.load(CONFIG / 'friction.yaml', {
            'controller': {**known, 'law': law, 'input_delay': delay}}) for delay in (1, 5)]
        found, slower = map(gains_by_rule, setups)
        assert max(slower['kp']) < min(found['kp'])
        for setup, values in zip(setups, (found, slower)):
            assert setup.controller.changed(values).law == law
        if law == 'pid_kalman':
            assert {x: found[x] for x in ('kp', 'kv', 'ki')} == {
                'kp': pytest.approx([3.3 * p ** 2] * 2), 'kv': pytest.approx([2.4 * p] * 2),
                'ki': pytest.approx([1.5 * p ** 3] * 2)}
            assert found['estimator_bandwidth'] == pytest.approx(8.6 * p)
            assert found['friction_lead'] == pytest.approx(1.25 * late + 0.45 * reversal)


NONE = {'value': None, 'reason': 'none shows'}


def number(value: float, half: float) -> dict[str, Any]:
    return {'value': value, 'interval_95': [value - half, value + half]}


def possible(delay: int, *lags: tuple[float, float]) -> dict[str, Any]:
    """Return a delay with the intervals of its lags."""
    return {'delay_samples': delay, 'actuator_lag_interval_95_s': lags}


def contents(**more: Any) -> dict[str, Any]:
    """Return the contents of identify.json that are read."""
    return {
        'joint_names': ['a', 'b'], 'delay_samples': 1,
        'delays_possible': [possible(1, (1e-3, 3e-3), (2e-3, 6e-3))],
        'friction': [{'coulomb': number(10.0, 1.0), 'viscous': number(2.0, 0.1)},
                     {'coulomb': number(4.0, 1.0), 'viscous': NONE}],
        'bodies_uncertainty': 0.02, **more}


def written(folder: Path, found: Any) -> Path:
    """Write a directory of `ctc identify` for a robot of a URDF."""
    urdf = folder / 'robot.urdf'
    urdf.write_text(two_links())
    both = {'joint_names': ['a', 'b'], 'model': 'urdf', 'description': str(urdf)}
    parameter_file.dump({
        '/**': both, 'plant': {'duration': 1.0, 'coulomb_friction': [10.0, 4.0],
                               'viscous_friction': [2.0, 0.0], 'actuator_lag': [2e-3, 4e-3],
                               'input_delay': 1},
        'reference': {'center': [0.0, 0.0], 'amplitude': [0.1, 0.1], 'frequency': [0.5, 0.5]}},
        folder / 'identified.yaml')
    (folder / 'identify.json').write_text(found if isinstance(found, str) else json.dumps(found))
    return folder


def ranges(spec: TuneSpec) -> dict[str, Any]:
    return {x.name: pytest.approx(x.numbers) for x in spec.uncertain}


def test_friction_is_drawn_within_its_widest_interval(tmp_path: Path) -> None:
    found = identified_spec(written(tmp_path, contents()), {'repeats': 64})
    assert ranges(found) == {'coulomb': (0.75, 1.25), 'viscous': (0.95, 1.05),
                             'lag': (1e-3, 6e-3), 'model': (0.95, 1.05)}
    setups = setups_of(MapRuns(found))
    for k, (low, high) in enumerate(((7.5, 12.5), (3.0, 5.0))):
        drawn = [x.plant.coulomb_friction[k] for x in setups]
        assert low <= min(drawn) < low + 0.05 * low
        assert high - 0.05 * high < max(drawn) <= high
    assert {x.controller.input_delay for x in setups} == {0}


def test_every_delay_that_is_possible_is_drawn_and_all_lags_with_any_of_them(
        tmp_path: Path) -> None:
    pairs = {0: ((3e-3, 4e-3), (5e-3, 7e-3)), 1: ((2e-3, 3e-3), (4e-3, 5e-3)),
             2: ((-1e-4, 1e-3), (1e-3, 1e-3))}
    spec = identified_spec(written(tmp_path, contents(delay_samples=None, delays_possible=[
        possible(delay, *lags) for delay, lags in pairs.items()])), {'repeats': 64})
    assert ranges(spec)['delay'] == (0.0, 1.0, 2.0)
    assert ranges(spec)['lag'] == (0.0, 7e-3)
    plants = [x.plant for x in setups_of(MapRuns(spec))]
    for delay in pairs:
        assert sum(x.input_delay == delay for x in plants) > 15
    drawn = [x.actuator_lag[0] for x in plants]
    assert min(drawn) < 5e-4 and max(drawn) > 6.5e-3


def test_uncertain_bodies_widen_the_model_scale(tmp_path: Path) -> None:
    spec = identified_spec(written(tmp_path, contents(bodies_uncertainty=0.12)), {})
    assert ranges(spec)['model'] == (0.88, 1.12)


@pytest.mark.parametrize('text', ['{', '[]', '3', '{}', '{"friction": 1}', '{"friction": [{}]}'])
def test_another_file_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    with pytest.raises(CtcError, match=r'identify\.json: not a file of ctc identify$'):
        identified_spec(written(tmp_path, text), {})


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(CtcError, match=r'identified.yaml: No such file'):
        identified_spec(tmp_path, {})
    (written(tmp_path, contents()) / 'identify.json').unlink()
    with pytest.raises(CtcError, match=r'identify.json: No such file'):
        identified_spec(tmp_path, {})


def test_the_output_of_identify_is_read(tmp_path: Path) -> None:
    made = short(duration=3.0)
    bag = recorded_bag(tmp_path / 'bag', made)
    out = tmp_path / 'identified'
    assert main(['identify', str(bag), '--model', 'two_link', '--trials', '0',
                 '--out', str(out)]) == 0
    spec = identified_spec(out, {'repeats': 8})
    assert [x.name for x in spec.uncertain] == ['coulomb', 'viscous', 'lag', 'model']
    assert max(spec.file.controller.torque_rate_limit) < inf
    assert set(spec.limits.rate) == {inf}, 'the rate of the drives is not known'
    given = identified_spec(out, {'tune': {'torque_rate_limit': 700.0}})
    assert set(given.limits.rate) == {700.0}
    found = json.loads((out / 'identify.json').read_text())
    for k, friction in enumerate(found['friction']):
        low, high = friction['coulomb']['interval_95']
        middle = friction['coulomb']['value']
        drawn = [x.plant.coulomb_friction[k] for x in setups_of(MapRuns(spec))]
        assert min(drawn) > middle - 5.0 * (high - low)
        assert max(drawn) < middle + 5.0 * (high - low)
        assert len(set(drawn)) == 8

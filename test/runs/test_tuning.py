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

"""The search for gains: optimum, cost, ranges, reproducibility; and the recommended settings."""

from __future__ import annotations

from math import pi
import sys

from ctc_chattering.cli.ctc import main
from ctc_chattering.configuration import parameter_file
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import UsageError
from ctc_chattering.runs.compare import FILE, Variant, variants
from ctc_chattering.runs.recommended import by_rule, recommended, RULES
from ctc_chattering.runs.score import Score, worst
from ctc_chattering.runs.tune import require_optuna
from ctc_chattering.runs.tune_spec import gains, space, starts
import numpy as np
from processes import CONFIG
import pytest

FRICTION = (9.9, 4.0)
TUNED = [x for x in variants() if x.settings == FILE]


def measurement(rms: float, variation: float, rate: float) -> Score:
    return Score((rms, 2.0 * rms), (), (variation,) * 2, (1.0, 1.0), (rate,) * 2, (5.0, 5.0))


def test_the_worst_of_runs_counts_joint_by_joint() -> None:
    a, b = measurement(1.0, 5.0, 7.0), measurement(0.5, 9.0, 6.0)
    found = worst([a, b._replace(rms=(0.5, 8.0))])
    assert found.rms == (1.0, 8.0)
    assert (found.variation, found.rate) == ((9.0, 9.0), (7.0, 7.0))


def config_of(variant: Variant) -> ControllerConfig:
    return ControllerConfig(**variant.values, observer_bandwidth=1200.0, ka=(12.0, 3.0),
                            kp=(225.0, 225.0), kv=(40.0, 40.0), friction_lead=0.01)


@pytest.mark.parametrize('variant', TUNED, ids=lambda x: x.switching or x.law)
def test_the_first_trial_has_the_gains_of_the_file_the_second_those_that_are_recommended(
        variant: Variant) -> None:
    config = config_of(variant)
    known = {'kp': [1e4, 1e4], 'kv': [200.0, 200.0], 'ka': [24.0, 6.0],
             'estimator_bandwidth': 90.0}
    file, better = starts(config, FRICTION, known, space(config))
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
def test_all_that_may_be_tried_is_allowed_and_every_gain_of_the_law_is_searched(
        variant: Variant) -> None:
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


def test_without_optuna_it_is_said_how_to_get_it(
        monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, 'optuna', None)
    with pytest.raises(UsageError, match=r'pip install optuna'):
        require_optuna('it')
    assert main(['tune', 'friction']) == 2
    assert capsys.readouterr().err == (
        "ctc tune: ctc tune needs Optuna: pip install optuna, or '.[tune]' from the checkout\n")


def test_recommended_settings_follow_lag_delay_and_the_model() -> None:
    """Check ka against the torque of the paper's equations on its sinusoid, by finite steps."""
    slow = {'actuator_lag': [0.006, 0.001], 'input_delay': 1}
    setup = parameter_file.load(CONFIG / 'friction.yaml', {'controller': slow})
    found = recommended(setup)
    pole = 0.4 / (0.006 + 2 * 0.001)
    assert found['kp'] == pytest.approx([pole ** 2] * 2)
    assert found['kv'] == pytest.approx([2.0 * pole] * 2)
    assert found['estimator_bandwidth'] == pytest.approx(2.0 * pole)
    known = parameter_file.load(CONFIG / 'friction.yaml')
    assert recommended(known)['kp'] == (1e4, 1e4)
    t = np.linspace(0.0, 1.0, 2001)
    a, w = 0.5 * np.sin(2 * pi * t), 2 * pi
    q1, q2, v, acc = pi + a, 0.5 * pi + a, 0.5 * w * np.cos(w * t), -w * w * a
    c2, s2, g = np.cos(q2), np.sin(q2), 9.81
    tau1 = ((8.77 + 1.02 * c2 + 0.76 + 0.51 * c2) * acc - 0.51 * s2 * 3.0 * v * v
            + g * (7.6 * np.sin(q1) + 0.63 * np.sin(q1 + q2)))
    tau2 = (0.76 + 0.51 * c2 + 0.62) * acc + 0.51 * s2 * v * v + g * 0.63 * np.sin(q1 + q2)
    assert recommended(known)['ka'] == pytest.approx(
        [10.0 + 0.2 * np.abs(tau1).max(), 10.0 + 0.2 * np.abs(tau2).max()], rel=0.01)


def test_gains_by_rule_follow_what_the_controller_knows() -> None:
    """Check pid_kalman by hand, and that every law becomes slower with a larger delay."""
    known = {'actuator_lag': [2e-3, 1e-3], 'input_delay': 1, 'friction_level': [9.9, 9.9],
             'torque_rate_limit': [5e3, 1e3]}
    late, reversal = 2e-3 + 1e-3 * 2, 9.9 / 1e3
    p = 0.41 / (late + 0.7 * reversal)
    for law in (*RULES, 'observer_feedback'):
        setups = [parameter_file.load(CONFIG / 'friction.yaml', {
            'controller': {**known, 'law': law, 'input_delay': delay}}) for delay in (1, 5)]
        found, slower = map(by_rule, setups)
        assert max(slower['kp']) < min(found['kp'])
        for setup, values in zip(setups, (found, slower)):
            assert setup.controller.changed(values).law == law
        if law == 'pid_kalman':
            assert {x: found[x] for x in ('kp', 'kv', 'ki')} == {
                'kp': pytest.approx([3.3 * p ** 2] * 2), 'kv': pytest.approx([2.4 * p] * 2),
                'ki': pytest.approx([1.5 * p ** 3] * 2)}
            assert found['estimator_bandwidth'] == pytest.approx(8.6 * p)
            assert found['friction_lead'] == pytest.approx(1.25 * late + 0.45 * reversal)

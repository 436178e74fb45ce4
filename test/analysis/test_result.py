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

"""Runs and their numbers."""

from __future__ import annotations

import dataclasses
import math

from ctc_chattering.analysis.output import finite
from ctc_chattering.analysis.result import Result, simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.control.controller import Controller
from ctc_chattering.simulation import closed_loop
import numpy as np
import pytest

#: As in metrics.json, by contract.
KEYS = ['experiment', 'law', 'switching', 'control_period_s', 'window_s', 'rms_error_rad',
        'max_error_norm1_rad', 'rms_torque_nm', 'torque_variation_nm_per_s',
        'max_torque_step_nm', 'max_torque_rate_nm_per_s', 'reaching_time_s', 'bag', 'joint_names',
        'position_units', 'torque_units', 'gains', 'missing_samples', 'term_at_bound', 'notes']


def result_of(duration: float, *events: str, **controller: object) -> Result:
    return simulate(parameter_file.load(None, {
        'plant': {'duration': duration, 'experiment': 'trial'}, 'controller': controller,
        '/**': {'control_period': 0.002}, 'bringup': {'events': list(events)}}))


@pytest.mark.parametrize('duration', [0.1, 5.5])
def test_keys_are_the_contract_s(duration: float) -> None:
    """Check names and shapes, also for a run that ends before the window."""
    m = result_of(duration, law='compensation').metrics()
    assert sorted(m) == sorted(KEYS)
    assert (m['experiment'], m['law'], m['control_period_s']) == ('trial', 'compensation', 0.002)
    assert (m['switching'], m['window_s']) == ('sign', [5.0, 10.0])
    per_joint = [m[key] for key in KEYS if key.startswith(('rms', 'torque_v', 'max_t'))]
    if duration > 5.0:
        assert all(len(x) == 2 and all(y > 0.0 for y in x) for x in per_joint)
        assert m['max_error_norm1_rad'] > 0.0
    else:
        assert per_joint == [None] * 5
        assert m['max_error_norm1_rad'] is None


def test_label_slug_and_changes() -> None:
    plain = result_of(0.1, law='compensation')
    assert (plain.label, plain.slug, plain.changes) == (
        'trial: compensation', 'trial_compensation', [])
    events = ('0.02 controller law chattering', '0.04 controller ka [1.0, 2.0]',
              '0.06 controller law compensation', '0.07 plant coulomb_friction [0.0, 0.0]')
    result = result_of(0.1, *events, law='compensation')
    assert result.label == 'trial: compensation → chattering → compensation'
    assert result.slug == 'trial'
    assert result.changes == [(0.02, 'chattering'), (0.06, 'compensation')]
    assert result.law == 'compensation'
    assert result.joint_names == ('joint1', 'joint2')
    assert [t for t, _ in result.configs] == [0.0, 0.02, 0.04, 0.06]
    assert result.configs[2][1].ka == (1.0, 2.0)
    changed = result_of(0.1, '0.05 controller law chattering', law='compensation')
    assert changed.metrics()['law'] == changed.law == 'chattering'
    marked = result_of(0.05, '0.01 controller switching implicit', '0.02 controller ka [3, 4]',
                       '0.03 controller law compensation')
    assert marked.marks == [(0.01, 'implicit'), (0.03, 'compensation')]


def test_simulated_is_the_core_s_simulation() -> None:
    """Check the samples against the core, and the parts of the torque against their sum."""
    setup = parameter_file.load(None, {'plant': {'duration': 0.1}, 'bringup': {
        'events': ['0.03 controller law compensation', '0.05 plant coulomb_friction [1, 2]']}})
    seen: list[float] = []
    result = simulate(setup, seen.append)
    expected = closed_loop.simulate(setup.plant, setup.controller, setup.reference, setup.events)
    for field in dataclasses.fields(expected):
        np.testing.assert_array_equal(
            getattr(result.run, field.name), getattr(expected, field.name))
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(0.1)
    terms = result.terms
    np.testing.assert_array_equal(terms.tau, result.run.tau)
    np.testing.assert_array_equal(terms.v, result.run.v)
    assert np.abs(terms.robust[:30]).max() == pytest.approx(10.0)
    assert not terms.robust[30:].any()
    model = Controller(setup.controller).model
    v = terms.v[7]
    mass = np.array(model.mass_matrix(result.run.q[7].tolist()))
    assert terms.lyapunov[7] == pytest.approx(0.5 * v @ mass @ v)
    assert result.terms is terms


def test_finite() -> None:
    """Check that what JSON cannot say becomes null, however deep."""
    assert finite({'a': [1.0, math.nan, (math.inf, 'x')], 'b': -math.inf, 'c': 3, 'd': None}) == {
        'a': [1.0, None, [None, 'x']], 'b': None, 'c': 3, 'd': None}


def test_a_result_is_printed_in_a_line() -> None:
    start = '<trial: chattering: '
    assert repr(result_of(0.1)) == f'{start}51 samples, RMS error - from 5 to 10 s>'
    assert repr(result_of(6.0)).startswith(f'{start}3001 samples, RMS error ')

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

"""A run with its numbers, notes, label and changes of law."""

from __future__ import annotations

import dataclasses

from ctc_chattering.analysis.result import Result, simulate
from ctc_chattering.analysis.terms import terms
from ctc_chattering.configuration import parameter_file
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.simulation.closed_loop import Run, run_closed_loop
import numpy as np
import pytest

#: Keys of metrics.json, by contract.
KEYS = ['experiment', 'law', 'switching', 'control_period_s', 'window_s', 'rms_error_rad',
        'max_error_norm1_rad', 'rms_torque_nm', 'torque_variation_nm_per_s',
        'max_torque_step_nm', 'max_torque_rate_nm_per_s', 'reaching_time_s', 'bag', 'joint_names',
        'position_units', 'torque_units', 'gains', 'missing_samples', 'term_at_bound', 'origins',
        'notes']


def result_of(duration: float, *events: str, **controller: object) -> Result:
    return simulate(parameter_file.load(None, {
        'plant': {'duration': duration, 'experiment': 'trial'}, 'controller': controller,
        '/**': {'control_period': 0.002}, 'bringup': {'events': list(events)}}))


def notes_with_errors(*rms_errors: float, amplitude: float = 0.5, law: str = 'compensation'
                      ) -> list[str]:
    """Return the notes on a sinusoid with constant errors."""
    t = np.linspace(0.0, 10.0, 10_001)
    q_d = amplitude * np.sin(2.0 * t)[:, None] + np.zeros(2)
    zero = np.zeros_like(q_d)
    config = ControllerConfig(law=law)
    run = Run(t, q_d - np.array(rms_errors), zero, q_d, zero, zero, zero, zero)
    computed = terms(run, [(0.0, config)], model_of(config))
    notes: list[str] = Result('trial', [(0.0, config)], run, computed).metrics()['notes']
    return [x for x in notes if 'amplitude of the motion' in x]


def test_a_note_on_errors_above_a_tenth_of_the_amplitude() -> None:
    """Beyond a tenth of the amplitude, half the range; a joint that is to rest has none."""
    assert not notes_with_errors(0.049, 0.0)
    assert notes_with_errors(0.051, 0.0) == [
        'joint1: the RMS error is 10 % of the amplitude of the motion. Choose a law that takes '
        'friction into account (docs/laws.md), or raise kp and kv']
    assert notes_with_errors(0.078, 0.2, law='chattering') == [
        'joint1, joint2: the RMS error is 16 to 40 % of the amplitude of the motion. Set ka above '
        'friction and disturbance, or raise kp and kv']
    assert not notes_with_errors(0.078, 0.078, amplitude=0.0)


def test_metrics_have_the_keys_of_the_contract() -> None:
    m = result_of(5.5, law='compensation').metrics()
    assert sorted(m) == sorted(KEYS)
    assert [m[x] for x in ('experiment', 'law', 'control_period_s', 'switching', 'window_s')] == [
        'trial', 'compensation', 0.002, 'sign', [5.0, 10.0]]
    per_joint = [m[key] for key in KEYS if key.startswith(('rms', 'torque_v', 'max_t'))]
    assert all(len(x) == 2 and all(y > 0.0 for y in x) for x in per_joint)
    assert m['max_error_norm1_rad'] > 0.0


def test_label_slug_and_changes() -> None:
    plain = result_of(0.1, law='compensation')
    assert (plain.label, plain.slug, plain.changes) == (
        'trial: compensation', 'trial_compensation', [])
    assert repr(plain) == (
        '<trial: compensation: 51 samples, RMS error 2.85 1.47 from 0.05 to 0.1 s>')
    result = result_of(
        0.1, '0.02 controller law chattering', '0.03 controller switching implicit',
        '0.04 controller ka [1.0, 2.0]', '0.06 controller law compensation',
        '0.07 plant coulomb_friction [0.0, 0.0]', law='compensation')
    assert result.label == 'trial: compensation → chattering → compensation'
    assert result.slug == 'trial'
    assert result.changes == [(0.02, 'chattering'), (0.06, 'compensation')]
    assert result.marks == [(0.02, 'chattering'), (0.03, 'implicit'), (0.06, 'compensation')]
    assert result.metrics()['law'] == result.law == 'compensation'
    assert [t for t, _ in result.configs] == [0.0, 0.02, 0.03, 0.04, 0.06]
    assert result.configs[3][1].ka == (1.0, 2.0)


def test_simulate_gives_the_run_of_the_closed_loop() -> None:
    setup = parameter_file.load(None, {'plant': {'duration': 0.1}, 'bringup': {
        'events': ['0.03 controller law compensation', '0.05 plant coulomb_friction [1, 2]']}})
    seen: list[float] = []
    result = simulate(setup, seen.append)
    expected = run_closed_loop(setup.plant, setup.controller, setup.reference, setup.events)
    for field in dataclasses.fields(expected):
        np.testing.assert_array_equal(
            getattr(result.run, field.name), getattr(expected, field.name))
    assert seen == sorted(seen) and seen[-1] == pytest.approx(0.1)
    np.testing.assert_array_equal(result.terms.tau, result.run.tau)

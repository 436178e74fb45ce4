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

"""Numbers of a run against tiny arrays worked out by hand."""

from collections.abc import Sequence
import dataclasses

from ctc_chattering.analysis.metrics import (
    BAND,
    error_shares,
    metrics,
    reaching_time,
    WINDOW,
    window_of,
)
from ctc_chattering.analysis.signals import Series, SignalOrigin
from ctc_chattering.simulation.closed_loop import Run
import numpy as np
import pytest


def _run(t: Sequence[float], e: Sequence[Sequence[float]], tau: Sequence[Sequence[float]],
         v: Sequence[Sequence[float]]) -> Run:
    errors = np.array(e, dtype=float).reshape(len(t), -1)
    q_d = np.full_like(errors, 0.25)
    zero = np.zeros_like(errors)
    return Run(np.array(t, dtype=float), q_d - errors, zero, q_d, zero, zero,
               np.array(tau, dtype=float), np.array(v, dtype=float))


TINY = _run(
    t=[4.0, 5.0, 6.0, 7.0, 10.0, 11.0],
    e=[[99, 99], [3, -2], [-4, 0], [0, 1], [0, -2], [99, 99]],
    tau=[[99, 99], [1, 2], [-1, 2], [5, 2], [5, -8], [99, 99]],
    v=[[1, 0], [0, -2], [0.1, 0.15], [-0.15, 0], [0, 0.1], [0, 0]])


def test_by_hand() -> None:
    """Check every number; samples outside the window (99) must not count."""
    found = metrics(TINY)
    assert WINDOW == (5.0, 10.0)
    assert BAND == 0.15
    assert found['window_s'] == [5.0, 10.0]
    assert found['rms_error_rad'] == pytest.approx([2.5, np.sqrt(9 / 4)])
    assert found['max_error_norm1_rad'] == pytest.approx(5.0)
    assert found['rms_torque_nm'] == pytest.approx([np.sqrt(52 / 4), np.sqrt(76 / 4)])
    assert found['torque_variation_nm_per_s'] == pytest.approx([8 / 5, 10 / 5])
    assert found['max_torque_step_nm'] == [6.0, 10.0]
    assert found['max_torque_rate_nm_per_s'] == pytest.approx([6.0, 10 / 3])
    assert found['reaching_time_s'] == 6.0


def test_errors_are_those_from_the_motion_without_what_was_learned() -> None:
    correction = np.zeros((6, 3, 2))
    correction[:, 0] = 1.0
    run = dataclasses.replace(TINY, correction=correction)
    assert metrics(run)['rms_error_rad'] == pytest.approx([np.sqrt(31 / 4), np.sqrt(19 / 4)])


def test_window_is_a_parameter_and_holds_its_ends() -> None:
    """Check another window, and that a rounding error in t does not lose its end samples."""
    found = metrics(TINY, window=(6.0, 7.0))
    assert found['rms_error_rad'] == pytest.approx([np.sqrt(8.0), np.sqrt(0.5)])
    assert found['torque_variation_nm_per_s'] == pytest.approx([6.0, 0.0])
    assert metrics(TINY, window=(6.0 + 1e-12, 7.0 - 1e-12))['rms_error_rad'] == found[
        'rms_error_rad']
    assert metrics(TINY, window=(6.001, 10.0))['max_error_norm1_rad'] == pytest.approx(2.0)


def test_gaps_and_torques_that_are_not_known() -> None:
    """Check that the variation is that of neighbours, joint by joint, and RMS of what is known."""
    nan = float('nan')
    run = _run(t=[5.0, 6.0, 7.2, 10.0, 11.0], e=[[3, 0], [0, 0], [0, 0], [0, 4], [99, 99]],
               tau=[[1, 2], [3, nan], [4, 6], [99, 8], [99, 99]], v=[[0, 0]] * 5)
    found = metrics(run, window=(5.0, 10.0), period=1.0)
    assert found['missing_samples'] == 2
    assert found['torque_variation_nm_per_s'] == pytest.approx([3 / 2.2, nan], nan_ok=True)
    assert found['max_torque_step_nm'] == pytest.approx([2.0, nan], nan_ok=True)
    assert found['max_torque_rate_nm_per_s'] == pytest.approx([2.0, nan], nan_ok=True)
    assert metrics(run, window=(5.0, 10.0))['max_torque_rate_nm_per_s'] == pytest.approx(
        [95 / 2.8, 2 / 2.8])
    assert found['rms_torque_nm'] == pytest.approx([
        np.sqrt((1 + 9 + 16 + 99 ** 2) / 4), np.sqrt((4 + 36 + 64) / 3)])
    assert found['rms_error_rad'] == pytest.approx([1.5, 2.0])
    assert metrics(TINY)['missing_samples'] == 0


@pytest.mark.parametrize(('window', 'note'), [
    ((20.0, 30.0), 'metrics are computed from 20 s to 30 s, where this run, from 4 s to 11 s, has '
     'no sample'), ((5.5, 6.5), 'metrics are computed from 5.5 s to 6.5 s, where this run, from '
                    '4 s to 11 s, has one sample only')])
def test_too_few_samples_give_none(window: tuple[float, float], note: str) -> None:
    """Check that no number is made up from no sample, nor a variation from one; and the note."""
    found = metrics(TINY, window)
    assert [found[name] for name in (
        'rms_error_rad', 'max_error_norm1_rad', 'rms_torque_nm',
        'torque_variation_nm_per_s')] == [None] * 4
    assert found['notes'] == [note]
    assert metrics(TINY)['notes'] == []
    assert found['reaching_time_s'] == 6.0


@pytest.mark.parametrize(('v', 'expected'), [
    ([[0, 0], [0, 0], [0, 0]], 1.0), ([[9, 0], [0, 0], [0, 0]], 2.0),
    ([[0, 0], [0, -9], [0, 0]], 3.0), ([[0, 0], [0, 0], [0, 9]], None),
    ([[9, 9], [9, 9], [9, 9]], None), ([[0.5, 0], [-0.5, 0.5], [0.5, 0]], 1.0),
    ([[0, 0], [0.51, 0], [0, 0]], 3.0), ([[0, 0], [0, 0], [np.nan, 0]], None)])
def test_reaching_time(v: list[list[float]], expected: float | None) -> None:
    """Check the first time from which |v| stays in the band; on the band is inside."""
    assert reaching_time(np.array([1.0, 2.0, 3.0]), np.array(v), 0.5) == expected
    assert reaching_time(np.zeros(0), np.zeros((0, 2))) is None


def test_torques_and_v_at_times_of_their_own() -> None:
    """Check that all received torques count, and that two at once have the rate of a period."""
    t = np.array([4.9, 5.0, 5.001, 5.001 + 1e-6, 9.0, 10.1])
    tau = np.array([[99.0], [1.0], [2.0], [5.0], [4.0], [99.0]])
    torque = Series(t, tau, SignalOrigin.RECORDED, received=True)
    v = Series(np.array([0.0, 2.0, 8.0]), np.array([[9.0], [0.1], [0.1]]), SignalOrigin.RECORDED)
    found = metrics(TINY, period=0.001, torque=torque, v=v)
    assert found['torque_variation_nm_per_s'] == pytest.approx([5.0 / 4.0])
    assert found['max_torque_step_nm'] == [3.0]
    assert found['max_torque_rate_nm_per_s'] == pytest.approx([3000.0])
    assert found['rms_torque_nm'] == pytest.approx([np.sqrt(46.0 / 4.0)])
    assert found['reaching_time_s'] == 2.0
    assert found['rms_error_rad'] == metrics(TINY)['rms_error_rad']
    published = torque._replace(received=False)
    assert metrics(TINY, period=0.001, torque=published)['torque_variation_nm_per_s'] == (
        pytest.approx([4.0 / 0.001001]))


@pytest.mark.parametrize(('begin', 'end', 'window'), [
    (0.0, 12.0, WINDOW), (0.0, 5.5, WINDOW), (9.5, 60.0, WINDOW), (0.0, 5.4, (2.7, 5.4)),
    (0.0, 3.0, (1.5, 3.0)), (20.0, 24.0, (22.0, 24.0)), (9.6, 11.6, (10.6, 11.6))])
def test_a_window_that_the_run_has(begin: float, end: float, window: tuple[float, float]) -> None:
    assert window_of(np.linspace(begin, end, 50)) == pytest.approx(window)
    assert window_of(np.zeros(0)) == WINDOW


def test_errors_are_those_from_the_desired_motion() -> None:
    """A correction moves the reference of a joint that is to rest, too."""
    t = np.linspace(0.0, 10.0, 1001)
    dice = np.random.default_rng(5)
    desired = np.column_stack([np.sin(t), np.full(1001, 0.3)])
    e, correction = 0.01 * dice.normal(size=(1001, 2)), 0.1 * dice.normal(size=(1001, 3, 2))
    zeros = np.zeros((1001, 2))
    run = Run(t, desired - e, zeros, desired + correction[:, 0], *[zeros] * 4,
              correction=correction)
    rms_error = metrics(run, WINDOW)['rms_error_rad']
    inside = t >= 5.0
    np.testing.assert_allclose(rms_error, np.sqrt(np.mean(e[inside] ** 2, axis=0)), rtol=1e-9)
    np.testing.assert_allclose(error_shares(run, rms_error), [rms_error[0], 0.0], rtol=1e-3)

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

"""
Numbers of one run, and their columns in tables.

`score` simulates a setup and evaluates it. `run_lists` makes the row of a table from its `Score`.
"""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
import json
from math import inf, isfinite
from typing import Any, NamedTuple

from ctc_chattering.analysis.metrics import error_shares, metrics, WINDOW, within
from ctc_chattering.analysis.result import Result, simulate
from ctc_chattering.compiled.machine_code import MACHINE_CODE, PLAIN_PYTHON
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import as_ctc_error, CtcError, MachineError
from ctc_chattering.numerics.time_grid import seconds
from ctc_chattering.simulation.closed_loop import Array, Run
import numpy as np

#: Types of columns by those of Python.
COLUMN_TYPES = {int: 'int64', str: 'string', float: 'float64'}
#: Columns and units of what each joint has, by its name in `Score`. `analysis.metrics` has the
#: first five by the same names.
PER_JOINT = {
    'rms': ('rms_error_rad', 'rad'),
    'rms_torque': ('rms_torque_nm', 'N*m'),
    'variation': ('torque_variation_nm_per_s', 'N*m/s'),
    'step': ('max_torque_step_nm', 'N*m'),
    'rate': ('max_torque_rate_nm_per_s', 'N*m/s'),
    'peak': ('peak_torque_nm', 'N*m'),
    'peak_rate': ('peak_torque_rate_nm_per_s', 'N*m/s'),
    'slips': ('slips_per_s', '1/s')}
#: Columns of what there is once, with type and unit, by its name in `Score`.
OVERALL = {
    'norm1': ('max_error_norm1_rad', ('float64', 'rad')),
    'reaching_time': ('reaching_time_s', ('float64', 's')),
    'missing': ('missing_samples', ('int64', ''))}
#: Columns that tell a run of a map, before the axes and uncertain quantities.
RUN_COLUMNS = ('run', 'point', 'repeat', 'seed', 'variant', 'law', 'switching')
#: Runs a setup, and returns the result.
Runner = Callable[[Setup], Result]
#: A number of each joint, shape (n,).
Joints = tuple[float, ...]


class Score(NamedTuple):
    """
    Numbers of a run, or the worst of several.

    Those of each joint have the shape (n,).

    Attributes
    ----------
    rms : tuple of float
        RMS of the error in the window [rad].
    rms_torque : tuple of float
        RMS of the torque there [N·m].
    variation, step, rate : tuple of float
        Torque variation [N·m/s], largest step [N·m] and rate [N·m/s] of the torque sent there.
    peak, peak_rate : tuple of float
        Largest torque [N·m] and rate [N·m/s] of the whole run.
    norm1 : float or None
        Largest Σ |e_i| in the window [rad].
    reaching_time : float or None
        Time when v is reached, in the whole run [s].
    missing : int or None
        Number of missing samples in the window.
    saturated : float or None
        Part of its samples with a torque at its limit.
    slips : tuple of float
        Stick-slips a second where the reference rests in the window.
    error_share : float
        Largest of the joints' `error_shares`.
    failure : str
        Reason why there are no numbers. It is empty if there are.
    engine : str
        `MACHINE_CODE` or `PLAIN_PYTHON`. It is empty where the run failed.

    """

    rms: Joints = ()
    rms_torque: Joints = ()
    variation: Joints = ()
    step: Joints = ()
    rate: Joints = ()
    peak: Joints = ()
    peak_rate: Joints = ()
    norm1: float | None = None
    reaching_time: float | None = None
    missing: int | None = None
    saturated: float | None = None
    slips: Joints = ()
    error_share: float = 0.0
    failure: str = ''
    engine: str = ''

    @property
    def error(self) -> float:
        """Largest RMS error of any joint [rad], inf if it failed."""
        return max(self.rms, default=inf)


def simulate_truth(setup: Setup) -> Result:
    """Simulate without ROS, with true states."""
    return simulate(setup, truth=True)


def score(setup: Setup, window: tuple[float, float] = WINDOW, run: Runner = simulate_truth,
          across_gaps: bool = False) -> Score:
    """
    Run a setup, and return its numbers or failure.

    Parameters
    ----------
    setup : Setup
        The loop.
    window : (float, float)
        Evaluated interval [s].
    run : callable
        `simulate_truth`, or another `Runner`.
    across_gaps : bool
        Whether variation, steps and rates also count neighbours with samples missing between.

    Raises
    ------
    MachineError
        If the machine cannot run it, which is no property of the run.

    """
    try:
        with as_ctc_error('the run failed'), np.errstate(all='ignore'):
            period = None if across_gaps else setup.controller.control_period
            finished = run(setup).run
            numbers = _evaluate(finished, setup, window, period)
    except MachineError:
        raise
    except CtcError as error:
        return Score(failure=str(error))
    return numbers._replace(engine=MACHINE_CODE if finished.compiled else PLAIN_PYTHON)


def _evaluate(run: Run, setup: Setup, window: tuple[float, float], period: float | None) -> Score:
    """
    Return the numbers of a run.

    Raise `CtcError` if it has no finite error.
    """
    # With the samples of a joint one after the other in memory, all this takes half the time.
    by_joint: dict[str, Any] = {name: np.asfortranarray(getattr(run, name)) for name in (
        'dq', 'dq_d', 'ddq_d', 'tau', 'v')}
    run = dataclasses.replace(run, **by_joint)
    numbers = metrics(run, window, period=period)
    if numbers['rms_error_rad'] is None:
        raise CtcError(f'fewer than two samples from {window[0]:g} s to {window[1]:g} s')
    values: dict[str, Any] = {name: numbers[column] for name, (column, _) in OVERALL.items()}
    for name, (column, _) in PER_JOINT.items():
        if column in numbers:
            values[name] = tuple(numbers[column])
    if not isfinite(max(values['rms'])):
        raise CtcError('the error is not finite')
    tau = np.abs(run.tau)
    limit = (1.0 - 1e-9) * np.array(torque_limits(setup))  # A torque so close to it is at it.
    at_limit = tau[within(run.t, window)] >= limit
    return Score(
        **values,
        error_share=float(error_shares(run, values['rms']).max()),
        saturated=float(at_limit.any(axis=1).mean()),
        slips=tuple(slips_at_rest(run, window).tolist()),
        peak=tuple(tau.max(axis=0).tolist()),
        peak_rate=tuple(_peak_rate(run, setup.controller.control_period).tolist()))


class PassScore(NamedTuple):
    """Numbers of the worst joint in a pass."""

    #: RMS error [rad].
    error: float
    #: Torque variation [N·m/s].
    variation: float
    #: RMS error of the run without learning at that time [rad].
    error_without: float


def pass_columns(result: Result, without: Run, passes: int) -> dict[str, str]:
    """
    Return the columns of a run that has learned from passes.

    ``passes_of_run`` has a `PassScore` for each pass, from the one before learning on.
    """
    assert result.learner is not None
    rows = []
    for finished in result.learner.passes[:passes + 1]:
        window = seconds(finished.begin), seconds(finished.end)
        numbers, others = (metrics(run, window, result.config.control_period)
                           for run in (result.run, without))
        rows.append(PassScore(
            error=max(numbers['rms_error_rad']),
            variation=max(numbers['torque_variation_nm_per_s']),
            error_without=max(others['rms_error_rad'])))
    state = result.learner.outcome
    return {'passes_of_run': json.dumps(rows), 'learning': state}


def _peak_rate(run: Run, period: float) -> Array:
    """Return the largest torque rate between neighbours, shape (n,) [N·m/s]."""
    step = np.abs(np.diff(run.tau, axis=0))
    dt = np.diff(run.t)[:, np.newaxis]
    rates: Array = np.where(dt < 1.5 * period, step / dt, 0.0)
    largest: Array = rates.max(axis=0)
    return largest


def slips_at_rest(run: Run, window: tuple[float, float]) -> Array:
    """
    Return the stick-slips of each joint a second.

    It counts how often the velocity exceeds 1e-3 rad/s anew, in those samples of the window for
    which the reference has rested for 0.3 s or more. Without such samples it is 0.
    """
    t = run.t[:, np.newaxis]
    _, dq_d, ddq_d = run.desired
    moves = np.maximum(np.abs(dq_d), np.abs(ddq_d)) > 1e-9  # More than rounding.
    last_move = np.maximum.accumulate(np.where(moves, t, t[0]), axis=0)
    rests = ((t - last_move >= 0.3) & within(t, window))[1:]
    is_fast = np.abs(run.dq) > 1e-3
    begins = is_fast[1:] & ~is_fast[:-1]
    slips = (begins & rests).sum(axis=0)
    time = np.where(rests, np.diff(t, axis=0), 0.0).sum(axis=0)
    rate: Array = slips / np.where(time > 0.0, time, np.inf)
    return rate


def torque_limits(setup: Setup) -> list[float]:
    """Return the largest allowed torque, shape (n,) [N·m]."""
    config, plant = setup.controller, setup.plant
    model = model_of(config, setup.descriptions.get('controller', ''))
    return list(map(min, config.largest_torque(model.effort_limits), plant.torque_saturation))


def result_columns(n: int) -> dict[str, tuple[str, str]]:
    """Return names, types and units of the result columns."""
    texts = dict.fromkeys(('engine', 'failure', 'reason'), ('string', ''))
    summary = {'error': 'rad', 'error_share': '', 'variation': 'N*m/s', 'saturated': '',
               'slips': '1/s'}
    numbers = summary | {f'{column}_{i}': unit for column, unit in PER_JOINT.values()
                         for i in range(1, n + 1)}
    return texts | {name: ('float64', unit) for name, unit in numbers.items()} | dict(
        OVERALL.values())

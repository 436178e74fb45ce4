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

"""A run and its numbers, and the columns of tables with a row a run."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
from math import inf, isfinite
from typing import Any, NamedTuple

from ctc_chattering.analysis.metrics import error_shares, metrics, WINDOW, within
from ctc_chattering.analysis.result import Result, simulate
from ctc_chattering.compiled.machine_code import MACHINE_CODE, PLAIN_PYTHON
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import as_ctc_error, CtcError, MachineError
from ctc_chattering.simulation.closed_loop import Array, Run
import numpy as np

#: Types of columns by those of Python.
TYPES = {int: 'int64', str: 'string', float: 'float64'}
INTEGER, TEXT, NUMBER = TYPES.values()
#: Columns and units of what each joint has, by its name in `Score`; `analysis.metrics` has the
#: first five by the same names.
PER_JOINT = {'rms': ('rms_error_rad', 'rad'), 'rms_torque': ('rms_torque_nm', 'N*m'),
             'variation': ('torque_variation_nm_per_s', 'N*m/s'),
             'step': ('max_torque_step_nm', 'N*m'), 'rate': ('max_torque_rate_nm_per_s', 'N*m/s'),
             'peak': ('peak_torque_nm', 'N*m'),
             'peak_rate': ('peak_torque_rate_nm_per_s', 'N*m/s'), 'slips': ('slips_per_s', '1/s')}
#: Columns of what there is once, with type and unit, by its name in `Score`.
OVERALL = {'norm1': ('max_error_norm1_rad', (NUMBER, 'rad')),
           'reaching_time': ('reaching_time_s', (NUMBER, 's')),
           'missing': ('missing_samples', (INTEGER, ''))}
#: Rest of the reference after which slips count [s], and velocity of one [rad/s].
_SETTLED, _SLIP = 0.3, 1e-3
#: Part of a limit from which a torque is at it.
_AT_LIMIT = 1.0 - 1e-9
#: Runs a setup; returns what happened.
Runner = Callable[[Setup], Result]
#: Of each joint, shape (n,).
Joints = tuple[float, ...]


class Score(NamedTuple):
    """
    The numbers of a run, or the worst of several; those of each joint have the shape (n,).

    In the window: RMS of the error [rad] and the torque [N·m], torque variation [N·m/s], largest
    step [N·m] and rate [N·m/s] of the torque sent, largest Σ |e_i| [rad], number of missing
    samples, the part of the samples with a torque at its limit, stick-slips a second where the
    reference rests, and the largest of the joints' `error_shares`. In the whole run: largest
    torque [N·m] and rate [N·m/s], and the time when v is reached [s]. `failure` says why there are
    none of these, and `engine` how it was simulated, by `MACHINE_CODE` or `PLAIN_PYTHON`; empty
    where it failed.
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
        """Return the largest RMS error of any joint [rad]; inf if it failed."""
        return max(self.rms, default=inf)


def over_simulation(setup: Setup) -> Result:
    """Simulate without ROS, and return what happens; the states are the true ones."""
    return simulate(setup, truth=True)


def score(setup: Setup, window: tuple[float, float] = WINDOW, run: Runner = over_simulation,
          across_gaps: bool = False) -> Score:
    """
    Run a setup, and return its numbers or why it has none.

    Parameters
    ----------
    setup : Setup
        What to run.
    window : (float, float)
        Evaluated interval [s].
    run : callable
        `over_simulation`, or another `Runner`.
    across_gaps : bool
        Whether variation, steps and rates are those of neighbours with samples missing in
        between, too.

    Raises
    ------
    MachineError
        If the machine cannot run it: that is no property of the run.

    """
    try:
        with as_ctc_error('the run failed'), np.errstate(all='ignore'):
            period = None if across_gaps else setup.controller.control_period
            made = run(setup).run
            found = _numbers(made, setup, window, period)
    except MachineError:
        raise
    except CtcError as error:
        return Score(failure=str(error))
    return found._replace(engine=MACHINE_CODE if made.compiled else PLAIN_PYTHON)


def _numbers(run: Run, setup: Setup, window: tuple[float, float], period: float | None) -> Score:
    """Return the numbers of a run; raise `CtcError` if it has no finite error."""
    # With the samples of a joint one after the other in memory, all this takes half the time.
    quick: dict[str, Any] = {name: np.asfortranarray(getattr(run, name)) for name in (
        'dq', 'dq_d', 'ddq_d', 'tau', 'v')}
    run = dataclasses.replace(run, **quick)
    found = metrics(run, window, period=period)
    if found['rms_error_rad'] is None:
        raise CtcError(f'fewer than two samples from {window[0]:g} s to {window[1]:g} s')
    values: dict[str, Any] = {name: tuple(found[key]) for name, (key, _) in PER_JOINT.items()
                              if key in found}
    made = Score(**values, **{name: found[key] for name, (key, _) in OVERALL.items()})
    if not isfinite(made.error):
        raise CtcError('the error is not finite')
    tau = np.abs(run.tau)
    at_limit = tau[within(run.t, window)] >= _AT_LIMIT * np.array(limits(setup))
    step, dt = np.abs(np.diff(run.tau, axis=0)), np.diff(run.t)[:, np.newaxis]
    near = dt < 1.5 * setup.controller.control_period
    return made._replace(
        slips=tuple(slips_at_rest(run, window).tolist()),
        error_share=float(error_shares(run, made.rms).max()),
        peak=tuple(tau.max(axis=0).tolist()), saturated=float(at_limit.any(axis=1).mean()),
        peak_rate=tuple(np.where(near, step / dt, 0.0).max(axis=0).tolist()))


def slips_at_rest(run: Run, window: tuple[float, float]) -> Array:
    """
    Return how often a second each joint begins to move where its reference rests, shape (n,).

    That is how often its velocity exceeds 1e-3 rad/s anew, of the samples in the window for which
    the reference has rested for 0.3 s or more; 0 without such samples.
    """
    t = run.t[:, np.newaxis]
    moves = (run.dq_d != 0.0) | (run.ddq_d != 0.0)
    last = np.maximum.accumulate(np.where(moves, t, t[0]), axis=0)
    rests = (t - last >= _SETTLED) & within(t, window)
    fast = np.abs(run.dq) > _SLIP
    slips = (fast[1:] & ~fast[:-1] & rests[1:]).sum(axis=0)
    time = np.where(rests[1:], np.diff(t, axis=0), 0.0).sum(axis=0)
    rate: Array = slips / np.where(time > 0.0, time, np.inf)
    return rate


def limits(setup: Setup) -> list[float]:
    """Return the largest torque that controller and drives allow, shape (n,) [N·m]."""
    config, plant = setup.controller, setup.plant
    model = model_of(config, setup.descriptions.get('controller', ''))
    return list(map(min, config.largest_torque(model.effort_limits), plant.torque_saturation))


#: Columns that say which run of a map it is; before the axes and what is uncertain.
WHICH = ('run', 'point', 'repeat', 'seed', 'variant', 'law', 'switching')
#: What came of it, and the numbers that sum it up; without a number where it failed.
_RESULT = {**dict.fromkeys(('engine', 'failure', 'reason'), (TEXT, '')),
           'error': (NUMBER, 'rad'), 'error_share': (NUMBER, ''),
           'variation': (NUMBER, 'N*m/s'), 'saturated': (NUMBER, ''), 'slips': (NUMBER, '1/s')}


def of_results(n: int) -> dict[str, tuple[str, str]]:
    """Return name, type and unit of the columns behind the axes, for `n` joints."""
    joints = {f'{name}_{i}': (NUMBER, unit) for name, unit in PER_JOINT.values()
              for i in range(1, n + 1)}
    return {**_RESULT, **joints, **dict(OVERALL.values())}

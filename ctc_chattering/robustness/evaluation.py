"""One run of a map: simulated, summed up, and whether it is a failure."""

from __future__ import annotations

from typing import Any

from ctc_chattering.analysis.engine import engine_of, simulated_by
from ctc_chattering.analysis.metrics import metrics, within
from ctc_chattering.configuration.parameter_file import Setup
from ctc_chattering.dynamics.registry import kept_model_of
from ctc_chattering.errors import CtcError, MachineError, refused_as
from ctc_chattering.robustness.columns import of_results, OVERALL, PER_JOINT
from ctc_chattering.robustness.spec import Failure
from ctc_chattering.simulation.closed_loop import Run
from ctc_chattering.simulation.registry import make_plant
import numpy as np

#: Part of a limit from which a torque is at it.
_AT_LIMIT = 1.0 - 1e-9


def evaluate(setup: Setup, window: tuple[float, float], failure: Failure, engine: str
             ) -> dict[str, Any]:
    """
    Return the columns of a run's results, `of_results`; None where there is no number.

    Parameters
    ----------
    setup : Setup
        What to run.
    window : (float, float)
        Evaluated interval [s].
    failure : Failure
        What counts as one.
    engine : str
        As `engine_of` takes it.

    Raises
    ------
    MachineError
        If the machine cannot run it: that is no property of the run.

    """
    used, _ = engine_of(setup, engine)
    row = dict.fromkeys(of_results(len(setup.controller.joint_names)))
    row.update(engine=used, failure='', reason='')
    if (count := steps(setup)) > failure.steps_above:
        return {**row, 'failure': 'too long', 'reason': (
            f'{count:.3g} steps of the integrator > {failure.steps_above}')}
    try:
        with refused_as('the run failed'), np.errstate(all='ignore'):
            run = simulated_by(setup, used, truth=True).run
            row.update(_numbers(run, setup, window))
    except MachineError:
        raise
    except CtcError as error:
        return {**row, 'failure': 'diverged', 'reason': str(error)}
    row['failure'], row['reason'] = _judged(row, setup, failure)
    return row


def steps(setup: Setup) -> float:
    """Return how many steps of the integrator a run has; stiff elastic joints have many."""
    plant = setup.plant
    if plant.elastic:
        return make_plant(plant, setup.descriptions.get('plant', '')).steps
    return plant.duration / min(plant.control_period, plant.integration_step)


def refused(n: int, error: CtcError, engine: str) -> dict[str, Any]:
    """Return the columns of a run of `n` joints whose parameters are not allowed."""
    return {**dict.fromkeys(of_results(n)), 'engine': engine, 'failure': 'refused',
            'reason': str(error)}


def _numbers(run: Run, setup: Setup, window: tuple[float, float]) -> dict[str, Any]:
    """Return the numbers of a run; raise `CtcError` if it has no finite error."""
    found = metrics(run, window, period=setup.plant.control_period)
    if found['rms_error_rad'] is None:
        raise CtcError(f'fewer than two samples from {window[0]:g} s to {window[1]:g} s')
    row = {f'{name}_{i}': _finite(x) for name in PER_JOINT for i, x in enumerate(found[name], 1)}
    row.update({name: _finite(found[name]) for name in OVERALL})
    row['error'] = _finite(max(found['rms_error_rad']))
    row['variation'] = _finite(max(found['torque_variation_nm_per_s']))
    if row['error'] is None:
        raise CtcError('the error is not finite')
    at_limit = np.abs(run.tau[within(run.t, window)]) >= _AT_LIMIT * np.array(limits(setup))
    row['saturated'] = float(at_limit.any(axis=1).mean())
    return row


def _finite(x: float | None) -> float | None:
    return x if x is not None and np.isfinite(x) else None


def limits(setup: Setup) -> list[float]:
    """Return the largest torque that controller and drives allow, shape (n,) [N·m]."""
    config, plant = setup.controller, setup.plant
    model = kept_model_of(config, setup.descriptions.get('controller', ''))
    return list(map(min, config.largest_torque(model.effort_limits), plant.torque_saturation))


def _judged(row: dict[str, Any], setup: Setup, failure: Failure) -> tuple[str, str]:
    """Return kind and reason of a failure; empty for none."""
    if row['error'] > failure.error_above:
        errors = [row[f'rms_error_rad_{i}'] for i in range(1, len(setup.plant.joint_names) + 1)]
        joint = setup.controller.joint_names[errors.index(row['error'])]
        return 'error', f'{joint}: {row["error"]:.3g} > {failure.error_above:g} rad'
    if row['saturated'] > failure.saturated_above:
        return 'saturated', (f'a torque at its limit in {row["saturated"]:.3g} > '
                             f'{failure.saturated_above:g} of the samples')
    if failure.not_reached and row['reaching_time_s'] is None:
        return 'not reached', 'v never stays within its band'
    return '', ''

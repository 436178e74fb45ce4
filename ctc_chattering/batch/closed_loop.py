"""
A run of a parameter file by the compiled loop: what `simulation.closed_loop.simulate` returns.

The equations, the random numbers and the order of the operations are those of the reference, so
that a run differs from it by rounding only; a motion that is not regular makes that grow.
"""

from __future__ import annotations

from functools import lru_cache

from ctc_chattering.batch.compiler import compiling
from ctc_chattering.batch.control_state import (
    control_scratch,
    control_settings,
    control_state,
    evaluated,
)
from ctc_chattering.batch.control_step import Controller
from ctc_chattering.batch.loop import BEYOND, DIVERGED, FINISHED, run
from ctc_chattering.batch.observer_feedback import observer_feedback
from ctc_chattering.batch.plant import compiled_plant, inputs
from ctc_chattering.batch.records import record
from ctc_chattering.batch.reference_table import reference_table
from ctc_chattering.configuration.parameter_file import Setup
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.dynamics.arm import arm_of, body_scratch
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.payload import with_payload
from ctc_chattering.dynamics.registry import kept_model_of, MODELS
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.compilable import RECORDS
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import period_ns, samples, seconds
from ctc_chattering.simulation.closed_loop import Run
from ctc_chattering.simulation.friction import own_friction
from ctc_chattering.simulation.plant import Plant
import numpy as np

#: Arms that are kept.
_KEPT = 64


def unsupported(setup: Setup) -> str:
    """Return why the compiled loop cannot run a parameter file; empty if it can."""
    plant, controller = setup.plant, setup.controller
    if plant.plant_backend != 'builtin':
        return f'plant_backend {plant.plant_backend}'
    if plant.elastic:
        return 'elastic joints'
    if setup.events:
        return 'events'
    if type(own_friction(plant.friction_model, plant.joint_names)) not in RECORDS:
        return f'friction_model {plant.friction_model}, which is no marked record'
    for model in (plant.model, controller.model):
        if model not in MODELS:
            return f'model {model}'
    return ''


def simulate(setup: Setup, truth: bool = False) -> Run:
    """
    Run the closed loop of a parameter file from t = 0 to the plant's `duration`.

    Parameters
    ----------
    setup : Setup
        As `parameter_file.load` returns it.
    truth : bool
        Record the true state in place of the one that the sensors show.

    Raises
    ------
    CtcError
        As of `simulation.closed_loop.simulate`, and for what `unsupported` names.

    """
    reason = unsupported(setup)
    if reason:
        raise CtcError(f'the compiled loop does not have {reason}')
    if setup.plant.duration <= 0.0:
        raise CtcError('duration: a simulation must end; set the duration of the plant above 0')
    with compiling(len(setup.plant.joint_names)):
        return _run(setup, truth)


def _run(setup: Setup, truth: bool) -> Run:
    """Run what `simulate` has checked."""
    config, controller = setup.plant, setup.controller
    description = setup.descriptions.get('plant', '')
    if config.payload:
        description = with_payload(description, config.joint_names, config.payload)
    model = kept_model_of(config, description)
    plant = Plant(config, model)
    period, delay = period_ns(config.control_period), controller.input_delay
    count = samples(config.duration, period) + 1
    start = tuple(zip(config.joint_names, zip(*plant.measured)))
    starts = setup.reference.start_duration or setup.route is not None
    table = reference_table(setup.reference, setup.route, start if starts else (),
                            controller.joint_names, period, count + delay)
    law = _controller(controller, kept_model_of(
        controller, setup.descriptions.get('controller', '')))
    out = np.empty((count, 5, len(config.joint_names)))
    end, k, joint, rows = run(compiled_plant(plant, _arm(model, config.gravity)), law,
                              inputs(plant, count), table, truth, out)
    if end != FINISHED:
        raise CtcError(_failure(end, seconds(k * period), joint, controller, out[rows]))
    kept = out[:rows]
    at = kept[:, 0, 0].astype(int)
    desired = table[at]
    return Run(at * period / 1e9, kept[:, 1], kept[:, 2], desired[:, 0], desired[:, 1],
               desired[:, 2], kept[:, 3], kept[:, 4])


def _failure(end: int, t: float, joint: int, config: ControllerConfig, row: Array) -> str:
    """Return why a run ended at `t` [s], from the row of its last sample."""
    if end == BEYOND:
        return (f'the position error of {config.joint_names[joint]} at t = {t:g} s exceeds '
                f'error_limit, {config.error_limit[joint]:g} rad')
    if end == DIVERGED:
        return f'the motion of the plant diverged at t = {t:g} s'
    return (f'no torque can be computed at t = {t:g} s for {row[1].tolist()}, '
            f'{row[2].tolist()}')


_arm = lru_cache(_KEPT)(arm_of)


def _controller(config: ControllerConfig, model: Model) -> Controller:
    """Return the controller at its start."""
    n = model.n
    return Controller(
        record(_arm(model, config.gravity, config.inertia_scale, config.gravity_scale)),
        record(control_settings(config, model)), record(control_state(config)),
        record(evaluated(n)), record(evaluated(n)), record(control_scratch(n)),
        record(body_scratch(n)), observer_feedback(config))

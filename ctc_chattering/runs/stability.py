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
Stability margins of the loop of a parameter file.

`ctc stability` prints it. `margins/loop_margins.py` computes the margins from the loops that
`loops_of` forms of a setup.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import math

from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.margins.linear_law import (
    is_proportional,
    joints_are_equal,
    linear_law,
    LinearLaw,
)
from ctc_chattering.margins.loop_margins import (
    Loops,
    Margins,
    RATIOS,
    StableRange,
)
from ctc_chattering.number_format import round_towards
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import period_ns, seconds
from ctc_chattering.runs.recommended import desired_points
import numpy as np


def loops_of(setup: Setup) -> Loops:
    """
    Return the loops of a parameter file.

    Parameters
    ----------
    setup : Setup
        The law with its knowledge, and lag, delay and sensor of its robot.

    Raises
    ------
    CtcError
        If the law is not linear, or its torque not proportional to M̂.

    """
    config, plant = setup.controller, setup.plant
    n = len(config.joint_names)
    lags = np.array(plant.actuator_lag)
    eye = np.eye(n)
    law = linear_law(config, eye)
    are_equal = joints_are_equal(config, lags)
    # A coupled M̂ shows whether joints are independent.
    _check_proportion(config, law, eye + 0.3 if are_equal else 2.0 * eye)
    if plant.velocity_sensor == 'filtered' and (law.B[:, n:].any() or law.D[:, n:].any()):
        raise CtcError(f'velocity_sensor: filtered is not allowed under law {config.law}, which '
                       'uses the velocity; allowed: exact, difference')
    laws, masses = [law.one_joint()], [eye[:1, :1]]
    if are_equal:
        lags = lags[:1]
    else:
        masses = masses_of(setup)
        laws = [linear_law(config, mass) for mass in masses]
    return Loops(laws, masses, seconds(period_ns(config.control_period)), lags,
                 plant.input_delay, plant.velocity_sensor == 'difference')


def _check_proportion(config: ControllerConfig, law: LinearLaw, mass: Array) -> None:
    """Refuse a law whose torque is not proportional to M̂."""
    if not is_proportional(linear_law(config, mass), law, mass):
        raise CtcError(f'law {config.law}: its torque is not proportional to the mass matrix of '
                       'its model, so that its stability cannot be computed')


def masses_of(setup: Setup) -> list[Array]:
    """Return M̂ at five instants of the motion."""
    model = model_of(setup.controller, setup.descriptions.get('controller', ''))
    points = desired_points(setup, setup.plant.duration or 1.0, 5)
    return [np.array(model.mass_matrix(q)) for q, _, _ in points]


def stability(setup: Setup) -> Margins:
    """
    Return the errors that the sampled loop tolerates.

    The loop has a constant M and no limits. Its poles decide for errors that are constant, the
    small-gain theorem for those that vary (docs/theory.md).

    Parameters
    ----------
    setup : Setup
        The law with its knowledge, and lag, delay and sensor of its robot.

    Returns
    -------
    Margins
        The loop is stable if ``radius`` is below 1. ``ratios``, ``lags`` and ``delays`` say by how
        much.

    Raises
    ------
    CtcError
        If the law is not linear, or its torque not proportional to M of the model.

    Examples
    --------
    >>> from ctc_chattering import load_parameters, stability
    >>> margins = stability(load_parameters('friction', {'controller': {'law': 'compensation'}}))
    >>> margins.radius < 1.0, f'{margins.ratios.low:.2f} to {margins.ratios.high:.0f}'
    (True, '0.01 to 40')

    """
    return loops_of(setup).margins()


def margin_rows(margins: Margins, period: float) -> Iterator[tuple[str, str]]:
    """
    Yield the margins as rows of a table.

    Intervals are rounded inwards. `period` is h [s].
    """
    if margins.radius < 1.0:
        slowest = -1e3 * period / math.log(margins.radius)
        yield 'slowest time constant, model exact', f'{round_towards(slowest, 2, math.ceil):g} ms'
    else:
        yield 'model exact', f'unstable: a pole at {margins.radius:.3g}'
    yield 'M of the model / M of the robot, constant', range_text(margins.ratios)
    yield 'the same, varying (guaranteed)', range_text(margins.guaranteed)
    for ratio, lags, delays in zip(RATIOS, margins.lags, margins.delays):
        model = '' if ratio == 1.0 else f', model {ratio:g} M'
        yield f'lag of the drives{model}', range_text(lags, 1e3, ' ms')
        yield f'delay{model}', f'{_delays_text(delays)} samples' if delays else 'none'


def range_text(stable: StableRange | None, factor: float = 1.0, unit: str = '') -> str:
    """Return an interval, rounded inwards."""
    if stable is None:
        return 'none'
    low = round_towards(factor * stable.low, 2, math.ceil)
    high = round_towards(factor * stable.high, 2, math.floor)
    return f'{low:g} to {high:g}{unit}'


def _delays_text(delays: Sequence[int]) -> str:
    """Return ascending delays, consecutive ones as a range."""
    if len(delays) > 1 and delays[-1] - delays[0] == len(delays) - 1:
        return f'{delays[0]} to {delays[-1]}'
    return ', '.join(map(str, delays))

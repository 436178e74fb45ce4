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

"""The two-link table of docs/comparison.md by an independent program."""

from __future__ import annotations

from collections.abc import Iterator
import csv
import json
from pathlib import Path
from typing import Any

from held_out import begun, sinusoid
from independent_laws import Gains, Known, ObserverFeedback, Point
from independent_plant import ideal, Physics, Plant
from independent_rivals import RIVALS
import numpy as np
from rigid_bodies import Array, PAPER, planar

_TABLE = Path(__file__).parents[1] / 'docs' / 'comparison' / 'two_link' / 'compare.csv'
#: Duration of a run [s].
_SECONDS = 10.0
#: Errors count from this time on [s].
_COUNTS = 5.0
#: Longest step of the plant [s].
_STEP = 2e-5
#: Step of the encoders [rad].
_ENCODER = 1e-5


def real_arm() -> Physics:
    """Return the arm of the condition `real_arm`."""
    return ideal(planar(*PAPER)).changed(
        coulomb=9.9, lag=2e-3, rate=(5e3, 1e3), saturation=(5100.0, 850.0))


def played(law: Any) -> tuple[Array, Array]:
    """Return RMS errors [rad] and torque variation [N·m/s] from 5 to 10 s, shape (2,) each."""
    h, one = 1e-3, np.ones(2)
    t: Array = (h * np.arange(round(_SECONDS / h) + 8)).astype(np.float64)
    path = begun(sinusoid(t, np.array([np.pi, np.pi / 2]), 0.5 * one, one, 0.0 * one), t,
                 np.zeros(2), 2.0)
    points = [Point(*rows) for rows in zip(path.q, path.dq, path.ddq)]
    plant = Plant(real_arm(), np.zeros(2), h, 1, held=False, encoder=_ENCODER, longest=_STEP)
    errors, torques = [], []
    for k in range(round(_SECONDS / h) + 1):
        tau = law.step(*plant.measured(), points[k:k + 2])
        errors.append(points[k].q - plant.q)
        torques.append(tau)
        plant.step(tau)
    first = round(_COUNTS / h)
    e, tau = np.array(errors)[first:], np.array(torques)[first:]
    return np.sqrt((e * e).mean(axis=0)), np.abs(np.diff(tau, axis=0)).sum(axis=0) / (
        _SECONDS - _COUNTS)


def law(name: str, numbers: dict[str, Any], scale: float) -> Any:
    """Return a law by hand with the parameters that the table's rows have."""
    known = Known(scale=scale)
    if name == 'observer_feedback':
        return ObserverFeedback(known, Gains(
            numbers['kp'][0], numbers['kv'][0], numbers['ka'], numbers['estimator_bandwidth'],
            numbers.get('friction_learning', 20.0), numbers.get('friction_level', (0.0, 0.0))))
    return RIVALS[name](known, numbers)


def rows() -> Iterator[tuple[str, str, dict[str, Any], Array, Array]]:
    """Yield law, settings, parameters, errors and variation of the table's rows known here."""
    with _TABLE.open(encoding='utf-8') as file:
        found = [x for x in csv.DictReader(file) if x['condition'] == 'real_arm'
                 and x['law'] in (*RIVALS, 'observer_feedback')]
    for one, two in zip(found[::2], found[1::2]):
        yield one['law'], one['settings'], json.loads(one['controller']), np.array(
            [float(x['rms_error']) for x in (one, two)]), np.array(
            [float(x['torque_variation_per_s']) for x in (one, two)])


def main() -> None:
    """Print the table of docs beside what is found here."""
    print('| law | settings | RMS error [rad], docs | here | variation [N·m/s], docs | here |')
    print('|---' * 6 + '|')
    for name, settings, numbers, error, variation in rows():
        both = [played(law(name, numbers, scale)) for scale in (0.9, 1.1)]
        mine, varied = (np.max([x[i] for x in both], axis=0) for i in (0, 1))
        print(f'| {name} | {settings} | {error[0]:.2e}, {error[1]:.2e} | {mine[0]:.2e}, '
              f'{mine[1]:.2e} | {variation[0]:.0f}, {variation[1]:.0f} | {varied[0]:.0f}, '
              f'{varied[1]:.0f} |', flush=True)


if __name__ == '__main__':
    main()

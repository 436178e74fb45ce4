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
Conditions that no law was tuned for, drawn by a seed: what is told of a robot is wrong.

Each draw is another robot than the one of the file: lag, rate limit and resolution of its drives
and encoders, its friction, and what the controller's model lacks; with another sample period and
motion. The controller is told lag, rate limit and friction as below; the delay it knows.

========================= =========================== ==============================
what                      of the robot                told
========================= =========================== ==============================
lag of the drives         0 to 4 ms                   0.5 to 1.5 times
rate limit                0.5 to 2 times the nominal  0.5 to 2 times
delay                     0, 1 or 2 samples           as it is
encoder                   1e-6 to 1e-4 rad            as it is, for what is recommended
Coulomb friction          0.7 to 1.3 times the file's the file's
Stribeck friction         up to 0.3 times the Coulomb nothing
inertia and gravity                                   0.85 to 1.15 times, each
payload, with a URDF      up to 1 kg                  nothing
sample period             0.5, 1 or 2 ms              as it is
amplitude, frequency      0.4 to 0.75, 0.5 to 1.3 times
start                     smooth; off the reference by up to 0.3 rad in every third
========================= =========================== ==============================
"""

from __future__ import annotations

import dataclasses
from typing import Any, TYPE_CHECKING

from ctc_chattering.studies.conditions import torque_rates
import numpy as np

if TYPE_CHECKING:
    from ctc_chattering.configuration.loop_setup import Overrides, Setup

#: Error by which a run is lost [rad or m].
LOST = 1.0
#: Sample periods [s], and smooth start [s].
_PERIODS, _START = (5e-4, 1e-3, 2e-3), 2.0


@dataclasses.dataclass(frozen=True)
class HeldOut:
    """One condition: the draw `index` of the seed `seed`."""

    seed: int
    index: int

    @property
    def name(self) -> str:
        """Return a name for tables and files."""
        return f'held_out_{self.seed}_{self.index}'

    def overrides(self, setup: Setup) -> Overrides:
        """Return what replaces values of a parameter file, which is the nominal robot."""
        rng, n = np.random.default_rng((self.seed, self.index)), len(setup.plant.joint_names)

        def times(values: tuple[float, ...], low: float, high: float) -> list[float]:
            return [float(x) for x in np.array(values) * rng.uniform(low, high, len(values))]

        period = float(rng.choice(_PERIODS))
        lag, delay = (float(rng.uniform(0.0, 4e-3)),) * n, int(rng.integers(0, 3))
        told_lag = [float(rng.uniform(0.5, 1.5)) * lag[0]] * n
        factor, told_factor = (2.0 ** float(x) for x in rng.uniform(-1.0, 1.0, 2))
        rates = [factor * x for x in torque_rates(setup)]
        resolution = 10.0 ** float(rng.uniform(-6.0, -4.0))
        friction = times(setup.plant.coulomb_friction, 0.7, 1.3)
        plant: dict[str, Any] = {
            'actuator_lag': list(lag), 'torque_rate_limit': rates, 'input_delay': delay,
            'encoder_resolution': [resolution] * n, 'velocity_sensor': 'difference',
            'coulomb_friction': friction, 'stribeck_friction': times(tuple(friction), 0.0, 0.3),
            'stribeck_velocity': [10.0 ** float(rng.uniform(-2.0, -1.0))] * n}
        known: dict[str, Any] = {
            'actuator_lag': told_lag, 'torque_rate_limit': [told_factor * x for x in rates],
            'input_delay': delay, 'friction_level': list(setup.plant.coulomb_friction),
            'inertia_scale': float(rng.uniform(0.85, 1.15)),
            'gravity_scale': float(rng.uniform(0.85, 1.15)), 'error_limit': [LOST] * n}
        payload = float(rng.uniform(0.0, 1.0))
        if setup.plant.described:
            plant['payload'] = payload
        motion: dict[str, Any] = {
            'amplitude': times(setup.reference.amplitude, 0.4, 0.75),
            'frequency': times(setup.reference.frequency, 0.5, 1.3),
            'phase': [float(x) for x in rng.uniform(0.0, 2.0 * np.pi, n)],
            'start_duration': max(setup.reference.start_duration, _START)}
        offset = rng.uniform(-0.3, 0.3, n)
        if self.index % 3 == 2:
            plant['initial_position'] = [
                float(c + a * np.sin(x) + d) for c, a, x, d in zip(
                    setup.reference.center, motion['amplitude'], motion['phase'], offset)]
        return {'/**': {'control_period': period}, 'plant': plant, 'controller': known,
                'reference': motion, 'bringup': {'events': ['']}}


def held_out(count: int, seed: int) -> tuple[HeldOut, ...]:
    """Return the first conditions of a seed."""
    return tuple(HeldOut(seed, i) for i in range(count))

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
Recommended gains for the setup of a parameter file, and the variants of a comparison.

`ctc compare`, `tune` and `map` take gains from here. The rules are in
`control/recommended_gains.py`; `known_loop` says what they may know of the robot.
"""

from __future__ import annotations

from collections.abc import Iterator
import dataclasses
from functools import partial
from typing import Any, NamedTuple

from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.laws.registry import BASELINE_LAW, law_class
from ctc_chattering.control.recommended_gains import (
    gain_rule,
    KnownLoop,
    recommended_gains,
    RECOMMENDED_LAW,
    RECOMMENDED_SWITCHING,
)
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.trajectory.reference import make_motion
import numpy as np

#: Where the gains of a comparison come from.
GAINS = FILE, RECOMMENDED = 'file', 'recommended'


class Variant(NamedTuple):
    """A law with its switching, '' for one without, and the source of its gains."""

    law: str
    switching: str
    settings: str

    @property
    def values(self) -> dict[str, Any]:
        """Return the parameters of the controller that choose the law."""
        return {'law': self.law, **({'switching': self.switching} if self.switching else {})}


#: The variant to which all others are compared.
BASE = Variant(BASELINE_LAW, '', FILE)
#: The variant whose torque variation measures that of all others.
BEST = Variant(RECOMMENDED_LAW, '', RECOMMENDED)


def desired_points(setup: Setup, duration: float, count: int
                   ) -> Iterator[tuple[list[float], list[float], list[float]]]:
    """Yield q_d, dq_d and ddq_d of the controller's joints at instants of a duration [s]."""
    plant, reference = setup.plant, setup.reference
    start = dict(zip(plant.joint_names, zip(plant.initial_position, plant.initial_velocity)))
    motion = make_motion(reference, setup.route, start, continuous=setup.continuous)
    order = [reference.joint_names.index(name) for name in setup.controller.joint_names]
    for t in np.linspace(0.0, 1e9 * duration, count).astype(int).tolist():
        q, dq, ddq = ([row[i] for i in order] for row in motion.at(t))
        yield q, dq, ddq


def largest_torque(setup: Setup) -> Array:
    """Return the largest torque that the model takes in the motion, shape (n,) [N·m]."""
    model = model_of(setup.controller, setup.descriptions.get('controller', ''))
    torques = [model.inverse_dynamics(q, dq, ddq)
               for q, dq, ddq in desired_points(setup, setup.plant.duration, 500)]
    largest: Array = np.abs(torques).max(axis=0)
    return largest


def known_loop(setup: Setup) -> KnownLoop:
    """Return what the controller is configured with, and the sensors and motion of its robot."""
    resolution = max(*setup.plant.encoder_resolution, *setup.plant.position_noise)
    return KnownLoop(setup.controller, partial(largest_torque, setup), resolution)


def gains_by_rule(setup: Setup, law: str = '') -> dict[str, Any]:
    """Return the gains of a law by its rule, as parameters; by default the law in force."""
    return recommended_gains(law or setup.controller.law, known_loop(setup))


def recommended_setup(setup: Setup, law: str) -> Setup:
    """
    Return a setup with a law and its gains by the rule, for a controller that knows its drives.

    What is known of drives and friction is taken from the plant.
    """
    plant, config = setup.plant, setup.controller.changed({'law': law})
    known = {'law': law, 'actuator_lag': plant.actuator_lag,
             'torque_rate_limit': plant.torque_rate_limit}
    if 'switching' in config.law_parameters:
        known['switching'] = RECOMMENDED_SWITCHING
    friction = {'friction_level': plant.coulomb_friction}
    values = known | gains_by_rule(setup.changed({'controller': {**known, **friction}}))
    rule = gain_rule(law)
    if rule.knows_friction:
        values |= friction
    if not law_class(law).is_bounded:
        values['effort_rate_limit'] = plant.torque_rate_limit
    start = max(setup.reference.start_duration, rule.start_duration)
    return dataclasses.replace(
        setup, controller=setup.controller.changed(values),
        reference=setup.reference.changed({'start_duration': start}))

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
Laws of runs, and their recommended gains.

`ctc compare`, `tune` and `map` name each law, switching and source of gains by `LawSettings`. The
rules of the gains are in `control/recommended_gains.py`. `known_loop` hands them what a controller
may know of its robot.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import dataclasses
from functools import partial
from typing import Any

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

#: Gains of the parameter file.
FILE = 'file'
#: Gains by the rule of the law.
RECOMMENDED = 'recommended'
#: Sources of gains.
GAIN_SOURCES = (FILE, RECOMMENDED)


@dataclasses.dataclass(frozen=True)
class LawSettings:
    """
    A law with its switching and gains.

    Attributes
    ----------
    law, switching : str
        Law at the start. The switching is empty for a law without.
    gain_source : str
        One of `GAIN_SOURCES`.
    values : mapping
        Parameters of the controller that win over these gains.
    name : str
        Name in tables.

    """

    law: str
    switching: str = ''
    gain_source: str = FILE
    values: Mapping[str, Any] = dataclasses.field(default_factory=dict, hash=False)
    name: str = ''

    @property
    def is_recommended(self) -> bool:
        """Use of the gains by the law's rule."""
        return self.gain_source == RECOMMENDED

    @property
    def columns(self) -> dict[str, str]:
        """Columns of a comparison that tell the laws."""
        return {'law': self.law, 'switching': self.switching, 'settings': self.gain_source}

    @property
    def parameters(self) -> dict[str, Any]:
        """Parameters of the controller, law and switching included."""
        switching = {'switching': self.switching} if self.switching else {}
        return {'law': self.law, **switching, **self.values}


#: The law to which all others are compared.
BASELINE = LawSettings(BASELINE_LAW)
#: The law whose torque variation measures that of all others.
BEST = LawSettings(RECOMMENDED_LAW, '', RECOMMENDED)


def desired_points(setup: Setup, duration: float, count: int) -> Iterator[list[list[float]]]:
    """Yield q_d, dq_d and ddq_d at instants of the motion."""
    plant, reference = setup.plant, setup.reference
    states = zip(plant.initial_position, plant.initial_velocity)
    start = dict(zip(plant.joint_names, states))
    motion = make_motion(reference, setup.route, start, continuous=setup.continuous)
    order = [reference.joint_names.index(name) for name in setup.controller.joint_names]
    for t in np.linspace(0.0, 1e9 * duration, count).astype(int).tolist():
        yield [[row[i] for i in order] for row in motion.at(t)]


def largest_torque(setup: Setup) -> Array:
    """Return the model's largest torque in the motion [N·m]."""
    model = model_of(setup.controller, setup.descriptions.get('controller', ''))
    points = desired_points(setup, setup.plant.duration, 500)
    torques = [model.inverse_dynamics(*point) for point in points]
    largest: Array = np.abs(torques).max(axis=0)
    return largest


def known_loop(setup: Setup) -> KnownLoop:
    """Return the knowledge that rules of gains may use."""
    resolution = max(*setup.plant.encoder_resolution, *setup.plant.position_noise)
    return KnownLoop(setup.controller, partial(largest_torque, setup), resolution)


def gains_by_rule(setup: Setup, law: str = '') -> dict[str, Any]:
    """
    Return the gains of a law by its rule.

    The default is the law in force.
    """
    return recommended_gains(law or setup.controller.law, known_loop(setup))


def recommended_setup(setup: Setup, law: str) -> Setup:
    """
    Return a setup with a law and recommended gains.

    Knowledge of drives and friction is taken from the plant.
    """
    plant, config = setup.plant, setup.controller.changed({'law': law})
    knowledge = {'law': law, 'actuator_lag': plant.actuator_lag,
                 'torque_rate_limit': plant.torque_rate_limit}
    if 'switching' in config.law_parameters:
        knowledge['switching'] = RECOMMENDED_SWITCHING
    friction = {'friction_level': plant.coulomb_friction}
    values = knowledge | gains_by_rule(setup.changed({'controller': knowledge | friction}))
    rule = gain_rule(law)
    if rule.knows_friction:
        values |= friction
    if not law_class(law).is_bounded:
        values['effort_rate_limit'] = plant.torque_rate_limit
    start = max(setup.reference.start_duration, rule.start_duration)
    return dataclasses.replace(
        setup, controller=setup.controller.changed(values),
        reference=setup.reference.changed({'start_duration': start}))

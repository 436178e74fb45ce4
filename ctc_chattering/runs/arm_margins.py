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
Rotors and masses with which an arm is stable.

`ctc stability` and `ctc new-robot` print them. `margins/inertia_margins.py` computes them.
"""

from __future__ import annotations

from collections.abc import Iterator
import dataclasses

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.arm_knowledge import (
    ASSUMED_ROTOR,
    LEAST_ROTOR,
    MOST_ROTOR,
    Source,
)
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.new_robot import NewRobot
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.margins.inertia_margins import ArmInertia, ArmMargins
from ctc_chattering.margins.loop_margins import StableRange
from ctc_chattering.runs.stability import loops_of, masses_of, range_text
import numpy as np


def arm_margins(setup: Setup) -> ArmMargins | None:
    """
    Return the margins of a described arm.

    They are None for another robot, and for joints that differ in gains.
    """
    model = model_of(setup.controller, setup.descriptions.get('controller', ''))
    if not isinstance(model, UrdfModel):
        return None
    loops = loops_of(setup)
    if not loops.joints_are_equal:
        return None
    rotors = np.diag(model.rotor_inertias)
    bodies = [mass - rotors for mass in masses_of(setup)]
    return ArmInertia(bodies, rotors, np.diag(model.effort_limits)).margins(loops.ratios())


def arm_rows(margins: ArmMargins) -> Iterator[tuple[str, str]]:
    """Yield the margins as rows, rounded inwards."""
    if margins.rotors:
        yield 'rotors / rotors of the model', range_text(margins.rotors)
    if margins.lacking is not None:
        lacking = range_text(StableRange(0.0, margins.lacking))
        yield 'rotors that the model lacks', f'{lacking} kg*m^2 per N*m of effort'
    if margins.masses:
        yield 'masses / masses of the model', range_text(margins.masses)


def arm_lines(margins: ArmMargins) -> Iterator[str]:
    """Yield the margins as lines of text."""
    for factors, name in ((margins.rotors, 'rotors'), (margins.masses, 'masses')):
        if factors:
            yield f'the sampled loop is stable with {range_text(factors)} times these {name}'


def with_stable_gains(robot: NewRobot) -> NewRobot:
    """
    Return a robot with gains that suit its assumed rotors.

    Rotors assumed to be 0.002 kg·m² per N·m may be 0.001 to 0.006. Without assumed rotors, or
    where less bandwidth does not help, nothing changes.
    """
    if not any(rotor.source == Source.ASSUMED for rotor in robot.knowledge.rotors):
        return robot
    gains = robot.values['controller']
    pole = lower = 0.5 * gains['kv'][0]
    n = len(robot.joints)
    while lower >= 10.0:  # [rad/s]
        values = {**robot.values, 'controller': {
            **gains, 'kp': [lower ** 2] * n, 'kv': [2.0 * lower] * n,
            'estimator_bandwidth': gains['estimator_bandwidth'] * lower / pole}}
        changed = robot if lower == pole else dataclasses.replace(robot, values=values)
        margins = arm_margins(parameter_file.load(None, changed.values))
        if margins is None or _covers_assumed_rotors(margins.rotors):
            return changed
        lower *= 0.8
    return robot


def _covers_assumed_rotors(rotors: StableRange | None) -> bool:
    """Return whether a range has all possible rotors."""
    return (rotors is not None and rotors.low <= LEAST_ROTOR / ASSUMED_ROTOR
            and rotors.high >= MOST_ROTOR / ASSUMED_ROTOR)

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
Rotors and masses with which the sampled loop of an arm is stable.

A loop whose joints have the same gains is stable for the eigenvalues ρ of M̂ M⁻¹ in an interval
(`runs/stability.py`). With M̂ = B + R of bodies and rotors, at positions of the motion::

    rotors x R:  ρ of (B + R) (B + x R)⁻¹       masses x B:  ρ of (B + R) (x B + R)⁻¹     (AM1)
    rotors that the model lacks, per effort limit E:  ρ of M̂ (M̂ + x E)⁻¹                 (AM2)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import dataclasses
from math import inf
from typing import NamedTuple

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
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.runs.stability import (
    loops_of,
    masses_of,
    outside,
    span_text,
    stable,
    StableRange,
)
import numpy as np

#: Factors that are looked at, and rotors per effort limit [kg·m² per N·m].
_FACTORS = np.geomspace(0.01, 100.0, 200)
_ROTORS = np.geomspace(1e-6, 0.1, 200)
#: By what the pole is lowered until the assumed rotors are within the margins, and its least.
_LOWER, _LEAST_POLE = 0.8, 10.0


class ArmMargins(NamedTuple):
    """
    What an arm may be for a stable loop; None where it does not apply, or nothing is stable.

    Attributes
    ----------
    rotors : StableRange or None
        Rotors over those of the model.
    lacking : float or None
        Largest rotors per effort limit where the model has none [kg·m² per N·m].
    masses : StableRange or None
        Masses of all bodies over those of the model.

    """

    rotors: StableRange | None
    lacking: float | None
    masses: StableRange | None

    def rows(self) -> Iterator[tuple[str, str]]:
        """Yield rows of a table, rounded inwards."""
        if self.rotors:
            yield 'rotors / rotors of the model', span_text(self.rotors)
        if self.lacking is not None:
            yield ('rotors that the model lacks',
                   f'{span_text(StableRange(0.0, self.lacking))} kg*m^2 per N*m of effort')
        if self.masses:
            yield 'masses / masses of the model', span_text(self.masses)

    def lines(self) -> Iterator[str]:
        """Yield what these margins are, in words."""
        for span, what in ((self.rotors, 'rotors'), (self.masses, 'masses')):
            if span:
                yield f'the sampled loop is stable with {span_text(span)} times these {what}'


class _Inertia(NamedTuple):
    """M of the bodies at positions, and diagonal matrices of rotors and of effort limits."""

    bodies: Sequence[Array]
    rotors: Array
    effort: Array

    def within(self, span: StableRange, change: Callable[[Array, float], Array], start: float,
               grid: Array) -> StableRange | None:
        """Return for which numbers the eigenvalues of M̂ M⁻¹ are within `span`, M changed."""
        def excess(x: float) -> float:
            return max(outside(span, bodies + self.rotors, change(bodies, x))
                       for bodies in self.bodies)
        return stable(excess, start, grid)


def arm_margins(setup: Setup) -> ArmMargins | None:
    """Return the margins of a described arm; None of another, or if its joints differ in gains."""
    model = model_of(setup.controller, setup.descriptions.get('controller', ''))
    if not isinstance(model, UrdfModel):
        return None
    loops = loops_of(setup)
    if not loops.joints_are_equal:
        return None
    span = loops.ratios()
    if span is None:
        return ArmMargins(None, None, None)
    rotors, effort = np.diag(model.rotor_inertias), np.array(model.effort_limits)
    arm = _Inertia([mass - rotors for mass in masses_of(setup)], rotors, np.diag(effort))
    lacking = None
    if not rotors.any() and (effort < inf).all():
        found = arm.within(span, lambda bodies, x: bodies + x * arm.effort, _ROTORS[0], _ROTORS)
        lacking = found.high if found else 0.0
    return ArmMargins(
        arm.within(span, lambda bodies, x: bodies + x * rotors, 1.0, _FACTORS)
        if rotors.any() else None, lacking,
        arm.within(span, lambda bodies, x: x * bodies + rotors, 1.0, _FACTORS))


def with_stable_gains(robot: NewRobot) -> NewRobot:
    """
    Return a robot with a pole that is low enough for the range of its assumed rotors.

    Those that are assumed to be 0.002 kg·m² per N·m may be 0.001 to 0.006. Without assumed rotors,
    or where less bandwidth does not help, nothing changes.
    """
    if not any(rotor.source == Source.ASSUMED for rotor in robot.knowledge.rotors):
        return robot
    gains = robot.values['controller']
    pole, n = 0.5 * gains['kv'][0], len(robot.joints)
    lower = pole
    while lower >= _LEAST_POLE:
        values = {**robot.values, 'controller': {
            **gains, 'kp': [lower ** 2] * n, 'kv': [2.0 * lower] * n,
            'estimator_bandwidth': gains['estimator_bandwidth'] * lower / pole}}
        changed = robot if lower == pole else dataclasses.replace(robot, values=values)
        margins = arm_margins(parameter_file.load(None, changed.values))
        if margins is None or (margins.rotors and (
                margins.rotors.low <= LEAST_ROTOR / ASSUMED_ROTOR
                and margins.rotors.high >= MOST_ROTOR / ASSUMED_ROTOR)):
            return changed
        lower *= _LOWER
    return robot

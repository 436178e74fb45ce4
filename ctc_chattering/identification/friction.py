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
Friction of each joint from the regression, as numbers with intervals.

The terms of the regression become Coulomb, viscous and Stribeck friction. Intervals contain the
unexplained torque that lasts, and a part of what the selected terms changed.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import Any, NamedTuple

from ctc_chattering.identification.findings import Estimate, Gap
from ctc_chattering.identification.friction_terms import TermKind
from ctc_chattering.identification.regression import FEWEST_WINDOWS, Fit, Observations
from ctc_chattering.identification.windows import STRIBECK_VELOCITIES
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Half an interval over the RMS of the unexplained torque that lasts.
OTHER_FORM = 2.0
#: Half an interval over the change by the selected terms, where they explain nothing.
DOUBTFUL_FORM = 1.5
#: The same where a form that predicts as well would change it the other way.
OTHER_CURVE = 3.0


class CoupledFriction(NamedTuple):
    """
    Friction of another joint in the torque of a joint.

    Attributes
    ----------
    joint : int
        Index of the other joint.
    coulomb, viscous : Estimate
        By the direction and the velocity of the other joint [N·m, N·m·s/rad].

    """

    joint: int
    coulomb: Estimate
    viscous: Estimate


@dataclasses.dataclass(frozen=True)
class JointFriction:
    """
    Coulomb, viscous, Stribeck and load friction of a joint.

    Attributes
    ----------
    coulomb : Estimate
        Mean of both directions [N·m].
    forwards, backwards : Estimate
        Coulomb friction of each direction [N·m].
    viscous : Estimate
        [N·m·s/rad].
    stribeck, stribeck_velocity : Estimate
        Friction at rest beyond the Coulomb friction [N·m], below 0 where friction grows from
        rest, and the velocity with which it fades [rad/s].
    load : Estimate
        Friction as a part of the magnitude of the torque through the gear.
    dead_band : Estimate
        Torque that the drive takes of its command [N·m].
    coupled : tuple of CoupledFriction
        Friction of other joints in this one's torque.

    """

    coulomb: Estimate
    forwards: Estimate
    backwards: Estimate
    viscous: Estimate
    stribeck: Estimate
    stribeck_velocity: Estimate
    load: Estimate
    dead_band: Estimate
    coupled: tuple[CoupledFriction, ...] = ()

    @classmethod
    def unknown(cls) -> JointFriction:
        """Return the friction of a joint that hardly moves."""
        unknown = Estimate.unknown(Gap.HARDLY_MOVES)
        return cls(unknown, unknown, unknown, unknown, unknown, unknown, unknown, unknown)

    def as_mapping(self, joints: Sequence[str]) -> dict[str, Any]:
        """Return it as JSON has it, with the names of joints."""
        numbers = {name: getattr(self, name).as_mapping() for name in NUMBERS}
        return {
            **numbers,
            'coupled': [
                {
                    'joint': joints[x.joint],
                    'coulomb': x.coulomb.as_mapping(),
                    'viscous': x.viscous.as_mapping(),
                }
                for x in self.coupled
            ],
        }

    @property
    def at_rest(self) -> float:
        """Largest friction near rest [N·m], 0 if it is not known."""
        coulomb = [abs(x.value or 0.0) for x in (self.coulomb, self.forwards, self.backwards)]
        return max(coulomb) + max(self.stribeck.value or 0.0, 0.0)


#: Names of the numbers of a joint's friction.
NUMBERS = tuple(
    field.name for field in dataclasses.fields(JointFriction) if field.name != 'coupled'
)


def joint_friction(
    fit: Fit,
    joint: int,
    systematic: float = 0.0,
    basic: Fit | None = None,
    is_curved: bool = False,
) -> JointFriction:
    """
    Return the friction of a joint.

    Parameters
    ----------
    fit : Fit
        The regression.
    joint : int
        Index of the joint.
    systematic : float
        RMS of unseen torque that lasts longer than noise [N·m]. Friction may have that much of
        another form, so intervals contain it.
    basic : Fit, optional
        The regression without the terms that were selected. Where these leave much unexplained,
        another form of friction explains as much, and intervals contain a part of the change.
    is_curved : bool
        Whether another form explains as much in any case.

    """
    if not fit.data.moving[joint]:
        return JointFriction.unknown()
    used = fit.data.used[:, joint]
    speed = float(np.sqrt(np.square(fit.data.windows.velocity[used, joint]).mean()))
    doubt = OTHER_CURVE
    if not is_curved:
        doubt = DOUBTFUL_FORM * _unexplained_by_added(fit, basic, joint)

    def estimate(weights: dict[TermKind, float], unit: str, form: float) -> Estimate:
        row = _row(fit, joint, weights)
        value = float(row @ fit.value)
        halves = [float(fit.half_interval(row)), OTHER_FORM * form]
        if basic is not None:
            halves.append(doubt * (value - float(_row(basic, joint, weights) @ basic.value)))
        return Estimate(value, float(np.linalg.norm(halves)), unit)

    def torque(term_kind: TermKind, offset: float = 0.0) -> Estimate:
        return estimate({term_kind: 1.0, TermKind.OFFSET: offset}, 'N*m', systematic)

    def viscous(term_kind: TermKind) -> Estimate:
        return estimate({term_kind: 1.0}, 'N*m*s/rad', systematic / speed)

    numbers = {
        'coulomb': torque(TermKind.COULOMB),
        'forwards': torque(TermKind.COULOMB, 1.0),
        'backwards': torque(TermKind.COULOMB, -1.0),
        'viscous': viscous(TermKind.VISCOUS),
        'stribeck': _no_stribeck(fit.data, joint),
        'stribeck_velocity': Estimate.none(),
        'load': Estimate.none(),
        'dead_band': Estimate.none(gap=Gap.IN_COULOMB),
    }
    coupled: tuple[CoupledFriction, ...] = ()
    for term in map(fit.unknowns.term, fit.unknowns.of_joint(joint)):
        if term.kind == TermKind.STRIBECK:
            numbers['stribeck'] = torque(term.kind)
            numbers['stribeck_velocity'] = Estimate(term.stribeck_velocity, unit='rad/s')
        elif term.kind == TermKind.LOAD:
            numbers['load'] = estimate({term.kind: 1.0}, '', 0.0)
        elif term.kind == TermKind.DEAD_BAND:
            numbers['dead_band'] = torque(term.kind)
        elif term.kind == TermKind.COUPLED_COULOMB:
            coupled = (
                CoupledFriction(
                    int(term.which), torque(term.kind), viscous(TermKind.COUPLED_VISCOUS)
                ),
            )
    return JointFriction(**numbers, coupled=coupled)


def _row(fit: Fit, joint: int, weights: dict[TermKind, float]) -> Array:
    """Return the weights of x for weighted coefficients, shape (m,)."""
    rows = [factor * fit.unknowns.row(joint, x) for x, factor in weights.items()]
    return np.asarray(np.sum(rows, axis=0))


def _unexplained_by_added(fit: Fit, basic: Fit | None, joint: int) -> float:
    """
    Return the noise of a joint over that without added terms.

    It is 0 if there are none.
    """
    if basic is None or (len(fit.unknowns.of_joint(joint)) == len(basic.unknowns.of_joint(joint))):
        return 0.0
    return float(fit.noise.deviation[joint] / basic.noise.deviation[joint])


def _no_stribeck(data: Observations, joint: int) -> Estimate:
    """Return the absence of Stribeck friction above a velocity."""
    speed = np.abs(data.windows.velocity[data.used[:, joint], joint])
    slow = [v for v in STRIBECK_VELOCITIES if (speed < v).sum() >= FEWEST_WINDOWS]
    if not slow:
        return Estimate.unknown(Gap.NOT_SLOW)
    return Estimate.none(shown_above=slow[0])

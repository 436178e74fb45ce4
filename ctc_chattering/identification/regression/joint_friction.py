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

"""Friction of a joint, from the terms of the regression."""

from __future__ import annotations

import dataclasses

from ctc_chattering.identification.regression.estimate import Estimate, NONE
from ctc_chattering.identification.regression.least_squares import (
    stribeck_velocity,
    Term,
    TermKind,
)
from ctc_chattering.identification.regression.rows import STRIBECK
from ctc_chattering.identification.regression.selection import Selected
import numpy as np


@dataclasses.dataclass(frozen=True)
class JointFriction:
    """
    Friction of one joint.

    Attributes
    ----------
    coulomb, forwards, backwards : Estimate
        Coulomb friction: mean of both directions, and each [N·m].
    offset : Estimate
        Half of forwards less backwards [N·m]: friction that depends on the direction, or a
        constant torque that the model lacks; no motion can distinguish these.
    viscous : Estimate
        [N·m·s/rad].
    stribeck, stribeck_velocity : Estimate
        Ks [N·m] and v_s [rad/s].
    load : Estimate
        Part of the torque's magnitude.

    """

    coulomb: Estimate
    forwards: Estimate
    backwards: Estimate
    offset: Estimate
    viscous: Estimate
    stribeck: Estimate
    stribeck_velocity: Estimate
    load: Estimate


def joint_friction(selected: Selected, i: int) -> JointFriction:
    """Return the friction of joint i."""
    terms, missing = selected.fit.terms, selected.missing

    def number(kind: TermKind, unit: str) -> Estimate:
        for term in terms:
            if (term.kind, term.joint) == (kind, i):
                return Estimate(*selected.interval(term), unit)
        return Estimate.none(missing.get((kind, i), NONE))

    forwards, backwards = number(TermKind.FORWARDS, 'N*m'), number(TermKind.BACKWARDS, 'N*m')
    both = forwards.value is not None and backwards.value is not None
    if both:
        a, b = Term(TermKind.FORWARDS, i), Term(TermKind.BACKWARDS, i)
        coulomb = Estimate(*selected.combined({a: 0.5, b: 0.5}), 'N*m')
        offset = Estimate(*selected.combined({a: 0.5, b: -0.5}), 'N*m')
    else:
        reason = forwards.reason or backwards.reason
        coulomb = offset = Estimate.none(reason)
        if 'hardly moves' in reason:
            coulomb = offset = Estimate.none(f'{reason}: friction and a constant torque look the '
                                             'same in one direction')
    return JointFriction(coulomb, forwards, backwards, offset,
                         number(TermKind.VISCOUS, 'N*m*s/rad'),
                         number(TermKind.STRIBECK, 'N*m'), _stribeck_velocity(selected, i),
                         number(TermKind.LOAD, ''))


def _stribeck_velocity(selected: Selected, i: int) -> Estimate:
    """Return v_s of joint i with its interval, from the slope of the column by its place."""
    for term in selected.fit.terms:
        if (term.kind, term.joint) == (TermKind.STRIBECK, i):
            size = selected.fit.of(term)
            _, half = selected.interval(Term(TermKind.STRIBECK_SLOPE, i, term.which))
            velocity = stribeck_velocity(term.which)
            ratio = float(np.log(STRIBECK[1] / STRIBECK[0]))
            return Estimate(velocity, velocity * ratio * half / size, 'rad/s')
    return Estimate.none(selected.missing.get((TermKind.STRIBECK, i), NONE))

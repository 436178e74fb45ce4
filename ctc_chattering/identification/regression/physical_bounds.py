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

"""What the data ask for and no body can have: reasons to doubt them, or to refuse."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ctc_chattering.dynamics.pseudo_inertia import pseudo_inertia
from ctc_chattering.identification.regression.finding import Finding, Severity
from ctc_chattering.identification.regression.physical_consistency import ConsistentBodies
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Twice the logarithm of the likelihood ratio above which bounds contradict the data.
_CLEAR = 30.0
#: Part of a joint's torque that bounds change: care, and refused.
_CARE, _REFUSED = 0.01, 0.05
#: Part of the contradiction from which on a body is named.
_NAMED = 0.1
_CURE = ('check the order of --joints, the sign and the side of the torque (--effort) and the '
         'URDF; then record a motion with more poses and accelerations')


def physical_findings(bodies: ConsistentBodies, joints: Sequence[str],
                      friction: Sequence[float] = ()) -> Iterator[Finding]:
    """
    Yield findings for the joints whose torque the bounds of bodies change.

    Parameters
    ----------
    bodies : ConsistentBodies
        As identified.
    joints : sequence of str, length n
        Names.
    friction : sequence of float, shape (n,), optional
        That is in the torque as well [N·m].

    """
    change = bodies.found - bodies.wanted
    if not len(bodies.estimate.torque) or change @ bodies.estimate.information @ change < _CLEAR:
        return
    what = '; '.join(_asked(bodies, joints))
    size, whole = bodies.torque(change), bodies.torque(bodies.found)
    whole = whole + np.asarray(friction) if len(friction) else whole
    for i, name in enumerate(joints):
        part = size[i] / whole[i] if whole[i] > 0.0 else 0.0
        if part > _CARE:
            yield Finding(
                Severity.REFUSED if part > _REFUSED else Severity.CARE, i,
                f'the torque of {name} asks for what no body can have: {what}; bodies that can be '
                f'differ by {size[i]:.2g} N*m, {part:.0%} of its torque', _CURE)


def _asked(bodies: ConsistentBodies, joints: Sequence[str]) -> Iterator[str]:
    """Yield what the data ask for, of the bodies that contradict most."""
    names = bodies.estimate.names
    for k, cost in enumerate(bodies.cost):
        if cost < _NAMED * bodies.cost.sum():
            continue
        if k >= len(names):
            rotor = bodies.wanted[10 * len(names):][k - len(names)]
            yield f'a rotor inertia of {rotor:.3g} kg*m^2 at {joints[k - len(names)]}'
        else:
            yield f'{names[k]} with {impossible(bodies.wanted[10 * k:10 * k + 10])}'


def impossible(parameters: Array) -> str:
    """Return what is wrong with the parameters of a body, in words; empty if nothing is."""
    matrix = pseudo_inertia(parameters)
    mass = float(parameters[0])
    if not mass > 0.0:
        return f'a mass of {mass:.3g} kg'
    first, second, third = np.linalg.eigvalsh(
        matrix[:3, :3] - np.outer(matrix[:3, 3], matrix[:3, 3]) / mass).tolist()
    if first >= 0.0:
        return ''
    moments = sorted((first + second, first + third, second + third))
    shown = ', '.join(f'{x:.3g}' for x in moments)
    return (f'principal moments of inertia {shown} kg*m^2, of which '
            + ('one is negative' if moments[0] < 0.0 else 'the largest exceeds the sum of others'))

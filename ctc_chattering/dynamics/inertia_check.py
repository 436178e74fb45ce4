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

"""What a URDF says of masses and inertias, checked link by link: no rigid body can break these."""

from __future__ import annotations

from collections.abc import Sequence
import xml.etree.ElementTree as ET

from ctc_chattering.dynamics.urdf_parser import Tree
import numpy as np

#: By how much a moment of inertia may exceed the sum of the others: digits of the file.
_ROUNDING = 1e-3
#: What counts as 0 [kg*m^2].
_NOTHING = 1e-15


def inertia_faults(urdf: str, joints: Sequence[str]) -> list[str]:
    """
    Return what is wrong with the links that move, a line for each; empty if nothing is.

    A link moves if one of `joints` is between it and the root. It must have a mass if it has a
    shape, and principal moments of inertia that are positive and of which none exceeds the sum
    of the other two.

    Parameters
    ----------
    urdf : str
        Text that `urdf_parser.Tree` accepts.
    joints : sequence of str
        Those of the model.

    """
    tree = Tree(urdf)
    moving: set[str] = set()
    for name, (parent, child) in tree.ends.items():
        if name in joints or parent in moving:
            moving.add(child)
    return [f'link {name} {fault}' for name, link in tree.links.items()
            if name in moving and (fault := _fault(link))]


def _fault(link: ET.Element) -> str:
    """Return what is wrong with the inertia of a link; empty for nothing."""
    shaped = link.find('visual') is not None or link.find('collision') is not None
    mass, tensor = link.find('inertial/mass'), link.find('inertial/inertia')
    if mass is None or tensor is None:
        return 'moves and has a shape, but no inertia' if shaped else ''
    m = float(mass.get('value', ''))
    xx, xy, xz, yy, yz, zz = (
        float(tensor.get(key, '')) for key in ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz'))
    first, second, third = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).tolist()
    shown = f'principal moments {first:.4g}, {second:.4g}, {third:.4g} kg*m^2'
    if m < 0.0 or first < -_ROUNDING * abs(third) - _NOTHING:
        return f'has a mass of {m:g} kg and {shown}: none may be negative'
    if m == 0.0 and shaped:
        return 'moves and has a shape, but no mass'
    if third > (1.0 + _ROUNDING) * (first + second) + _NOTHING:
        return f'has {shown}: the largest exceeds the sum of the others'
    return ''

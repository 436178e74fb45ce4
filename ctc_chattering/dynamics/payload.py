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
Payloads: bodies added to the URDF of an arm.

Plant, `ctc new-robot` and `ctc identify` load arms with it. Input is the text of a URDF.
"""

from __future__ import annotations

from collections.abc import Sequence
import xml.etree.ElementTree as ET

from ctc_chattering.dynamics.description_xml import parse_description
from ctc_chattering.dynamics.urdf_parser import (
    add_joint,
    fill_inertial,
    Inertial,
    MOMENTS,
    Origin,
    Tree,
)
from ctc_chattering.errors import CtcError, ParameterError, suggest

#: Name of the link and of the joint that are added.
_PAYLOAD_NAME = 'ctc_chattering_payload'
#: Radius of the sphere [m].
_RADIUS_M = 0.05


def tip_of(tree: Tree, joint_names: Sequence[str]) -> str:
    """
    Return the last link that the arm's last joint carries.

    Raises
    ------
    CtcError
        If there is no such joint.

    """
    if joint_names[-1] not in tree.joints:
        raise ParameterError(
            'joint_names', tuple(joint_names), 'joints of the description'
        )
    tip = tree.ends[joint_names[-1]][1]
    for name, (parent, child) in tree.ends.items():  # From the root outwards.
        if parent == tip and name not in tree.joints:
            tip = child
    return tip


def with_payload(
    description: str, joint_names: Sequence[str], mass: float, link: str = ''
) -> str:
    """
    Return a URDF with a sphere added to a link.

    Parameters
    ----------
    description : str
        The URDF.
    joint_names : sequence of str
        Joints of the arm.
    mass : float
        Mass of the sphere, above 0 [kg].
    link : str
        Link that carries the sphere. The default is that of `tip_of`.

    Raises
    ------
    CtcError
        If the description is no URDF, or lacks the last joint or the link.

    """
    robot = parse_description(description)
    tree = Tree(robot)
    if link and link not in tree.links:
        raise CtcError(
            f'payload: no link is called {link}; allowed: {", ".join(tree.links)}'
            f'{suggest(link, tree.links)}'
        )
    carrier = link or tip_of(tree, joint_names)
    moment = 0.4 * mass * _RADIUS_M**2
    moments = dict.fromkeys(MOMENTS, 0.0) | dict.fromkeys(('ixx', 'iyy', 'izz'), moment)
    payload = ET.SubElement(robot, 'link', name=_PAYLOAD_NAME)
    fill_inertial(ET.SubElement(payload, 'inertial'), Inertial(Origin(), mass, moments))
    add_joint(robot, _PAYLOAD_NAME, 'fixed', carrier, _PAYLOAD_NAME)
    return ET.tostring(robot, encoding='unicode')

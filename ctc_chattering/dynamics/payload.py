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

"""A payload at the end of an arm, added to its description."""

from __future__ import annotations

from collections.abc import Sequence
import xml.etree.ElementTree as ET

from ctc_chattering.dynamics.urdf_parser import parse_description, Tree
from ctc_chattering.errors import CtcError, near, ParameterError

#: Name of the link and of the joint that are added; radius of the sphere [m].
NAME, _RADIUS = 'ctc_chattering_payload', 0.05


def with_payload(description: str, joint_names: Sequence[str], mass: float, link: str = ''
                 ) -> str:
    """
    Return a URDF with a sphere of 5 cm fixed to the end of the arm, or at the origin of a link.

    The end is the origin of the last link that follows the last joint over fixed joints only.

    Parameters
    ----------
    description : str
        The URDF.
    joint_names : sequence of str
        Joints of the arm.
    mass : float
        Of the sphere, above 0 [kg].
    link : str
        That it is fixed to; empty for the end.

    Raises
    ------
    CtcError
        If the description is no URDF, or lacks the last joint or the link.

    """
    robot = parse_description(description)
    if robot.tag != 'robot':
        raise CtcError('payload needs a URDF, no MJCF')
    tree = Tree(description)
    if joint_names[-1] not in tree.joints:
        raise ParameterError('joint_names', tuple(joint_names), 'joints of the description')
    if link and link not in tree.links:
        raise CtcError(f'payload: no link is called {link}; allowed: {", ".join(tree.links)}'
                       f'{near(link, tree.links)}')
    end = link or tree.ends[joint_names[-1]][1]
    for name, (parent, child) in tree.ends.items():  # From the root outwards.
        if not link and parent == end and name not in tree.joints:
            end = child
    inertia = f'{0.4 * mass * _RADIUS ** 2!r}'
    inertial = ET.SubElement(ET.SubElement(robot, 'link', name=NAME), 'inertial')
    ET.SubElement(inertial, 'mass', value=repr(mass))
    ET.SubElement(inertial, 'inertia', ixx=inertia, iyy=inertia, izz=inertia, ixy='0', ixz='0',
                  iyz='0')
    joint = ET.SubElement(robot, 'joint', name=NAME, type='fixed')
    ET.SubElement(joint, 'parent', link=end)
    ET.SubElement(joint, 'child', link=NAME)
    return ET.tostring(robot, encoding='unicode')

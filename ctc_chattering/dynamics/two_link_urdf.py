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

"""A URDF of the paper's two-link arm, for its picture and for tools that read URDF only."""

from __future__ import annotations

from collections.abc import Sequence
from xml.sax.saxutils import quoteattr

#: Terms of the model: M11 and M22 at c2 = 0, half the factor of c2, and the two of gravity.
_M11, _M22, _COUPLING, _GRAVITY_1, _GRAVITY_2 = 8.77, 0.62, 0.51, 7.6, 0.63
#: m2 l1 c2 couples the joints and m2 c2 is the moment of gravity of link 2: so long is link 1 [m].
LENGTH = _COUPLING / _GRAVITY_2

_LINK = """  <link name="{name}">
    <inertial>
      <origin xyz="0 0 {centre!r}"/>
      <mass value="{mass!r}"/>
      <inertia ixx="{inertia!r}" ixy="0" ixz="0" iyy="{inertia!r}" iyz="0" izz="0.001"/>
    </inertial>
    <visual>
      <origin xyz="0 0 {centre!r}"/>
      <geometry><cylinder radius="0.04" length="{length!r}"/></geometry>
    </visual>
    <visual>
      <origin xyz="0 0 0" rpy="1.5707963267948966 0 0"/>
      <geometry><cylinder radius="0.06" length="0.14"/></geometry>
    </visual>
  </link>
"""
_JOINT = """  <joint name={name} type="continuous">
    <parent link="{parent}"/>
    <child link="{child}"/>
    <origin xyz="0 0 {z!r}"/>
    <axis xyz="0 -1 0"/>
  </joint>
"""


def two_link_urdf(joint_names: Sequence[str] = ('joint1', 'joint2')) -> str:
    """
    Return the text of a URDF with the model's C, G, M11 and M22.

    The constant part of M12 is 0.62 kg·m² instead of the paper's 0.76, which no rigid body has.
    The model gives the length of link 1; link 2 is drawn as long, with both centres of mass in the
    middle. At q = 0 the arm hangs along -z, and it moves in the x-z plane.
    """
    centre = LENGTH / 2
    mass2 = _GRAVITY_2 / centre
    mass1 = (_GRAVITY_1 - mass2 * LENGTH) / centre
    inertia2 = _M22 - mass2 * centre ** 2
    inertia1 = _M11 - _M22 - mass2 * LENGTH ** 2 - mass1 * centre ** 2
    links = ''.join(
        _LINK.format(name=name, centre=-centre, mass=mass, inertia=inertia, length=LENGTH)
        for name, mass, inertia in (('link1', mass1, inertia1), ('link2', mass2, inertia2)))
    joints = ''.join(
        _JOINT.format(name=quoteattr(name), parent=parent, child=child, z=z)
        for name, parent, child, z in zip(
            joint_names, ('base', 'link1'), ('link1', 'link2'), (0.0, -LENGTH)))
    return (f'<?xml version="1.0"?>\n<robot name="two_link">\n  <link name="base"/>\n'
            f'{links}{joints}</robot>\n')

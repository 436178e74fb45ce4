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

"""URDFs for the tests: real robots, and small ones made here."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
import importlib.metadata
from pathlib import Path
from xml.etree import ElementTree

PANDA = tuple(f'panda_joint{i}' for i in range(1, 8))
TWO_LINKS = ('a', 'b')
UR5 = ('shoulder_pan_joint', 'shoulder_lift_joint', 'elbow_joint', 'wrist_1_joint',
       'wrist_2_joint', 'wrist_3_joint')


@cache
def robot(name: str) -> str:
    """Return the URDF of a robot of the package example-robot-data."""
    files = importlib.metadata.files('example-robot-data') or []
    found = [file for file in files if file.name == f'{name}.urdf']
    return Path(str(found[0].locate())).read_text(encoding='utf-8')


def write_urdf(path: Path, text: str) -> str:
    """Write a URDF; return its path."""
    path.write_text(text)
    return str(path)


def panda() -> str:
    """Return the URDF of the Panda, whose second finger mimics the first."""
    return robot('panda')


def ur5() -> str:
    """Return the URDF of the UR5."""
    return robot('ur5_robot')


def link(name: str, mass: float = 0.0, center: tuple[float, float, float] = (0.0, 0.0, 0.0),
         inertia: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> str:
    """Return a link; without inertia if it has no mass."""
    if not mass:
        return f'<link name="{name}"/>'
    x, y, z = center
    xx, yy, zz = inertia
    return (f'<link name="{name}"><inertial><origin xyz="{x} {y} {z}"/><mass value="{mass}"/>'
            f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>'
            '<visual><geometry><mesh filename="package://nowhere/no.dae"/></geometry></visual>'
            '</link>')


def joint(name: str, kind: str, parent: str, child: str, axis: str = '0 0 1',
          xyz: str = '0 0 0', more: str = '<limit effort="0" velocity="0"/>',
          rpy: str = '0 0 0') -> str:
    """Return a joint."""
    return (f'<joint name="{name}" type="{kind}"><origin xyz="{xyz}" rpy="{rpy}"/>'
            f'<parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>{more}</joint>')


def urdf(parts: Iterable[str]) -> str:
    """Return a URDF of links and joints."""
    return f'<?xml version="1.0" encoding="utf-8"?><robot name="r">{"".join(parts)}</robot>'


#: Limits of the first joint of `two_links`, which hangs at 0.
FIRST_LIMITS = 'lower="-2" upper="3" effort="40" velocity="0"'
#: Lengths [m], masses [kg], centres of mass [m] and inertias [kg·m²] of `two_links`.
L1 = 0.7
M1 = 3.0
R1 = 0.3
I1 = 0.2
M2 = 1.5
R2 = 0.25
I2 = 0.05


def two_links(kind: str = 'revolute') -> str:
    """Return an arm in the x-z plane that hangs straight down at 0 and turns about -y."""
    return urdf([
        link('base', 5.0, inertia=(1.0, 1.0, 1.0)), link('upper', M1, (0, 0, -R1), (I1, I1, 0.1)),
        link('lower', M2, (0, 0, -R2), (I2, I2, 0.01)), link('tool'),
        joint('a', kind, 'base', 'upper', '0 -1 0',
              more=f'<limit {FIRST_LIMITS}/>'),
        joint('b', kind, 'upper', 'lower', '0 -1 0', f'0 0 {-L1}',
              more='<limit effort="0" velocity="1.5"/>'),
        joint('c', 'fixed', 'lower', 'tool', more='')])


def grip(kind: str = 'prismatic', mimic: str = '<mimic joint="f1" multiplier="-2" offset="0.01"/>'
         ) -> str:
    """Return an arm of one joint with two fingers, of which the second mimics the first."""
    return urdf([
        link('base'), link('arm', 2.0, (0.2, 0, 0), (0.1, 0.1, 0.1)),
        link('left', 0.3, (0.1, 0, 0), (0.01, 0.01, 0.01)),
        link('right', 0.4, (0.1, 0, 0), (0.01, 0.01, 0.01)),
        joint('turn', 'revolute', 'base', 'arm', '0 1 0'),
        joint('f1', kind, 'arm', 'left', '0 0 1', '0.5 0 0'),
        joint('f2', kind, 'arm', 'right', '0 0 1', '0.5 0 0',
              more=f'<limit effort="0" velocity="0"/>{mimic}')])


def mobile_manipulator() -> str:
    """Return wheels, a lift with a head and an arm of three joints, and a gripper, z upwards."""
    def body(name: str, mass: float, x: float = 0.0) -> str:
        return link(name, mass, (x, 0.0, 0.0), (0.01 * mass, 0.02 * mass, 0.02 * mass))
    strong, weak = (f'<limit lower="-1.5" upper="2" effort="{effort}" velocity="2"/>'
                    for effort in (300, 60))
    return urdf([
        body('base', 20.0), body('wheel_1', 1.0), body('wheel_2', 1.0),
        joint('drive_1', 'continuous', 'base', 'wheel_1', '0 1 0'),
        joint('drive_2', 'continuous', 'base', 'wheel_2', '0 1 0'),
        body('column', 5.0), joint('lift', 'prismatic', 'base', 'column', more=(
            '<limit lower="0" upper="0.4" effort="900" velocity="0.2"/>')),
        body('neck', 0.5), body('head', 1.0, 0.1),
        joint('pan', 'revolute', 'column', 'neck', more=weak),
        joint('tilt', 'revolute', 'neck', 'head', '0 1 0', more=weak),
        body('upper', 3.0, 0.2), body('lower', 2.0, 0.2), body('hand', 0.25, 0.05),
        joint('shoulder', 'revolute', 'column', 'upper', '0 1 0', '0.1 0 0.5', strong),
        joint('elbow', 'revolute', 'upper', 'lower', '0 1 0', '0.4 0 0', weak),
        joint('wrist', 'revolute', 'lower', 'hand', '1 0 0', '0.4 0 0', weak),
        *(body(f'finger_{i}', 0.05, 0.02) for i in (1, 2)),
        *(joint(f'open_{i}', 'prismatic', 'hand', f'finger_{i}', '0 1 0', '0.1 0 0', weak)
          for i in (1, 2))])


def branching_arm() -> str:
    """Return a robot with two arms, a slide, skew axes, a fixed joint and one to be locked."""
    skew = '0.6 0 0.8'
    return urdf([
        link('base', 9.0, inertia=(1.0, 1.0, 1.0)),
        link('trunk', 4.0, (0.1, 0.2, 0.3), (0.3, 0.2, 0.4)),
        link('left', 2.0, (0.0, 0.1, 0.2), (0.05, 0.04, 0.03)),
        link('slide', 1.0, (0.1, 0.0, 0.3), (0.01, 0.02, 0.03)),
        link('right', 1.5, (0.2, -0.1, 0.1), (0.02, 0.03, 0.04)),
        link('tool', 0.7, (0.0, 0.0, 0.2), (0.01, 0.01, 0.02)),
        link('wrist', 0.5, (0.0, 0.05, 0.1), (0.004, 0.005, 0.006)),
        joint('turn', 'continuous', 'base', 'trunk', skew, '0.1 0 0.5', rpy='0.3 0.2 -0.4'),
        joint('shoulder', 'revolute', 'trunk', 'left', '0 1 0', '0 0.2 0.4', rpy='1 0 0.5'),
        joint('lift', 'prismatic', 'left', 'slide', '-0.6 0.8 0', '0 0 0.3', rpy='0 0.7 0',
              more='<dynamics damping="0" rotor_inertia="0.4"/>'),
        joint('other', 'revolute', 'trunk', 'right', '1 0 0', '0 -0.2 0.4', rpy='0.2 0.1 0',
              more='<dynamics damping="0" rotor_inertia="0.2"/>'),
        joint('bent', 'revolute', 'right', 'wrist', '0 0 1', '0 0 0.2', rpy='0.4 0 0'),
        joint('held', 'fixed', 'wrist', 'tool', xyz='0 0 0.1', more='', rpy='0 0.3 0')])


def heavier_links(description: str, joints: Sequence[str], factor: float = 2.0
                  ) -> list[tuple[str, str]]:
    """
    Return name and URDF with `factor` times the mass, for the body that each joint moves.

    Links that are fixed to each other are one body, named after its heaviest link.
    """
    found = []
    for joint in joints:
        root = ElementTree.fromstring(description.encode())
        ends = {x.get('name'): (_end(x, 'parent'), _end(x, 'child')) for x in root.iter('joint')}
        body = [ends[joint][1]]
        while more := [child for name, (parent, child) in ends.items()
                       if parent in body and child not in body and name not in joints]:
            body += more
        masses = {}
        for one in root.iter('link'):
            mass, inertia = one.find('inertial/mass'), one.find('inertial/inertia')
            if one.get('name') in body and mass is not None and inertia is not None:
                masses[one.get('name', '')] = float(mass.get('value', '0'))
                for element in (mass, inertia):
                    for key, value in element.items():
                        element.set(key, repr(factor * float(value)))
        if sum(masses.values()) > 0.0:
            found.append((max(masses, key=lambda name: masses[name]),
                          ElementTree.tostring(root, encoding='unicode')))
    return found


def _end(joint: ElementTree.Element, tag: str) -> str:
    end = joint.find(tag)
    return '' if end is None else end.get('link', '')

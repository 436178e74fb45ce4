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
A URDF with other inertial parameters, rotor inertias and direction of gravity.

The text stays as it is but for these. Links that are fixed to each other are one body: the
heaviest takes the difference. Where no link can have what is left for it, each takes the part of
the whole body that it has of the mass. A tilt is in a fixed joint between a new root `world`,
which is level, and the old one, or in the joints of a root of that name. A rotor inertia,
reflected to the joint, is `rotor_inertia` in <dynamics>: RaiSim and `urdf_model` read it, others
pass over it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import atan2, degrees, hypot
import re
import xml.etree.ElementTree as ET
from xml.sax.saxutils import quoteattr

from ctc_chattering.dynamics.pseudo_inertia import parameters_of, pseudo_inertia
from ctc_chattering.dynamics.urdf_elements import Origin, origin
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.dynamics.urdf_text import ElementPlace, places
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Name of the link that is level.
_LEVEL = 'world'
#: Relative change that is none.
_SAME = 1e-12
#: Error of the text, relative to a body.
_EXACT = 1e-9
_INERTIA = ('ixx', 'ixy', 'iyy', 'ixz', 'iyz', 'izz')


def corrected_urdf(description: str, joints: Sequence[str], parameters: Array,
                   rotor: Sequence[float] = (), gravity: Sequence[float] | None = None,
                   locked: Mapping[str, float] | None = None) -> str:
    """
    Return a URDF with given parameters of its moved bodies.

    Parameters
    ----------
    description : str
        The URDF.
    joints : sequence of str, length n
        Joints of the model.
    parameters : ndarray, shape (n, 10)
        Mass [kg], first moments [kg·m] and inertia [kg·m²] of the body that each joint moves,
        about the joint's frame, in Pinocchio's order; every one must be that of a body.
    rotor : sequence of float, length n
        Rotor inertias, reflected to the joints [kg·m²]; empty for those of the URDF.
    gravity : sequence of float, length 3, optional
        In the frame of the root; its direction counts. By default along -z.
    locked : mapping of str to float, optional
        As the model has it.

    Raises
    ------
    CtcError
        If no body has such parameters, or the URDF is not that of a model.

    """
    _check(joints, parameters, rotor, gravity)
    model, tree = UrdfModel(description, joints, locked=locked), Tree(description)
    data = description.encode()
    robot, named = places(data)
    edits: list[tuple[int, int, str]] = []
    for i in range(model.n):
        for name, inertia in _changed(model, tree, i, pseudo_inertia(parameters[i])).items():
            edits.append(_inertial(data, named['link', name], inertia))
    for name, value in zip(joints, rotor):
        if abs(value - tree.joints[name].rotor_inertia) > _SAME:
            edits.append(_rotor(data, named['joint', name], value))
    edits += _tilted(data, robot, named, tree, gravity)
    for start, end, text in sorted(edits, reverse=True):
        data = data[:start] + text.encode() + data[end:]
    result = data.decode()
    _verify(UrdfModel(result, joints, locked=locked), parameters, rotor)
    return result


def _check(joints: Sequence[str], parameters: Array, rotor: Sequence[float],
           gravity: Sequence[float] | None) -> None:
    """Raise `CtcError` unless the shapes are right and bodies can have the parameters."""
    if np.shape(parameters) != (len(joints), 10) or len(rotor) not in (0, len(joints)):
        raise CtcError(f'parameters of shape {np.shape(parameters)} and {len(rotor)} rotors for '
                       f'{len(joints)} joints; 10 for each are needed')
    if not np.isfinite([*np.ravel(parameters), *rotor, *(gravity or ())]).all():
        raise CtcError('parameters of bodies, rotors and gravity must be finite')
    for name, row in zip(joints, parameters):
        if not _possible(pseudo_inertia(row)):
            raise CtcError(f'no body can have the inertial parameters {row.tolist()} of the body '
                           f'that {name} moves')
    if min(rotor, default=0.0) < 0.0:
        raise CtcError(f'rotor inertias must not be negative: {list(rotor)}')
    if gravity is not None and (len(gravity) != 3 or not gravity[2] < 0.0):
        raise CtcError(f'gravity must point down, with three numbers: {list(gravity)}')


def _possible(matrix: Array) -> bool:
    """Return whether a body can have a pseudo-inertia; it needs a mass."""
    mass = matrix[3, 3]
    if not mass > 0.0:
        return False
    length = np.sqrt(max(np.trace(matrix[:3, :3]) / mass, 1e-12))
    scale = np.array([length] * 3 + [1.0]) * np.sqrt(mass)
    return bool(np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0] > -_SAME)


def _changed(model: UrdfModel, tree: Tree, i: int, body: Array) -> dict[str, Array]:
    """Return the pseudo-inertias, in their own frames, of links whose body is to have another."""
    at = {name: place for name, (joint, place) in model.places().items() if joint == i}
    links = {name: place @ _link_inertia(tree.links[name]) @ place.T
             for name, place in at.items()}
    before = sum(links.values())
    if np.abs(body - before).max() <= _SAME * np.abs(body).max():
        return {}
    heaviest = max(links, key=lambda name: float(links[name][3, 3]))
    left = body - (before - links[heaviest])
    if _possible(left):
        changed = {heaviest: left}
    else:
        mass = before[3, 3]
        changed = {name: x[3, 3] / mass * body for name, x in links.items() if x[3, 3] > 0.0}
    back = {name: np.linalg.inv(at[name]) for name in changed}
    return {name: back[name] @ x @ back[name].T for name, x in changed.items()}


def _link_inertia(link: ET.Element) -> Array:
    """Return the pseudo-inertia of a link in its frame."""
    inertial = link.find('inertial')
    if inertial is None:
        return np.zeros((4, 4))
    mass, inertia = inertial.find('mass'), inertial.find('inertia')
    assert mass is not None and inertia is not None  # Tree has checked them.
    m = float(mass.get('value', '0'))
    about = [float(inertia.get(key, '0')) for key in _INERTIA]
    place = origin('', inertial)
    turn = np.eye(4)
    turn[:3, :3], turn[:3, 3] = _rotation(*place.rpy), place.xyz
    found: Array = turn @ pseudo_inertia(np.array([m, 0.0, 0.0, 0.0, *about])) @ turn.T
    return found


def _rotation(roll: float, pitch: float, yaw: float) -> Array:
    """Return the rotation of roll, pitch and yaw."""
    (a, b, c), (d, e, f) = np.sin((roll, pitch, yaw)), np.cos((roll, pitch, yaw))
    return np.array([[f * e, f * b * a - c * d, f * b * d + c * a],
                     [c * e, c * b * a + f * d, c * b * d - f * a], [-b, e * a, e * d]])


def _inertial(data: bytes, link: ElementPlace, matrix: Array) -> tuple[int, int, str]:
    """Return the change that gives a link its inertia."""
    mass, *moments = parameters_of(matrix)[:4].tolist()
    center = np.array(moments) / mass
    about = parameters_of(matrix - mass * np.outer([*center, 1.0], [*center, 1.0]))[4:].tolist()
    numbers = ' '.join(f'{key}="{x!r}"' for key, x in zip(_INERTIA, about))
    text = (f'<inertial><!-- identified --><origin xyz="{" ".join(map(repr, center.tolist()))}" '
            f'rpy="0 0 0"/><mass value="{mass!r}"/><inertia {numbers}/></inertial>')
    old = link.children.get('inertial')
    return (old.start, old.end, text) if old else _inserted(data, link, text)


def _rotor(data: bytes, joint: ElementPlace, value: float) -> tuple[int, int, str]:
    """Return the change that gives a joint the inertia of its rotor."""
    old = joint.children.get('dynamics')
    attribute = f'rotor_inertia="{float(value)!r}"'
    if old is None:
        # Without damping or friction, urdfdom refuses the element.
        return _inserted(data, joint, f'<dynamics damping="0" {attribute}/>')
    tag = re.sub(r'\s+rotor_inertia\s*=\s*("[^"]*"|\'[^\']*\')', '',
                 data[old.start:old.inside].decode())
    return old.start, old.inside, tag.replace('<dynamics', f'<dynamics {attribute}', 1)


def _inserted(data: bytes, parent: ElementPlace, text: str) -> tuple[int, int, str]:
    """Return the change that puts an element into another one."""
    if not parent.empty:
        return parent.inside, parent.inside, text
    tag = data[parent.start:parent.inside].decode()
    name = re.match(r'<([^\s/>]+)', tag)
    assert name is not None
    return parent.start, parent.inside, f'{tag[:-2].rstrip()}>{text}</{name[1]}>'


def _tilted(data: bytes, robot: ElementPlace, named: Mapping[tuple[str, str], ElementPlace],
            tree: Tree, gravity: Sequence[float] | None) -> list[tuple[int, int, str]]:
    """Return the changes after which gravity is along -z of the root."""
    x, y, z = (0.0, 0.0, -1.0) if gravity is None else gravity
    if hypot(x, y) <= _SAME * abs(z):
        return []
    # Ry(pitch) Rx(roll) brings gravity in the root's frame to -z.
    roll, pitch = atan2(-y, -z), atan2(x, hypot(y, z))
    note = f'identified: tilted by {degrees(atan2(hypot(x, y), -z)):.3g} degrees'
    children = {child for _, child in tree.ends.values()}
    (root,) = (name for name in tree.links if name not in children)
    if root == _LEVEL:
        return [_turned(data, named['joint', name], _rotation(roll, pitch, 0.0), note,
                        tree.origins[name]) for name, (parent, _) in tree.ends.items()
                if parent == root]
    end, name = data.rindex(b'</', 0, robot.end), _LEVEL
    while name in tree.links or name in tree.ends:
        name += '_'
    return [(end, end, f"""  <!-- {note} -->
  <link name="{name}"/>
  <joint name="{name}" type="fixed">
    <origin xyz="0 0 0" rpy="{roll!r} {pitch!r} 0.0"/>
    <parent link="{name}"/>
    <child link={quoteattr(root)}/>
  </joint>
""")]


def _turned(data: bytes, joint: ElementPlace, turn: Array, note: str, old: Origin
            ) -> tuple[int, int, str]:
    """Return the change that turns the place of a joint."""
    R, xyz = turn @ _rotation(*old.rpy), (turn @ old.xyz).tolist()
    level = hypot(R[2, 1], R[2, 2])
    rpy = (atan2(R[2, 1], R[2, 2]), atan2(-R[2, 0], level), atan2(R[1, 0], R[0, 0]))
    if level < _SAME:  # Pitch is a right angle: roll and yaw are one.
        rpy = (0.0, rpy[1], atan2(-R[0, 1], R[1, 1]))
    text = (f'<!-- {note} --><origin xyz="{" ".join(map(repr, xyz))}" '
            f'rpy="{" ".join(map(repr, rpy))}"/>')
    place = joint.children.get('origin')
    return (place.start, place.end, text) if place else _inserted(data, joint, text)


def _verify(model: UrdfModel, parameters: Array, rotor: Sequence[float]) -> None:
    """Raise `CtcError` unless the new text is read as it should be."""
    size = np.abs(parameters).max(axis=1, keepdims=True)
    made = model.inertial_parameters().reshape(-1, 10)
    error = float((np.abs(made - parameters) / size).max())
    if error > _EXACT or (len(rotor) and list(rotor) != list(model.rotor_inertias)):
        raise CtcError('the URDF cannot be corrected: with the parameters written into it, it is '
                       f'read with an error of {error:.2g}')

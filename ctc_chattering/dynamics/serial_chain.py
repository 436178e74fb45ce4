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
The arm in the description of a whole robot: a serial chain of joints that a model can have.

A description also has wheels, a head, a second arm, and a gripper or a hand at the end of the arm.
Joints that move no mass are left out: no model has them.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import NamedTuple
import xml.etree.ElementTree as ET

from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import ParameterError, shorten, suggest


class Branch(NamedTuple):
    """A joint that leads away from a link, and what is on the way outwards."""

    joint: str
    #: The most joints that a model can have.
    length: int
    #: The most joints; those that mimic, and their leaders, count as well.
    every: int


def chain_to(tree: Tree, tip: str) -> tuple[str, ...]:
    """
    Return the joints of a model between the root and a link, from the root outwards.

    Raises
    ------
    ParameterError
        If there is no such link, or no joint that moves it.

    """
    if tip not in tree.links:
        raise ParameterError(
            'tip', tip,
            f'links of the URDF: {shorten(list(tree.links))}{suggest(tip, tree.links)}')
    carrier = {child: name for name, (_, child) in tree.ends.items()}
    chain = []
    link = tip
    while link in carrier:
        chain.append(carrier[link])
        link = tree.ends[carrier[link]][0]
    movers = _movers(tree)
    joints = tuple(name for name in reversed(chain) if name in movers)
    if not joints:
        raise ParameterError('tip', tip, 'links that a joint of a model moves')
    return joints


def longest_chain(tree: Tree) -> tuple[str, ...]:
    """
    Return the joints of the longest chain from the root on, without its end effector.

    Of chains that are equally long it is the first in the text. Empty where nothing moves.
    """
    movers = _movers(tree)
    branches = _branches(tree, movers)
    children = {child for _, child in tree.ends.values()}
    link = next(name for name in tree.links if name not in children)
    chain: list[str] = []
    while branches[link] and not _is_end_effector(branches[link], len(chain)):
        branch = max(branches[link], key=lambda branch: branch.length)
        if not branch.length:
            break
        if branch.joint in movers:
            chain.append(branch.joint)
        link = tree.ends[branch.joint][1]
    return tuple(chain)


def _movers(tree: Tree) -> set[str]:
    """Return the joints that a model can have."""
    carried = {name: _mass(link) for name, link in tree.links.items()}
    for parent, child in reversed(tree.ends.values()):
        carried[parent] += carried[child]
    return {name for name in tree.movable if carried[tree.ends[name][1]] > 0.0}


def _mass(link: ET.Element) -> float:
    mass = link.find('inertial/mass')
    return 0.0 if mass is None else float(mass.get('value', ''))


def _branches(tree: Tree, movers: Container[str]) -> Mapping[str, list[Branch]]:
    """Return the branches at every link that move."""
    branches: dict[str, list[Branch]] = {link: [] for link in tree.links}
    for name, (parent, child) in reversed(tree.ends.items()):
        length = max((branch.length for branch in branches[child]), default=0) + (name in movers)
        every = max((branch.every for branch in branches[child]), default=0) + (
            name in tree.joints)
        if every:
            branches[parent].insert(0, Branch(name, length, every))
    return branches


def _is_end_effector(branches: list[Branch], before: int) -> bool:
    """Tell fingers from arms: they are several, alike or few, after the many joints of an arm."""
    if len(branches) < 2:
        return False
    lengths = sorted((branch.every for branch in branches), reverse=True)
    return 2 * lengths[0] < before or lengths[0] == lengths[1] <= before

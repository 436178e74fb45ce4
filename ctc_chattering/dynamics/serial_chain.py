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
The arm in the description of a whole robot.

`ctc new-robot` takes a serial chain of joints that a model can have. A description also has
wheels, a head, a second arm, and a gripper or a hand at the end of the arm. Joints that move no
mass are omitted, as no model has them.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import NamedTuple

from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import near, ParameterError, shortened


class Branch(NamedTuple):
    """A joint that leads away from a link, with the lengths of the longest ways outwards."""

    joint: str
    #: Number of joints that a model can have.
    model_joints: int
    #: Number of all joints, including those that mimic and their leaders.
    all_joints: int


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
            'tip', tip, f'links of the URDF: {shortened(list(tree.links))}{near(tip, tree.links)}')
    chain = []
    link = tip
    while link in tree.carriers:
        joint = tree.carriers[link]
        chain.append(joint)
        link = tree.ends[joint][0]
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
    link = tree.root
    chain: list[str] = []
    while branches[link] and not _is_end_effector(branches[link], len(chain)):
        longest = max(branches[link], key=lambda branch: branch.model_joints)
        if not longest.model_joints:
            break
        if longest.joint in movers:
            chain.append(longest.joint)
        link = tree.ends[longest.joint][1]
    return tuple(chain)


def _movers(tree: Tree) -> set[str]:
    """Return the joints that a model can have: they move a mass."""
    carried = {name: 0.0 if inertial is None else inertial.mass
               for name, inertial in tree.inertials.items()}
    for parent, child in reversed(tree.ends.values()):
        carried[parent] += carried[child]
    return {name for name in tree.movable if carried[tree.ends[name][1]] > 0.0}


def _branches(tree: Tree, movers: Container[str]) -> Mapping[str, list[Branch]]:
    """Return the branches with joints at every link, in the order of the text."""
    branches: dict[str, list[Branch]] = {link: [] for link in tree.links}
    for name, (parent, child) in reversed(tree.ends.items()):
        outwards = branches[child]
        model_joints = max((x.model_joints for x in outwards), default=0) + (name in movers)
        all_joints = max((x.all_joints for x in outwards), default=0) + (name in tree.joints)
        if all_joints:
            branches[parent].insert(0, Branch(name, model_joints, all_joints))
    return branches


def _is_end_effector(branches: list[Branch], arm_joints: int) -> bool:
    """
    Tell fingers from arms.

    Fingers are several branches after the many joints of an arm. The longest two are equally
    long, or all are shorter than half of the arm.
    """
    if len(branches) < 2:
        return False
    longest, second, *_ = sorted((branch.all_joints for branch in branches), reverse=True)
    return 2 * longest < arm_joints or longest == second <= arm_joints

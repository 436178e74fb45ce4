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
Find the joints of the arm in the URDF of a whole robot.

`ctc new-robot` models one serial chain of movable joints. A URDF may also contain wheels, a head,
a second arm, and a gripper or a hand at the end of the arm. Joints that carry no mass are left
out, since the mass matrix would be singular, and so are joints that mimic or lead another.
"""

from __future__ import annotations

from collections.abc import Container

from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import ParameterError, shorten, suggest


def chain_to(tree: Tree, tip: str) -> tuple[str, ...]:
    """
    Return the movable joints from the root to the link `tip`.

    Raises
    ------
    ParameterError
        If the link does not exist, or none of these joints carries a mass.

    """
    if tip not in tree.links:
        raise ParameterError(
            'tip',
            tip,
            f'links of the URDF: {shorten(list(tree.links))}{suggest(tip, tree.links)}',
        )
    chain = []
    link = tip
    while link in tree.carriers:
        joint = tree.carriers[link]
        chain.append(joint)
        link = tree.ends[joint][0]
    movers = _movable_joints_with_mass(tree)
    joints = tuple(name for name in reversed(chain) if name in movers)
    if not joints:
        raise ParameterError('tip', tip, 'links that a joint of a model moves')
    return joints


def longest_chain(tree: Tree) -> tuple[str, ...]:
    """
    Return the joints of the longest chain without fingers.

    Of equally long chains it is the first in the URDF. A gripper with a single branch is part of
    the chain. It is empty if no movable joint carries a mass.
    """
    movers = _movable_joints_with_mass(tree)
    movable_lengths = _chain_lengths(tree, movers)
    lengths = _chain_lengths(tree, tree.joints)
    link = tree.root
    chain: list[str] = []
    while True:
        branches = [name for name in tree.joints_on(link) if lengths[name]]
        branch = max(branches, key=lambda name: movable_lengths[name], default='')
        if not movable_lengths.get(branch) or _is_end_effector(
            [lengths[name] for name in branches], len(chain)
        ):
            return tuple(chain)
        if branch in movers:
            chain.append(branch)
        link = tree.ends[branch][1]


def _movable_joints_with_mass(tree: Tree) -> set[str]:
    """Return the movable joints that carry a mass."""
    carried = {
        name: 0.0 if inertial is None else inertial.mass
        for name, inertial in tree.inertials.items()
    }
    for parent, child in reversed(tree.ends.values()):  # From the leaves inwards.
        carried[parent] += carried[child]
    return {name for name in tree.movable if carried[tree.ends[name][1]] > 0.0}


def _chain_lengths(tree: Tree, counted: Container[str]) -> dict[str, int]:
    """
    Return the length of the longest chain from each joint outwards.

    Its length is the number of `counted` joints, the first joint included.
    """
    lengths: dict[str, int] = {}
    for name, (_, child) in reversed(tree.ends.items()):
        branches = [lengths[joint] for joint in tree.joints_on(child)]
        outwards = max(branches, default=0)
        lengths[name] = outwards + (name in counted)
    return lengths


def _is_end_effector(branch_lengths: list[int], arm_joints: int) -> bool:
    """
    Tell fingers from arms by the lengths of the branches at a link.

    Fingers are two or more branches. The longest two are equally long and no longer than the
    arm, or all are shorter than half of the arm.
    """
    if len(branch_lengths) < 2:
        return False
    longest, second, *_ = sorted(branch_lengths, reverse=True)
    return 2 * longest < arm_joints or longest == second <= arm_joints

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

from collections.abc import Container

from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import ParameterError, shorten, suggest


def chain_to(tree: Tree, tip: str) -> tuple[str, ...]:
    """
    Return a model's joints from the root to a link.

    Raises
    ------
    ParameterError
        If there is no such link, or no joint that moves it.

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
    movers = _movers(tree)
    joints = tuple(name for name in reversed(chain) if name in movers)
    if not joints:
        raise ParameterError('tip', tip, 'links that a joint of a model moves')
    return joints


def longest_chain(tree: Tree) -> tuple[str, ...]:
    """
    Return the joints of the longest chain without end effector.

    Of chains that are equally long it is the first in the text. Empty where nothing moves.
    """
    movers = _movers(tree)
    model_joints = _longest_ways(tree, movers)
    all_joints = _longest_ways(tree, tree.joints)
    link = tree.root
    chain: list[str] = []
    while True:
        branches = [name for name in tree.joints_on(link) if all_joints[name]]
        longest = max(branches, key=lambda name: model_joints[name], default='')
        if not model_joints.get(longest) or _is_end_effector(
            [all_joints[name] for name in branches], len(chain)
        ):
            return tuple(chain)
        if longest in movers:
            chain.append(longest)
        link = tree.ends[longest][1]


def _movers(tree: Tree) -> set[str]:
    """Return the joints of a model that move a mass."""
    carried = {
        name: 0.0 if inertial is None else inertial.mass
        for name, inertial in tree.inertials.items()
    }
    for parent, child in reversed(tree.ends.values()):
        carried[parent] += carried[child]
    return {name for name in tree.movable if carried[tree.ends[name][1]] > 0.0}


def _longest_ways(tree: Tree, counted: Container[str]) -> dict[str, int]:
    """Return the most counted joints outwards, joint by joint."""
    ways: dict[str, int] = {}
    for name, (_, child) in reversed(tree.ends.items()):
        branches = [ways[joint] for joint in tree.joints_on(child)]
        outwards = max(branches, default=0)
        ways[name] = outwards + (name in counted)
    return ways


def _is_end_effector(branches: list[int], arm_joints: int) -> bool:
    """
    Tell fingers from arms by the joints of branches.

    Fingers are several branches after the many joints of an arm. The longest two are equally
    long, or all are shorter than half of the arm.
    """
    if len(branches) < 2:
        return False
    longest, second, *_ = sorted(branches, reverse=True)
    return 2 * longest < arm_joints or longest == second <= arm_joints

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
Forward kinematics of a URDF: poses of its links.

`ctc live` draws arms with it, `ctc excite` places collision shapes by it, and corrected
descriptions bring inertias into the frames of joints. Origins and axes come from
`urdf_parser.Tree`.

A pose is a homogeneous matrix of shape (4, 4). With the origin A of a joint on its parent link,
and the motion B(q) along or about its axis, the pose of its child link in the root's frame is

    T_child = T_parent A B(q)                                                          (FK1)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ctc_chattering.dynamics.urdf_parser import Joint, Origin, Tree
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


class LinkFrame(NamedTuple):
    """The frame of a link, and its joint."""

    link: str
    #: Index of the parent's frame. The root has -1.
    parent: int
    #: A of (FK1), shape (4, 4). A locked joint's motion is included.
    origin: Array
    #: None for a fixed or locked joint.
    joint: Joint | None
    #: Index of the joint among those that move. Without a joint, it is -1.
    joint_index: int


class ForwardKinematics:
    """
    Frames of a URDF with some joints moving, others locked.

    Parameters
    ----------
    tree : Tree
        The URDF.
    joint_names : sequence of str, length n
        Joints that move.
    locked : mapping of str to float, optional
        Positions of other joints [rad or m]. The default is 0.

    Attributes
    ----------
    frames : tuple of LinkFrame
        Frames of all links, parents before children.
    n : int
        Number of joints that move.

    Raises
    ------
    CtcError
        If a joint name is wrong.

    """

    def __init__(
        self,
        tree: Tree,
        joint_names: Sequence[str],
        locked: Mapping[str, float] | None = None,
    ) -> None:
        positions = tree.locked(joint_names, locked or {})
        links = [tree.root, *(child for _, child in tree.ends.values())]
        frames = [LinkFrame(tree.root, -1, np.eye(4), None, -1)]
        for name, (parent, child) in tree.ends.items():
            origin = origin_pose(tree.origins[name])
            joint = tree.joints.get(name)
            if joint and name in positions:
                origin = origin @ joint_motion(joint, positions[name])
                joint = None
            joint_index = joint_names.index(name) if joint else -1
            frames.append(
                LinkFrame(child, links.index(parent), origin, joint, joint_index)
            )
        self.frames = tuple(frames)
        self.n = len(joint_names)

    def poses(self, q: Sequence[float] | Array) -> Array:
        """
        Return the poses of all links by (FK1).

        Parameters
        ----------
        q : sequence of float, or ndarray of shape (n,) or (N, n)
            Joint positions [rad or m].

        Returns
        -------
        ndarray, shape (links, 4, 4) or (N, links, 4, 4)

        """
        q = np.asarray(q, float)
        poses = np.empty((*q.shape[:-1], len(self.frames), 4, 4))
        for i, frame in enumerate(self.frames):
            pose = frame.origin
            if frame.joint:
                position = q[..., frame.joint_index]
                pose = pose @ joint_motion(frame.joint, position)
            if frame.parent >= 0:
                pose = poses[..., frame.parent, :, :] @ pose
            poses[..., i, :, :] = pose
        return poses

    def rigid_bodies(self) -> list[dict[str, Array]]:
        """Return, for each joint, links and poses on its body."""
        bodies: list[dict[str, Array]] = [{} for _ in range(self.n)]
        for frame in self.frames[1:]:
            if frame.joint:
                bodies[frame.joint_index][frame.link] = np.eye(4)
                continue
            parent = self.frames[frame.parent].link
            for body in bodies:
                if parent in body:
                    body[frame.link] = body[parent] @ frame.origin
        return bodies


def origin_pose(origin: Origin) -> Array:
    """Return the pose of an origin, shape (4, 4)."""
    from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]  # Takes time.
    pose = np.eye(4)
    rotation = Rotation.from_euler('xyz', origin.rpy)
    pose[:3, :3] = rotation.as_matrix()
    pose[:3, 3] = origin.xyz
    return pose


def joint_motion(joint: Joint, q: float | Array) -> Array:
    """
    Return the motion B of (FK1).

    Parameters
    ----------
    joint : Joint
        Its axis and type count.
    q : float or ndarray, shape (N,)
        Joint positions [rad or m].

    Returns
    -------
    ndarray, shape (4, 4) or (N, 4, 4)

    """
    displacement = np.multiply.outer(q, joint.axis)
    motion = np.tile(np.eye(4), (*displacement.shape[:-1], 1, 1))
    if joint.prismatic:
        motion[..., :3, 3] = displacement
    else:
        from scipy.spatial.transform import Rotation
        rotation = Rotation.from_rotvec(displacement)
        motion[..., :3, :3] = rotation.as_matrix()
    return motion

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
Dynamics of a URDF, computed by Pinocchio.

Control, simulation and identification take it for `model: urdf`. Its Coriolis matrix is that of
Christoffel's symbols: ½ dM/dt - C is skew-symmetric, and C(q, x) y = C(q, y) x. Only inertias and
joints are read. Meshes are not looked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import copy
from functools import cached_property
import importlib
from typing import Any

from ctc_chattering.dynamics.kinematics import ForwardKinematics
from ctc_chattering.dynamics.model import DynamicsTerms, LinearModel, Model, PointMass
from ctc_chattering.dynamics.payload import tip_of
from ctc_chattering.dynamics.tree import Arm
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import as_ctc_error, CtcError
from ctc_chattering.numerics.linear_algebra import Array, Rows, Vector
from ctc_chattering.parameters import check_joint_names
import numpy as np

#: Eigenvalues of M, scaled to a diagonal of ones, are rounding up to this.
_SINGULAR = 1e-10
#: Elements of M's diagonal below this, relative to the largest, are rounding.
_NO_INERTIA = 1e-14
#: Shares in a singular motion above this, relative to the largest, are named.
_NAMED_SHARE = 0.1
#: Random positions at which M is checked, besides 0.
_CHECKED_POSITIONS = 4
#: Least mass in `parameter_sizes`, relative to the arm.
_LEAST_MASS_RATIO = 0.05
#: Least length in `parameter_sizes` [m].
_LEAST_REACH_M = 0.05


class UrdfModel(Model, LinearModel):
    """
    Moving joints of a URDF with all others locked.

    Every position is one number, [rad] or [m], of a continuous joint as well. The model is for
    one thread at a time.

    Parameters
    ----------
    urdf : str
        Text of the URDF.
    joint_names : sequence of str
        Joints of the model, in the order of its vectors.
    gravity : float
        Acceleration of gravity, along -z of the root link [m/s²].
    locked : mapping of str to float, optional
        Positions of other joints [rad or m]. The default is 0. A joint that mimics one of
        these goes with it.
    rotors : sequence of float
        Inertias of the rotors at the joints [kg·m²], 0 for those of the URDF. Empty for all of
        the URDF.

    Attributes
    ----------
    joint_names : tuple of str
        As given.
    position_limits : tuple of (float, float), length n
        Least and greatest position, ∓inf where the URDF has none.
    velocity_limits, effort_limits : tuple of float, length n
        inf where the URDF has none, or 0.
    continuous : tuple of bool, length n
        True for a joint of this type.
    rotor_inertias : tuple of float, length n
        Inertia of each joint's rotor, reflected to the joint, on the diagonal of M: as given, or
        `rotor_inertia` in <dynamics>.

    Raises
    ------
    CtcError
        If Pinocchio is missing, the URDF is no tree of joints with one degree of freedom, or M is
        singular. The message names the joints concerned.

    """

    def __init__(
        self,
        urdf: str,
        joint_names: Sequence[str],
        gravity: float = 9.81,
        locked: Mapping[str, float] | None = None,
        rotors: Sequence[float] = (),
    ) -> None:
        self._pin = pinocchio()
        self.joint_names = tuple(joint_names)
        check_joint_names(self.joint_names)
        tree = Tree(urdf)
        locked_positions = tree.locked(self.joint_names, locked or {})
        tree.check_limits(self.joint_names)
        joints = [tree.joints[name] for name in self.joint_names]
        self.position_limits = tuple(joint.position for joint in joints)
        self.velocity_limits = tuple(joint.velocity for joint in joints)
        self.effort_limits = tuple(joint.effort for joint in joints)
        self.continuous = tuple(joint.continuous for joint in joints)
        self.rotor_inertias = tuple(
            rotor or joint.rotor_inertia
            for joint, rotor in zip(joints, rotors or (0.0,) * len(joints))
        )
        self.n = len(joints)
        self.gravity = gravity
        self._tree = tree
        self._locked = dict(locked or {})
        self._model = _reduced_model(self._pin, tree, locked_positions)
        self._data = self._model.createData()
        #: Indices that bring a vector of Pinocchio into our order.
        self._back: Any = np.array(
            [
                self._model.joints[self._model.getJointId(name)].idx_v
                for name in self.joint_names
            ]
        )
        #: Indices that bring our vectors into Pinocchio's order.
        self._order: Any = np.argsort(self._back)
        #: The same as `_back`, of a matrix.
        self._square: Any = np.ix_(self._back, self._back)
        #: Rows of joints and columns of bodies, of a regressor.
        self._regressor: Any = np.ix_(
            self._back, (10 * self._back[:, np.newaxis] + np.arange(10)).ravel()
        )
        self._model.armature = np.array(self.rotor_inertias)[self._order]
        self._model.gravity.linear = np.array([0.0, 0.0, -gravity])
        self._check_inertia()

    @cached_property
    def bodies(self) -> Arm:
        """
        Bodies for compiled code, without fixed and locked joints.

        Pinocchio's frames are turned so that each joint's axis is along z.
        """
        model = self._model
        placements = model.jointPlacements.tolist()[1:]
        inertias = model.inertias.tolist()[1:]
        parents = (np.array(model.parents.tolist()[1:]) - 1) % (self.n + 1)
        # S of each joint, linear part first.
        motions = [
            np.array(joint.createData().S).ravel()
            for joint in model.joints.tolist()[1:]
        ]
        # One of the two parts is the axis, the other is 0. The last body is the base.
        turns = np.array(
            [*(_rotation_to_z(S[:3] + S[3:]) for S in motions), np.eye(3)]
        )
        into_parents = turns[parents].swapaxes(1, 2)
        turns = turns[:-1]
        into_bodies = turns.swapaxes(1, 2)
        rotations = np.array([placement.rotation for placement in placements])
        offsets = np.array([placement.translation for placement in placements])
        centers = np.array([body.lever for body in inertias])
        inertia = into_bodies @ [body.inertia for body in inertias] @ turns
        return Arm(
            gravity=self.gravity,
            parent=parents,
            prismatic=np.array([S[:3].any() for S in motions], np.int8),
            joint=self._order,
            axes=(into_parents @ rotations @ turns).swapaxes(1, 2),
            offset=(into_parents @ offsets[:, :, np.newaxis])[:, :, 0],
            mass=np.array([body.mass for body in inertias]),
            center=(into_bodies @ centers[:, :, np.newaxis])[:, :, 0],
            inertia=np.triu(inertia) + np.triu(inertia, 1).swapaxes(1, 2),
            rotor=np.array(model.armature),
        )

    @cached_property
    def _tip_pose(self) -> Array:
        """Pose of the last link on the body of the last joint, shape (4, 4)."""
        tip = tip_of(self._tree, self.joint_names)
        kinematics = ForwardKinematics(self._tree, self.joint_names, self._locked)
        return kinematics.rigid_bodies()[-1][tip]

    def with_payload(self, masses: Sequence[PointMass]) -> UrdfModel:
        """Return the model of this arm with point masses at its tip."""
        pose = self._tip_pose
        loaded = copy.copy(self)
        loaded.__dict__.pop('bodies', None)
        loaded._model = self._pin.Model(self._model)
        loaded._data = loaded._model.createData()
        joint = loaded._model.getJointId(self.joint_names[-1])
        for payload in masses:
            lever = pose[:3, :3] @ np.array(payload.center) + pose[:3, 3]
            inertia = self._pin.Inertia(payload.mass, lever, np.zeros((3, 3)))
            loaded._model.inertias[joint] = loaded._model.inertias[joint] + inertia
        return loaded

    @property
    def _inertias(self) -> list[Any]:
        """Pinocchio's inertias of the bodies, in our order."""
        bodies = self._model.inertias.tolist()[1:]
        return [bodies[i] for i in self._back]

    def inertial_parameters(self) -> Array:
        """
        Return ten parameters of each body, shape (10 n,).

        They are mass, first moments, and xx, xy, yy, xz, yz, zz of the inertia about the origin of
        the joint's frame.
        """
        return np.concatenate([body.toDynamicParameters() for body in self._inertias])

    def parameter_sizes(self) -> Array:
        """Return rough sizes of the parameters, shape (10 n,)."""
        least_mass = _LEAST_MASS_RATIO * sum(
            body.mass for body in self._model.inertias.tolist()[1:]
        )
        sizes = []
        for body in self._inertias:
            mass = max(body.mass, least_mass)
            lever = float(np.linalg.norm(body.lever))
            gyration = float(np.sqrt(np.trace(body.inertia) / mass))
            reach = max(lever, _LEAST_REACH_M, gyration)
            sizes += [mass]
            sizes += 3 * [mass * reach]
            sizes += 6 * [mass * reach**2]
        return np.array(sizes)

    def torque_regressor(
        self, q: Array, dq: Array, ddq: Array, gravity: Array
    ) -> Array:
        """Return the torque per parameter, shape (n, 10 n)."""
        own_gravity = self._model.gravity.linear.copy()
        self._model.gravity.linear = gravity
        regressor: Array = self._call(
            self._pin.computeJointTorqueRegressor, q, dq, ddq
        )[self._regressor]
        self._model.gravity.linear = own_gravity
        return regressor

    def evaluate(self, q: Array, dq: Array) -> DynamicsTerms:
        """Return M(q), C(q, dq) and G(q) as arrays."""
        return DynamicsTerms(
            self._call(self._pin.crba, q)[self._square],
            self._call(self._pin.computeCoriolisMatrix, q, dq)[self._square],
            self._call(self._pin.computeGeneralizedGravity, q)[self._back],
        )

    def mass_matrix(self, q: Vector) -> Rows:
        """Return M(q), shape (n, n)."""
        return self._matrix(self._pin.crba, q)

    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:
        """Return C(q, dq), shape (n, n), of Christoffel's symbols."""
        return self._matrix(self._pin.computeCoriolisMatrix, q, dq)

    def gravity_torque(self, q: Vector) -> Vector:
        """Return G(q), shape (n,) [N·m or N]."""
        return self._vector(self._pin.computeGeneralizedGravity, q)

    def potential_energy(self, q: Vector) -> float:
        """Return the potential energy, 0 at the height of the root [J]."""
        return float(self._call(self._pin.computePotentialEnergy, q))

    def inverse_dynamics(self, q: Vector, dq: Vector, a: Vector) -> Vector:
        """Return the left side of (1), shape (n,)."""
        return self._vector(self._pin.rnea, q, dq, a)

    def _call(self, function: Any, *vectors: Vector | Array) -> Any:
        """Return a result of Pinocchio, until the next call."""
        return function(
            self._model, self._data, *(np.array(x, float)[self._order] for x in vectors)
        )

    def _vector(self, function: Any, *vectors: Vector) -> Vector:
        """Return a vector in our order."""
        values: Vector = self._call(function, *vectors)[self._back].tolist()
        return values

    def _matrix(self, function: Any, *vectors: Vector) -> Rows:
        """Return a matrix in our order."""
        rows: Rows = self._call(function, *vectors)[self._square].tolist()
        return rows

    def _check_inertia(self) -> None:
        """Raise `CtcError` unless M is positive definite."""
        rng = np.random.default_rng(0)
        for q in (
            np.zeros(self.n),
            *rng.uniform(-1.5, 1.5, (_CHECKED_POSITIONS, self.n)),
        ):
            singular = _singular_joints(self._call(self._pin.crba, q)[self._square])
            if singular:
                raise SingularInertia(tuple(self.joint_names[i] for i in singular))


class SingularInertia(CtcError):
    """
    Refusal of a URDF whose M is singular.

    Attributes
    ----------
    joints : tuple of str
        Joints that move too little inertia.

    """

    def __init__(self, joints: tuple[str, ...]) -> None:
        super().__init__(
            'URDF: M is singular: too little inertia is moved by '
            f'{", ".join(joints)} (a link without mass?)'
        )
        self.joints = joints


def _rotation_to_z(axis: Array) -> Array:
    """Return a rotation that brings z to an axis."""
    nearest_normal = np.eye(3)[np.abs(axis).argmin()]
    x = np.cross(nearest_normal, axis)
    x /= np.linalg.norm(x)
    y = np.cross(axis, x)
    return np.column_stack((x, y, axis))


def _singular_joints(mass: Array) -> list[int]:
    """Return the joints along whose motion M is singular."""
    if not np.isfinite(mass).all():
        return list(range(len(mass)))
    diagonal = mass.diagonal()
    inert = diagonal > _NO_INERTIA * diagonal.max()
    scale = np.sqrt(np.where(inert, diagonal, np.inf))
    values, vectors = np.linalg.eigh(mass / np.outer(scale, scale))
    share = np.abs(vectors[:, values <= _SINGULAR]).max(axis=1, initial=0.0)
    joints: list[int] = np.flatnonzero(share > _NAMED_SHARE * share.max()).tolist()
    return joints


def pinocchio() -> Any:
    """Return the library, which only this model needs."""
    try:
        library = importlib.import_module('pinocchio')
        if not hasattr(library, 'buildModelFromXML'):
            raise ImportError('another package has its name')
    except ImportError as error:
        raise CtcError(
            f'the model urdf needs Pinocchio ({error}): pip install pin, or '
            'apt install ros-jazzy-pinocchio'
        ) from None
    return library


def _reduced_model(pin: Any, tree: Tree, locked: Mapping[str, float]) -> Any:
    """Return Pinocchio's model of the moving joints."""
    with as_ctc_error('URDF: Pinocchio refuses it'):
        model = pin.buildModelFromXML(tree.bare())
        q = pin.neutral(model)
        joints = [model.getJointId(name) for name in locked]
        for joint, position in zip(joints, locked.values()):
            q[model.joints[joint].idx_q] = position
        return pin.buildReducedModel(model, joints, q)

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
The dynamics of an arm that a URDF describes, computed by Pinocchio.

Pinocchio's Coriolis matrix is that of Christoffel's symbols, so that ½ dM/dt - C is skew-symmetric
and C(q, x) y = C(q, y) x. Only inertias and joints are read: meshes are not looked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from functools import cached_property
import importlib
from typing import Any

from ctc_chattering.dynamics.model import LinearModel, Model
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import as_ctc_error, CtcError
from ctc_chattering.numerics.linear_algebra import Array, Rows, Vector
from ctc_chattering.parameters import check_joint_names
import numpy as np
import numpy.typing as npt

#: Least eigenvalue of M, scaled to a diagonal of ones, that counts as more than rounding.
_SINGULAR = 1e-10


@dataclasses.dataclass
class Arm:
    """
    A model of n joints: a tree of bodies, from the base outwards, or the two-link arm.

    Frames are as `UrdfModel.bodies` says.
    """

    #: Whether it is the two-link arm, in closed form, which has no bodies.
    closed: bool
    #: Acceleration of gravity, downwards [m/s²], and a factor of M, C and G. Those of a tree are
    #: in its masses.
    gravity: float
    scale: float
    #: Body that carries each body; -1 for the base. Shape (n,).
    parent: npt.NDArray[np.int64]
    #: Whether the joint is prismatic, shape (n,).
    prismatic: npt.NDArray[np.bool_]
    #: Index in q, M, C and G of the joint of each body, shape (n,).
    joint: npt.NDArray[np.int64]
    #: Frame of the body at position 0 in that of the parent, shapes (n, 3, 3) and (n, 3) [m].
    rotation: Array
    offset: Array
    #: Mass [kg], its centre [m] and the inertia about that [kg·m²], in the frame of the body.
    mass: Array
    center: Array
    inertia: Array
    #: Of the rotor of each body's joint, shape (n,) [kg·m²]: on the diagonal of M alone.
    rotor: Array


class UrdfModel(Model, LinearModel):
    """
    Some joints of a URDF, the others locked.

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
        Positions of other joints [rad or m]; 0 for those left out. A joint that mimics one of
        these goes with it.
    rotors : sequence of float
        Inertias of the rotors at the joints [kg·m²], 0 for those of the URDF; empty for all of
        the URDF.

    Attributes
    ----------
    joint_names : tuple of str
        As given.
    position_limits : tuple of (float, float), length n
        Least and greatest position; ∓inf where the URDF has none.
    velocity_limits, effort_limits : tuple of float, length n
        inf where the URDF has none, or 0.
    continuous : tuple of bool, length n
        Which joints are of this type.
    rotor_inertias : tuple of float, length n
        Of the rotor of each joint, reflected to the joint, on the diagonal of M: as given, or
        `rotor_inertia` in <dynamics>.

    Raises
    ------
    CtcError
        If Pinocchio is missing, the URDF is no tree of joints with one degree of freedom, or M is
        singular; the message names the joints concerned.

    """

    def __init__(self, urdf: str, joint_names: Sequence[str], gravity: float = 9.81,
                 locked: Mapping[str, float] | None = None, rotors: Sequence[float] = ()
                 ) -> None:
        pin = pinocchio()
        self.joint_names = tuple(joint_names)
        check_joint_names(self.joint_names)
        tree = Tree(urdf)
        stand = tree.locked(self.joint_names, locked or {})
        tree.check_limits(self.joint_names)
        joints = [tree.joints[name] for name in self.joint_names]
        self.position_limits = tuple(joint.position for joint in joints)
        self.velocity_limits = tuple(joint.velocity for joint in joints)
        self.effort_limits = tuple(joint.effort for joint in joints)
        self.continuous = tuple(joint.continuous for joint in joints)
        self.rotor_inertias = tuple(
            rotor or joint.rotor_inertia
            for joint, rotor in zip(joints, rotors or (0.0,) * len(joints)))
        self.n, self._links = len(joints), tuple(tree.links)
        self.gravity = gravity
        self._pin, self._model = pin, _reduced(pin, tree, stand)
        self._data = self._model.createData()
        order = [self._model.joints[self._model.getJointId(name)].idx_v
                 for name in self.joint_names]
        #: Indices that bring a vector into Pinocchio's order; a vector and a matrix back from it.
        self._order: Any = np.argsort(order)
        self._back: Any = np.array(order)
        self._square: Any = np.ix_(order, order)
        self._model.armature = np.array(self.rotor_inertias)[self._order]
        self._inertial: Any = np.ix_(order, [10 * i + k for i in order for k in range(10)])
        self._model.gravity.linear = np.array([0.0, 0.0, -gravity])
        self._check_inertia()

    @cached_property
    def bodies(self) -> Arm:
        """
        Return what the dynamics are computed from, fixed and locked joints merged.

        The frame of a body is at its joint, with the axis of the joint along z; rotation and
        offset [m] place it, at position 0, in the frame of the body that carries it. Mass [kg],
        centre [m] and inertia about the centre [kg·m²] are in the frame of the body.
        """
        model, n = self._model, self.n
        axes = [np.array(joint.createData().S).ravel() for joint in model.joints.tolist()[1:]]
        prismatic = np.array([not axis[3:].any() for axis in axes])
        turns = [_to_z(axis[:3] if slides else axis[3:]) for axis, slides in zip(axes, prismatic)]
        before = [np.eye(3), *turns]
        rows = []
        for i in range(n):
            place, body = model.jointPlacements[i + 1], model.inertias[int(i) + 1]
            parent = model.parents[i + 1]
            rows.append((parent - 1, before[parent].T @ place.rotation @ turns[i],
                         before[parent].T @ place.translation, body.mass,
                         turns[i].T @ body.lever, turns[i].T @ body.inertia @ turns[i]))
        parents, rotation, offset, mass, center, inertia = map(np.array, zip(*rows))
        return Arm(False, self.gravity, 1.0, parents, prismatic, self._order, rotation, offset,
                   mass, center, inertia, np.array(model.armature))

    def places(self) -> dict[str, tuple[int, Array]]:
        """Return the joint that moves each link, and the place (4, 4) in that joint's frame."""
        found = {}
        for name, frame in ((name, self._model.frames[self._model.getFrameId(f'link {i}')])
                            for i, name in enumerate(self._links)):
            if frame.parentJoint:
                found[name] = int(self._order[frame.parentJoint - 1]), frame.placement.homogeneous
        return found

    def inertial_parameters(self) -> Array:
        """
        Return ten parameters for each joint's body, shape (10 n,), bodies in our order.

        They are mass, first moments, and xx, xy, yy, xz, yz, zz of the inertia about the origin of
        Pinocchio's frame of the joint.
        """
        return np.concatenate([self._model.inertias[int(i) + 1].toDynamicParameters()
                               for i in self._back])

    def parameter_sizes(self) -> Array:
        """Return how large each parameter is roughly, shape (10 n,)."""
        sizes = []
        whole = sum(body.mass for body in self._model.inertias.tolist()[1:])
        for i in self._back:
            body = self._model.inertias[int(i) + 1]
            mass = max(body.mass, 0.05 * whole)
            reach = max(float(np.linalg.norm(body.lever)), 0.05,
                        float(np.sqrt(np.trace(body.inertia) / mass)))
            sizes += [mass] + 3 * [mass * reach] + 6 * [mass * reach ** 2]
        return np.array(sizes)

    def torque_regressor(self, q: Array, dq: Array, ddq: Array, gravity: Array) -> Array:
        """Return the derivative of the torque by `inertial_parameters`, shape (n, 10 n)."""
        model, order = self._model, self._order
        known = model.gravity.linear.copy()
        model.gravity.linear = gravity
        found: Array = self._pin.computeJointTorqueRegressor(
            model, self._data, q[order], dq[order], ddq[order])[self._inertial]
        model.gravity.linear = known
        return found

    def evaluate(self, q: Array, dq: Array) -> tuple[Array, Array, Array]:
        """Return M(q), C(q, dq) and G(q), shapes (n, n), (n, n) and (n,)."""
        pin, model, data = self._pin, self._model, self._data
        q, dq = q[self._order], dq[self._order]
        return (pin.crba(model, data, q)[self._square],
                pin.computeCoriolisMatrix(model, data, q, dq)[self._square],
                pin.computeGeneralizedGravity(model, data, q)[self._back])

    def mass_matrix(self, q: Vector) -> Rows:
        """Return M(q), shape (n, n)."""
        rows: Rows = self._call(self._pin.crba, q)[self._square].tolist()
        return rows

    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:
        """Return C(q, dq), shape (n, n), of Christoffel's symbols."""
        rows: Rows = self._call(self._pin.computeCoriolisMatrix, q, dq)[self._square].tolist()
        return rows

    def gravity_torque(self, q: Vector) -> Vector:
        """Return G(q), shape (n,) [N·m or N]."""
        return self._vector(self._pin.computeGeneralizedGravity, q)

    def potential_energy(self, q: Vector) -> float:
        """Return the potential energy, 0 where the centre of mass is at the root [J]."""
        return float(self._call(self._pin.computePotentialEnergy, q))

    def inverse_dynamics(self, q: Vector, dq: Vector, a: Vector) -> Vector:
        """Return M(q) a + C(q, dq) dq + G(q), shape (n,)."""
        return self._vector(self._pin.rnea, q, dq, a)

    def _call(self, function: Any, *vectors: Vector | Array) -> Any:
        """Return what a function of Pinocchio gives, in its order; the next call may change it."""
        return function(
            self._model, self._data, *(np.array(x, float)[self._order] for x in vectors))

    def _vector(self, function: Any, *vectors: Vector) -> list[float]:
        """Return a vector that a function of Pinocchio gives, in our order."""
        values: list[float] = self._call(function, *vectors)[self._back].tolist()
        return values

    def _check_inertia(self) -> None:
        """Raise `CtcError` unless M is positive definite at a few positions."""
        rng = np.random.default_rng(0)
        for q in (np.zeros(self.n), *rng.uniform(-1.5, 1.5, (4, self.n))):
            weak = _weak(self._call(self._pin.crba, q)[self._square])
            if weak:
                raise SingularInertia(tuple(self.joint_names[i] for i in weak))


class SingularInertia(CtcError):
    """
    A refusal of a URDF whose M is singular.

    Attributes
    ----------
    joints : tuple of str
        Joints that move too little inertia.

    """

    def __init__(self, joints: tuple[str, ...]) -> None:
        super().__init__('URDF: M is singular: too little inertia is moved by '
                         f'{", ".join(joints)} (a link without mass?)')
        self.joints = joints


def _to_z(axis: Array) -> Array:
    """Return a rotation that brings z to `axis`, shape (3, 3)."""
    least = np.eye(3)[np.abs(axis).argmin()]
    x = np.cross(least, axis)
    x /= np.linalg.norm(x)
    return np.column_stack((x, np.cross(axis, x), axis))


def _weak(mass: Array) -> list[int]:
    """Return the joints along whose motion M is singular; none if it is positive definite."""
    if not np.isfinite(mass).all():
        return list(range(len(mass)))
    sizes = mass.diagonal()
    scale = np.sqrt(np.where(sizes > 1e-14 * sizes.max(), sizes, np.inf))
    values, vectors = np.linalg.eigh(mass / np.outer(scale, scale))
    part = np.abs(vectors[:, values <= _SINGULAR]).max(axis=1, initial=0.0)
    found: list[int] = np.flatnonzero(part > 0.1 * part.max()).tolist()
    return found


def pinocchio() -> Any:
    """Return the library, which only this model needs."""
    try:
        library = importlib.import_module('pinocchio')
        if not hasattr(library, 'buildModelFromXML'):
            raise ImportError('another package has its name')
    except ImportError as error:
        raise CtcError(f'the model urdf needs Pinocchio ({error}): pip install pin, or '
                       'apt install ros-jazzy-pinocchio') from None
    return library


def _reduced(pin: Any, tree: Tree, stand: Mapping[str, float]) -> Any:
    """Return Pinocchio's model of the joints that are not in `stand`, where the others are."""
    with as_ctc_error('URDF: Pinocchio refuses it'):
        model = pin.buildModelFromXML(tree.bare())
        q = pin.neutral(model)
        ids = [model.getJointId(name) for name in stand]
        for joint, value in zip(ids, stand.values()):
            q[model.joints[joint].idx_q] = value
        return pin.buildReducedModel(model, ids, q)

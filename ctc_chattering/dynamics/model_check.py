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
Numerical tests of the properties that laws rest on.

`check_dynamics` and `ctc check-model` run them at random states, also for models of your own.
For a URDF, `inertia_faults` first examines masses and inertias link by link. No rigid body can
break these rules.

Every error is relative. Elements of matrices and torques are measured against √(M_ii M_jj): a
light wrist counts as much as a heavy shoulder. Derivatives are central differences.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple
import xml.etree.ElementTree as ET

from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.urdf_parser import Inertial, Tree
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.parameters import checked_integer
import numpy as np

#: Step of the differences [rad].
_STEP_RAD = 1e-5
#: Largest relative error of sums.
_SUM_TOLERANCE = 1e-10
#: Largest relative error of solutions of linear systems.
_SOLUTION_TOLERANCE = 1e-8
#: Largest relative error of central differences.
_DIFFERENCE_TOLERANCE = 1e-6
#: Largest ratio of the eigenvalues of M, scaled to a diagonal of ones.
_LARGEST_CONDITION = 1e10
#: Moments of inertia below this count as 0 [kg·m²].
_NO_INERTIA_KGM2 = 1e-15
#: A moment may exceed the sum of the others by this ratio: a file has few digits.
_MOMENT_ROUNDING = 1e-3


class PropertyCheck(NamedTuple):
    """The outcome of one check."""

    name: str
    passed: bool
    #: The worst value among the samples, which must not exceed `tolerance`.
    worst: float
    tolerance: float
    #: Position and velocity of the worst value.
    q: tuple[float, ...]
    dq: tuple[float, ...]
    #: Exception that the model raised there, or nothing.
    error: str = ''


class _SampledState:
    """A random state, and the model's terms there."""

    def __init__(self, model: Model, rng: np.random.Generator) -> None:
        self.model = model
        self.q: Array = rng.uniform(-np.pi, np.pi, model.n)
        self.dq: Array = rng.uniform(-2.0, 2.0, model.n)
        #: An acceleration.
        self.ddq: Array = rng.uniform(-3.0, 3.0, model.n)
        self.speed = float(np.abs(self.dq).max()) + 1e-9

    def evaluate(self) -> None:
        """Ask the model for M, C and G."""
        q = self.q.tolist()
        dq = self.dq.tolist()
        self.M = np.array(self.model.mass_matrix(q), dtype=float)
        self.C = np.array(self.model.coriolis_matrix(q, dq), dtype=float)
        self.G = np.array(self.model.gravity_torque(q), dtype=float)
        #: √M_ii, shape (n,).
        self.size: Array = np.sqrt(np.maximum(np.abs(self.M.diagonal()), 1e-300))

    def matrix_error(self, error: Array, scale: float = 1.0) -> float:
        """Return the largest relative element of an error of M."""
        relative = error / np.outer(self.size, self.size)
        return float(np.abs(relative).max()) / scale

    def torque_error(self, error: Array, load: Array) -> float:
        """Return the largest relative error of a torque."""
        size = np.abs(load) + 1e-12 * self.size**2 + 1e-300
        return float((np.abs(error) / size).max())

    def load(self, ddq: Array) -> Array:
        """Return the size of the terms of (1)."""
        load: Array = (
            np.abs(self.M) @ np.abs(ddq)
            + np.abs(self.C) @ np.abs(self.dq)
            + np.abs(self.G).max()
            + self.size * self.size.max() * self.speed**2
        )
        return load

    def slope(
        self, function: Callable[[Vector], object], direction: Array
    ) -> Array:
        """Return the derivative along a direction."""
        step = _STEP_RAD * direction
        above = np.array(function((self.q + step).tolist()))
        below = np.array(function((self.q - step).tolist()))
        slope: Array = (above - below) / (2.0 * _STEP_RAD)
        return slope

    def gradient(self, function: Callable[[Vector], object]) -> Array:
        """Return the derivatives along all joints, shape (n, ...)."""
        return np.array([self.slope(function, axis) for axis in np.eye(self.model.n)])


class _Check(NamedTuple):
    """A property of a model, with its error at a state."""

    name: str
    tolerance: float
    error_of: Callable[[_SampledState], float]


def check_dynamics(
    model: Model, seed: int = 0, samples: int = 20
) -> list[PropertyCheck]:
    """
    Test the terms of a model at random states.

    Parameters
    ----------
    model : Model
        With any number of joints.
    seed : int
        Of the states: the same seed, the same states.
    samples : int
        Number of states, at least 1.

    Returns
    -------
    list of PropertyCheck
        One for each check, with ``name``, ``passed``, ``worst`` and ``tolerance``. If values are
        missing or not finite, only that check.

    Raises
    ------
    ParameterError
        If an argument is not allowed. What the model raises is in the result.

    Examples
    --------
    >>> from ctc_chattering import check_dynamics, TwoLink
    >>> all(x.passed for x in check_dynamics(TwoLink(9.81)))
    True

    """
    seed = checked_integer('seed', seed, 0)
    samples = checked_integer('samples', samples, 1)
    rng = np.random.default_rng(seed)
    states = [_SampledState(model, rng) for _ in range(samples)]
    shapes = _worst(_SHAPES, states)
    if not shapes.passed:
        return [shapes]
    return [shapes, *(_worst(check, states) for check in _CHECKS)]


def _worst(check: _Check, states: Sequence[_SampledState]) -> PropertyCheck:
    """Return a check at its worst state."""
    return max(
        (_outcome(check, state) for state in states), key=lambda outcome: outcome.worst
    )


def _outcome(check: _Check, state: _SampledState) -> PropertyCheck:
    """Return a check at a state."""
    exception_text = ''
    try:
        error = float(check.error_of(state))
    except Exception as exception:  # Whatever a model raises, it is no model.
        error = np.inf
        exception_text = f'{type(exception).__name__}: {exception}'
    if np.isnan(error):
        error = np.inf
    return PropertyCheck(
        check.name,
        error <= check.tolerance,
        error,
        check.tolerance,
        tuple(state.q.tolist()),
        tuple(state.dq.tolist()),
        exception_text,
    )


def _malformed(s: _SampledState) -> float:
    s.evaluate()
    terms = (s.M, s.C, s.G)
    n = s.model.n
    if [x.shape for x in terms] != [(n, n), (n, n), (n,)]:
        return np.inf
    return 0.0 if all(np.isfinite(x).all() for x in terms) else np.inf


def _symmetry_error(s: _SampledState) -> float:
    return s.matrix_error(s.M - s.M.T)


def _condition_number(s: _SampledState) -> float:
    scaled = s.M / np.outer(s.size, s.size)
    values = np.linalg.eigvalsh(scaled)
    return float(values[-1] / values[0]) if values[0] > 0.0 else np.inf


def _skew_error(s: _SampledState) -> float:
    mass_rate = s.slope(s.model.mass_matrix, s.dq)
    skew = 0.5 * mass_rate - s.C
    return s.matrix_error(skew + skew.T, s.speed)


def _lagrange_error(s: _SampledState) -> float:
    """Compare C dq with dM/dt dq - ½ grad(dqᵀ M dq)."""
    mass_matrix = s.model.mass_matrix
    gradient = 0.5 * s.gradient(mass_matrix) @ s.dq @ s.dq
    mass_rate = s.slope(mass_matrix, s.dq)
    expected = mass_rate @ s.dq - gradient
    error = (s.C @ s.dq - expected) / s.size
    scale = s.size.max() * s.speed**2
    return float(np.abs(error).max() / scale)


def _gradient_error(s: _SampledState) -> float:
    potential = s.model.potential_energy
    gradient = s.gradient(potential)
    scale = float(np.abs([s.G, gradient]).max())
    # The difference of two potentials is known no better than they are.
    noise = 1e-8 * abs(potential(s.q.tolist()))
    floor = 1e-6 * float(s.size.max()) ** 2
    error = float(np.abs(s.G - gradient).max())
    return error / (scale + noise + floor)


def _inverse_error(s: _SampledState) -> float:
    torque = s.model.inverse_dynamics(s.q.tolist(), s.dq.tolist(), s.ddq.tolist())
    error = np.reshape(torque, s.ddq.shape) - s.M @ s.ddq - s.C @ s.dq - s.G
    return s.torque_error(error, s.load(s.ddq))


def _forward_error(s: _SampledState) -> float:
    torque = s.G + s.size * s.ddq
    ddq = s.model.forward(s.q.copy(), s.dq.copy(), torque)
    error = s.M @ ddq + s.C @ s.dq + s.G - torque
    return s.torque_error(error, s.load(ddq) + np.abs(torque))


def _evaluate_error(s: _SampledState) -> float:
    M, C, G = s.model.evaluate(s.q.copy(), s.dq.copy())
    return max(
        s.matrix_error(M - s.M),
        s.matrix_error(C - s.C, s.speed),
        s.torque_error(G - s.G, np.abs(s.G).max() + s.size),
    )


_SHAPES = _Check('values are finite and have their shapes', 0.0, _malformed)
_CHECKS = (
    _Check('M is symmetric', _SUM_TOLERANCE, _symmetry_error),
    _Check(
        'M is positive definite (condition number)',
        _LARGEST_CONDITION,
        _condition_number,
    ),
    _Check('½ dM/dt - C is skew-symmetric', _DIFFERENCE_TOLERANCE, _skew_error),
    _Check('C dq agrees with the derivatives of M', _DIFFERENCE_TOLERANCE, _lagrange_error),
    _Check(
        'G is the gradient of the potential', _DIFFERENCE_TOLERANCE, _gradient_error
    ),
    _Check('evaluate agrees with M, C and G', _SUM_TOLERANCE, _evaluate_error),
    _Check('inverse_dynamics agrees with M a + C dq + G', _SUM_TOLERANCE, _inverse_error),
    _Check(
        'forward dynamics inverts inverse dynamics', _SOLUTION_TOLERANCE, _forward_error
    ),
)


def inertia_faults(urdf: str, joints: Sequence[str]) -> list[str]:
    """
    Return the faults of moving links, a line each.

    A link moves if a joint of the model is between it and the root. It must have a mass if it has
    a shape. Its principal moments of inertia must not be negative, and none may exceed the sum of
    the other two.

    Parameters
    ----------
    urdf : str
        Text that `urdf_parser.Tree` accepts.
    joints : sequence of str
        Joints of the model.

    """
    tree = Tree(urdf)
    moving: set[str] = set()
    for name, (parent, child) in tree.ends.items():
        if name in joints or parent in moving:
            moving.add(child)
    return [
        f'link {name} {fault}'
        for name, link in tree.links.items()
        if name in moving and (fault := _inertia_fault(link, tree.inertials[name]))
    ]


def _inertia_fault(link: ET.Element, inertial: Inertial | None) -> str:
    """Return the fault of an inertia, or nothing."""
    shaped = link.find('visual') is not None or link.find('collision') is not None
    if inertial is None:
        return 'moves and has a shape, but no inertia' if shaped else ''
    if inertial.mass == 0.0 and shaped:
        return 'moves and has a shape, but no mass'
    xx, xy, xz, yy, yz, zz = inertial.moments.values()
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    slack = _MOMENT_ROUNDING * float(np.abs(moments).max()) + _NO_INERTIA_KGM2
    if moments[0] >= -slack and moments[2] <= moments[0] + moments[1] + slack:
        return ''
    shown = ', '.join(f'{x:.4g}' for x in moments)
    return (
        f'has a mass of {inertial.mass:g} kg and principal moments {shown} kg*m^2: none may '
        'be negative, or exceed the sum of the others'
    )

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
Whether a model is one: properties that the laws and the proof rest on, tested by numbers.

Of a URDF masses and inertias are checked first, link by link: no rigid body can break these.

Every error is relative. Entries of matrices and torques are measured against √(M_ii M_jj), so that
a light wrist counts as much as a heavy shoulder. Derivatives are central differences.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple
import xml.etree.ElementTree as ET

from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.parameters import whole
import numpy as np

#: Step of the differences [rad].
_STEP = 1e-5
#: Of sums, of solutions of linear systems, and of differences.
_EXACT, _SOLVED, _DIFFERENCES = 1e-10, 1e-8, 1e-6
#: Largest ratio of eigenvalues of M, scaled to a diagonal of ones.
_CONDITION = 1e10
#: By how much a moment of inertia may exceed the sum of the others: digits of the file.
_ROUNDING = 1e-3
#: What counts as 0 [kg*m^2].
_NOTHING = 1e-15


class PropertyCheck(NamedTuple):
    """The outcome of one check."""

    name: str
    passed: bool
    #: The worst value among the samples, which must not exceed `tolerance`.
    worst: float
    tolerance: float
    #: Position and velocity where it was.
    q: tuple[float, ...]
    dq: tuple[float, ...]
    #: What the model raised there, if that is why.
    error: str = ''


class _SampledState:
    """A sampled state and what the model says of it, as arrays."""

    def __init__(self, model: Model, q: Array, dq: Array, x: Array) -> None:
        self.model, self.q, self.dq, self.x = model, q, dq, x
        self.at: tuple[list[float], list[float]] = (q.tolist(), dq.tolist())
        self.speed = float(np.abs(dq).max()) + 1e-9

    def ask(self) -> float:
        """Ask for M, C and G; return inf unless they are finite and have their shapes, else 0."""
        n, model = self.model.n, self.model
        self.mass = np.array(model.mass_matrix(self.at[0]), dtype=float)
        self.coriolis = np.array(model.coriolis_matrix(*self.at), dtype=float)
        self.weight = np.array(model.gravity_torque(self.at[0]), dtype=float)
        terms = (self.mass, self.coriolis, self.weight)
        if [x.shape for x in terms] != [(n, n), (n, n), (n,)] or not all(
                np.isfinite(x).all() for x in terms):
            return np.inf
        #: √M_ii, shape (n,).
        self.size: Array = np.sqrt(np.maximum(np.abs(self.mass.diagonal()), 1e-300))
        return 0.0

    def matrix_error(self, error: Array, per: float = 1.0) -> float:
        return float(np.abs(error / np.outer(self.size, self.size)).max()) / per

    def torque_error(self, error: Array, per: Array) -> float:
        """Return an error of a torque against the terms it is a sum of."""
        return float((np.abs(error) / (np.abs(per) + 1e-12 * self.size ** 2 + 1e-300)).max())

    def slope(self, function: Callable[[Vector], object], direction: Array) -> Array:
        """Return the derivative of a function of q along a direction."""
        up, down = (np.array(function((self.q + step).tolist()))
                    for step in (_STEP * direction, -_STEP * direction))
        slope: Array = (up - down) / (2.0 * _STEP)
        return slope


def check_dynamics(model: Model, seed: int = 0, samples: int = 20) -> list[PropertyCheck]:
    """
    Test a model at random states: M, C, G and the products that the laws rest on.

    Parameters
    ----------
    model : Model
        With any number of joints.
    seed : int
        Of the states: the same seed, the same states.
    samples : int
        Number of states; at least 1.

    Returns
    -------
    list of PropertyCheck
        One for each check, with ``name``, ``passed``, ``worst`` and ``tolerance``; if values are
        missing or not finite, for that alone.

    Raises
    ------
    ParameterError
        If an argument is not allowed; what the model raises is in the result.

    Examples
    --------
    >>> from ctc_chattering import check_dynamics, TwoLink
    >>> all(x.passed for x in check_dynamics(TwoLink(9.81)))
    True

    """
    seed, samples = whole('seed', seed, 0), whole('samples', samples, 1)
    rng = np.random.default_rng(seed)
    n = model.n
    states = [_SampledState(model, rng.uniform(-np.pi, np.pi, n), rng.uniform(-2.0, 2.0, n),
                            rng.uniform(-3.0, 3.0, n)) for _ in range(samples)]
    shaped = _worst('values are finite and have their shapes', 0.0, _SampledState.ask, states)
    if not shaped.passed:
        return [shaped]
    return [shaped, *(_worst(*check, states) for check in _CHECKS)]


def _worst(name: str, tolerance: float, error: Callable[[_SampledState], float],
           states: Sequence[_SampledState]) -> PropertyCheck:
    worst, where, why = -1.0, states[0], ''
    for state in states:
        try:
            value, text = error(state), ''
        except Exception as exception:  # Whatever a model raises, it is no model.
            value, text = np.inf, f'{type(exception).__name__}: {exception}'
        if not value <= worst:  # NaN is the worst.
            worst, where, why = value if value == value else np.inf, state, text
    return PropertyCheck(name, worst <= tolerance, float(worst), tolerance,
                         tuple(where.at[0]), tuple(where.at[1]), why)


def _symmetric(s: _SampledState) -> float:
    return s.matrix_error(s.mass - s.mass.T)


def _condition(s: _SampledState) -> float:
    values = np.linalg.eigvalsh(s.mass / np.outer(s.size, s.size))
    return float(values[-1] / values[0]) if values[0] > 0.0 else np.inf


def _skew(s: _SampledState) -> float:
    skew = 0.5 * s.slope(s.model.mass_matrix, s.dq) - s.coriolis
    return s.matrix_error(skew + skew.T, s.speed)


def _lagrange(s: _SampledState) -> float:
    """Check C dq against dM/dt dq - ½ grad(dqᵀ M dq), which fixes C dq whatever C is."""
    gradient = [0.5 * s.dq @ s.slope(s.model.mass_matrix, x) @ s.dq for x in np.eye(s.model.n)]
    expected = s.slope(s.model.mass_matrix, s.dq) @ s.dq - np.array(gradient)
    error = (s.coriolis @ s.dq - expected) / s.size
    return float(np.abs(error).max() / (s.size.max() * s.speed ** 2))


def _gradient(s: _SampledState) -> float:
    slope = np.array([s.slope(s.model.potential_energy, x) for x in np.eye(s.model.n)])
    scale = float(np.abs([s.weight, slope]).max())
    # The difference of two potentials is known no better than they are.
    noise = 1e-8 * abs(s.model.potential_energy(s.at[0]))
    return float(np.abs(s.weight - slope).max()) / (
        scale + noise + 1e-6 * float(s.size.max()) ** 2)


def _inverse(s: _SampledState) -> float:
    made = np.reshape(s.model.inverse_dynamics(*s.at, s.x.tolist()), s.x.shape)
    return s.torque_error(made - s.mass @ s.x - s.coriolis @ s.dq - s.weight, _load(s, s.x))


def _load(s: _SampledState, a: Array) -> Array:
    """Return the size of the terms of equation (1)."""
    load: Array = (np.abs(s.mass) @ np.abs(a) + np.abs(s.coriolis) @ np.abs(s.dq)
                   + np.abs(s.weight).max() + s.size * s.size.max() * s.speed ** 2)
    return load


def _forward(s: _SampledState) -> float:
    u = s.weight + s.size * s.x
    ddq = s.model.forward(s.q.copy(), s.dq.copy(), u)
    error = s.mass @ ddq + s.coriolis @ s.dq + s.weight - u
    return s.torque_error(error, _load(s, ddq) + np.abs(u))


def _evaluate(s: _SampledState) -> float:
    mass, coriolis, weight = s.model.evaluate(s.q.copy(), s.dq.copy())
    scale = np.abs(s.weight).max() + s.size
    return max(s.matrix_error(mass - s.mass), s.matrix_error(coriolis - s.coriolis, s.speed),
               s.torque_error(weight - s.weight, scale))


_CHECKS: tuple[tuple[str, float, Callable[[_SampledState], float]], ...] = (
    ('M is symmetric', _EXACT, _symmetric),
    ('M is positive definite (condition number)', _CONDITION, _condition),
    ('½ dM/dt - C is skew-symmetric', _DIFFERENCES, _skew),
    ('C dq is what M gives', _DIFFERENCES, _lagrange),
    ('G is the gradient of the potential', _DIFFERENCES, _gradient),
    ('evaluate gives M, C and G', _EXACT, _evaluate),
    ('inverse_dynamics is M a + C dq + G', _EXACT, _inverse),
    ('forward dynamics undoes inverse dynamics', _SOLVED, _forward))


def inertia_faults(urdf: str, joints: Sequence[str]) -> list[str]:
    """
    Return what is wrong with the links that move, a line for each; empty if nothing is.

    A link moves if one of `joints` is between it and the root. It must have a mass if it has a
    shape, and principal moments of inertia that are positive and of which none exceeds the sum
    of the other two.

    Parameters
    ----------
    urdf : str
        Text that `urdf_parser.Tree` accepts.
    joints : sequence of str
        Those of the model.

    """
    tree = Tree(urdf)
    moving: set[str] = set()
    for name, (parent, child) in tree.ends.items():
        if name in joints or parent in moving:
            moving.add(child)
    return [f'link {name} {fault}' for name, link in tree.links.items()
            if name in moving and (fault := _fault(link))]


def _fault(link: ET.Element) -> str:
    """Return what is wrong with the inertia of a link; empty for nothing."""
    shaped = link.find('visual') is not None or link.find('collision') is not None
    mass, tensor = link.find('inertial/mass'), link.find('inertial/inertia')
    if mass is None or tensor is None:
        return 'moves and has a shape, but no inertia' if shaped else ''
    m = float(mass.get('value', ''))
    xx, xy, xz, yy, yz, zz = (
        float(tensor.get(key, '')) for key in ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz'))
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if m == 0.0 and shaped:
        return 'moves and has a shape, but no mass'
    slack = _ROUNDING * float(np.abs(moments).max()) + _NOTHING
    if moments[0] < -slack or moments[2] > moments[0] + moments[1] + slack:
        shown = ', '.join(f'{x:.4g}' for x in moments)
        return (f'has a mass of {m:g} kg and principal moments {shown} kg*m^2: none may be '
                'negative, or exceed the sum of the others')
    return ''

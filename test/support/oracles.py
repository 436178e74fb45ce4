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

"""Independent oracles: the paper's equations in numpy, tiny models, and helpers of the tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import itertools

from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.numerics.linear_algebra import Rows, Vector
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def paper_m(q: Vector) -> Array:
    """Return M(q) of section 4."""
    c2 = np.cos(q[1])
    return np.array([[8.77 + 1.02 * c2, 0.76 + 0.51 * c2], [0.76 + 0.51 * c2, 0.62]])


def paper_c(q: Vector, dq: Vector) -> Array:
    """Return C(q, dq) of section 4."""
    s2 = np.sin(q[1])
    return np.array([[-0.51 * s2 * dq[1], -0.51 * s2 * (dq[0] + dq[1])], [0.51 * s2 * dq[0], 0.0]])


def paper_g(q: Vector, g: float = 9.81) -> Array:
    """Return G(q) of section 4."""
    second = 0.63 * np.sin(q[0] + q[1])
    return g * np.array([7.6 * np.sin(q[0]) + second, second])


def paper_field(tau: Vector, d: Callable[[float], Array] | None = None
                ) -> Callable[[float, Array], Array]:
    """Return the right side of equation (1) without friction, for scipy's solve_ivp."""
    def field(t: float, x: Array) -> Array:
        q, dq = x[:2], x[2:]
        u = np.asarray(tau) + (d(t) if d else 0.0)
        ddq = np.linalg.solve(paper_m(q.tolist()), u - paper_c(q.tolist(), dq.tolist()) @ dq
                              - paper_g(q.tolist()))
        return np.concatenate([dq, ddq])
    return field


def states(count: int, n: int = 2, seed: int = 1) -> Iterator[tuple[list[float], list[float]]]:
    """Yield random positions and velocities."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield rng.uniform(-4.0, 4.0, n).tolist(), rng.uniform(-3.0, 3.0, n).tolist()


def random_spd(rng: np.random.Generator, n: int, decades: float = 1.0) -> Array:
    """Return a random symmetric positive definite matrix whose eigenvalues span `decades`."""
    turn, _ = np.linalg.qr(rng.normal(size=(n, n)))
    a: Array = turn @ np.diag(10.0 ** rng.uniform(-decades / 2, decades / 2, n)) @ turn.T
    symmetric: Array = (a + a.T) / 2
    return symmetric


class Generic(Model):
    """The two-link arm with nothing but M, C, G and the potential: products are the base's."""

    n, _closed = 2, TwoLink()
    mass_matrix, coriolis_matrix = _closed.mass_matrix, _closed.coriolis_matrix
    gravity_torque, potential_energy = _closed.gravity_torque, _closed.potential_energy


class Masses(Model):
    """A constant mass matrix on a plane: no Coriolis term, no gravity."""

    def __init__(self, mass: Rows) -> None:
        self.mass = mass
        self.n = len(mass)

    def mass_matrix(self, q: Vector) -> Rows:
        """Return the constant M."""
        del q
        return self.mass

    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:
        """Return zeros."""
        del q, dq
        return [[0.0] * self.n] * self.n

    def gravity_torque(self, q: Vector) -> Vector:
        """Return zeros."""
        del q
        return [0.0] * self.n

    def potential_energy(self, q: Vector) -> float:
        """Return zero."""
        del q
        return 0.0


def box_by_enumeration(a: Array, b: Array, bound: Array) -> Array:
    """Return the minimum of ½ zᵀ A z + bᵀ z among the 3^n sets of active bounds."""
    n, best = len(b), np.zeros(len(b))
    least = float('inf')
    for sides in itertools.product((-1, 0, 1), repeat=n):
        side = np.array(sides)
        z = side * bound
        free = side == 0
        if free.any():
            z[free] = np.linalg.solve(a[np.ix_(free, free)], -(b + a @ z)[free])
        if (np.abs(z) <= bound * (1 + 1e-12) + 1e-300).all():
            value = float(0.5 * z @ a @ z + b @ z)
            if value < least:
                best, least = z, value
    return best


def inclusion_by_enumeration(mass: Array, wanted: Array, gain: Array) -> Array:
    """Return z ∈ Ka Sgn(x) with M x = wanted - z: the first of the 3^n sets of signs that fits."""
    size = 1e-9 * (1.0 + np.abs(wanted).max() + gain.max())
    for sides in itertools.product((0, 1, -1), repeat=len(wanted)):
        side = np.array(sides)
        z, x, moves = side * gain, np.zeros(len(wanted)), side != 0
        if moves.any():
            x[moves] = np.linalg.solve(mass[np.ix_(moves, moves)], (wanted - z)[moves])
        z[~moves] = (wanted - mass @ x)[~moves]
        if (np.abs(z) <= gain + size).all() and (x * side >= 0.0).all():
            return z
    raise AssertionError('no set of signs fits')

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
A control law as a linear system, from differences of its own code.

`control/margins.py` forms loops with it. A `Controller` runs with a model of constant M̂, without
C and G, in a steady motion of 1 rad/s: friction has one sign there, and nothing is at rest.
Central differences of its step give, for deviations of its whole memory::

    x⁺ = A x + B y,     τ = C x + D y,     y = (q, dq)                                    (LL1)

Differences of two sizes must agree, which they do not for a law that is not linear there. States
that y does not reach, or that do not reach τ, are left out.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import RECORDS
from ctc_chattering.compiled.records import load, packed
from ctc_chattering.control.controller import Controller
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.sample import TRANSIT_ROWS
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array, Rows, Vector
import numpy as np

#: Size of the differences [rad], and another one, with which they must agree.
_DIFFERENCE = 1e-9
_LARGER_DIFFERENCE = 1e-8
#: Below this fraction of its largest value, a difference is rounding.
_ROUNDING = 1e-8


class LinearLaw(NamedTuple):
    """A law near a steady motion, (LL1), with m states."""

    #: Shape (m, m).
    A: Array
    #: Shape (m, 2 n).
    B: Array
    #: Shape (n, m).
    C: Array
    #: Shape (n, 2 n).
    D: Array

    def response(self) -> Array:
        """Return the sum of the torques in the first ten samples after y, shape (n, 2 n)."""
        response: Array = self.D + sum(
            self.C @ np.linalg.matrix_power(self.A, k) @ self.B for k in range(9))
        return response

    def one_joint(self) -> LinearLaw:
        """Return the first joint of a law whose joints are independent and equal."""
        columns = np.array([0, len(self.D)])
        reached = self.B[:, columns].any(axis=1)
        for _ in range(len(self.A)):
            reached = reached | self.A[:, reached].any(axis=1)
        return LinearLaw(self.A[reached][:, reached], self.B[reached][:, columns],
                         self.C[:1, reached], self.D[:1, columns])


class Frozen(Model):
    """
    A robot with a constant M, without C and G.

    Parameters
    ----------
    mass : array, shape (n, n)
        M [kg·m²].

    """

    def __init__(self, mass: Array) -> None:
        self.n, self._mass = len(mass), mass.tolist()

    def mass_matrix(self, q: Vector) -> Rows:  # noqa: ARG002
        """Return M, shape (n, n)."""
        return list(self._mass)

    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:  # noqa: ARG002
        """Return 0, shape (n, n)."""
        return [[0.0] * self.n] * self.n

    def gravity_torque(self, q: Vector) -> Vector:  # noqa: ARG002
        """Return 0, shape (n,)."""
        return [0.0] * self.n

    def potential_energy(self, q: Vector) -> float:  # noqa: ARG002
        """Return 0."""
        return 0.0


def linear_law(config: ControllerConfig, mass: Array) -> LinearLaw:
    """
    Return the law of a configuration as a linear system.

    Parameters
    ----------
    config : ControllerConfig
        Law, gains, and the assumed drives. Limits do not matter. Friction as it is configured and
        learned is not linear but bounded by Ka, and is left out.
    mass : array, shape (n, n)
        M̂ of the controller [kg·m²].

    Raises
    ------
    CtcError
        If the law is not linear near a steady motion.

    """
    changes: dict[str, object] = dict.fromkeys(
        ('effort_limit', 'effort_rate_limit', 'error_limit'), np.inf)
    changes |= {name: 0.0 for name in ('friction_level', 'friction_learning')
                if config.takes(name)}
    changes |= {'inertia_scale': 1.0, 'gravity_scale': 1.0, 'compiled': False}
    motion = _SteadyMotion(config.changed(changes), mass)
    scale = motion.sensitivity()
    small, large = (motion.differences(size, scale)
                    for size in (_DIFFERENCE, _LARGER_DIFFERENCE))
    if not np.abs(small - large).max() <= 1e-3 * np.abs(small).max():
        name = ' '.join(filter(None, (config.law, config.switching_in_force)))
        raise CtcError(
            f'law {name} is not linear near a steady motion; its stability is not computed')
    return _minimal(small, scale, motion.states)


class _SteadyMotion:
    """The control step at a sample of the motion, as a function of the memory."""

    def __init__(self, config: ControllerConfig, mass: Array) -> None:
        self._controller = controller = Controller(config, Frozen(mass))
        n, delay, h = len(mass), config.input_delay, controller.settings.period
        self._period, self._rest, self._speed = h, np.zeros(n), np.ones(n)
        self._points = [self._point(k * h) for k in range(delay + 1)]
        # Four samples, and the delay, until nothing shows the start.
        for k in range(-4 - 2 * delay, 0):
            point, *ahead = (self._point((k + j) * h) for j in range(delay + 1))
            self._answer(point[0], self._speed, point, ahead)
        if type(controller.memories.law) not in RECORDS:
            raise CtcError(f'law {config.law}: its memory is not marked by @record; its stability '
                           'is not computed')
        self._layout = packed(controller.memories).dtype
        self._values = self._memory_values()
        self._y = np.concatenate([self._rest, self._speed])
        #: Number of values in the memory.
        self.states = len(self._values)
        self._parts = self._layout.itemsize // 8, self.states

    def _point(self, q: float) -> tuple[Any, ...]:
        """Return q_d, dq_d and ddq_d on the motion."""
        return q * self._speed, self._speed, self._rest

    def _memory_values(self) -> Array:
        """Return the memories of the controller, with the torques in transit in their order."""
        memories, transit = self._controller.memories, self._controller.transit
        transit_index = int(memories.control.transit_index)
        record = packed(memories._replace(control=memories.control._replace(transit_index=0.0)))
        numbers = np.frombuffer(record.tobytes())
        in_order = np.roll(transit, -TRANSIT_ROWS * transit_index, axis=0)
        return np.concatenate([numbers, in_order.ravel()])

    def _step(self, values: Array) -> Array:
        """Return the memories a period later, and the torque, for memories and y."""
        controller, (numbers, transit, y) = self._controller, np.split(values, self._parts)
        controller.transit[:] = transit.reshape(controller.transit.shape)
        controller.memories = load(np.frombuffer(numbers.tobytes(), self._layout)[0])
        q, dq = np.split(y, 2)
        tau = self._answer(q, dq, self._points[0], self._points[1:])
        return np.concatenate([self._memory_values(), tau])

    def _answer(self, q: Any, dq: Any, point: tuple[Any, ...], ahead: list[Any]) -> Vector:
        """Return the torque for a state and the reference."""
        q_d, dq_d, ddq_d = point
        return self._controller.step(q, dq, q_d, dq_d, ddq_d, ahead).tau

    def sensitivity(self) -> Array:
        """
        Return how far noise of 1 of q and of 1 / h of dq moves memory and y, shape (m + 2 n,).

        It is 0 for values that the noise does not reach.
        """
        m, n = self.states, len(self._rest)
        rng, values = np.random.default_rng(0), np.concatenate([self._values, self._y])
        noise = np.repeat([1.0, 1.0 / self._period], n)
        undisturbed, deviation, largest = self._step(values)[:m], np.zeros(m), np.zeros(m)
        for _ in range(64):
            y = _DIFFERENCE * noise * rng.standard_normal(2 * n)
            deviation = self._step(values + np.concatenate([deviation, y]))[:m] - undisturbed
            largest = np.maximum(largest, np.abs(deviation) / _DIFFERENCE)
        is_reached = largest > _ROUNDING * np.maximum(np.abs(self._values), 1.0)
        return np.concatenate([np.where(is_reached, largest, 0.0), noise])

    def differences(self, size: float, scale: Array) -> Array:
        """Return the change of memory and τ, shape (m + n, m + 2 n), for changes of 1 `scale`."""
        m, values = self.states, np.concatenate([self._values, self._y])
        change = np.zeros((m + len(self._rest), len(values)))
        for k in np.flatnonzero(scale):
            d = np.zeros(len(values))
            d[k] = size * scale[k]
            change[:, k] = (self._step(values + d) - self._step(values - d)) / (2.0 * size)
        change[:m] /= np.where(scale, scale, np.inf)[:m, np.newaxis]
        return change


def _minimal(change: Array, scale: Array, m: int) -> LinearLaw:
    """Return the part of a system that y reaches and that reaches τ, with y unscaled."""
    largest = np.abs(change).max(axis=1, keepdims=True, initial=1e-300)
    change = np.where(np.abs(change) > _ROUNDING * largest, change, 0.0)
    A, B, C, D = change[:m, :m], change[:m, m:], change[m:, :m], change[m:, m:]
    reaches = (C != 0.0).any(axis=0)
    for _ in range(m):
        reaches = reaches | (A[reaches] != 0.0).any(axis=0)
    kept = reaches & (scale[:m] > 0.0)
    return LinearLaw(A[np.ix_(kept, kept)], B[kept] / scale[m:], C[:, kept], D / scale[m:])

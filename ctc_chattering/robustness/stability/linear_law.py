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
A law as a linear system, taken from its own code.

The control step of a law runs with a model of constant M̂ and no C and G, in a steady motion of 1
rad/s: friction has one sign there, and nothing is at rest. Central differences of the step give::

    x⁺ = A x + B y,     τ = C x + D y,     y = (q, dq)                                    (LL1)

for deviations of everything that is remembered. Differences of two sizes must agree; those of a
law that is not linear there do not. What y does not reach, or does not reach τ, is left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from ctc_chattering.control.control_step import step
from ctc_chattering.control.controller import Controller
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.delay_prediction import ROWS
from ctc_chattering.control.evaluation import Context, Models
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array, Rows, Vector
import numpy as np

#: Velocity of the motion [rad/s], and its samples, besides the delay, before the one that counts.
_SPEED, _BEFORE = 1.0, 4
#: Sizes of the differences [rad], and how far they may disagree, relative to the largest.
_SIZES, _AGREE = (1e-9, 1e-8), 1e-3
#: Samples of noise of that size that show how far what is remembered moves.
_NOISY = 64
#: Below this, relative to how far that moves, a difference is rounding.
_ROUNDING = 1e-8
#: What is not linear and bounded by Ka: friction as it is known and learned.
_FRICTION = {'friction_level': 0.0, 'friction_learning': 0.0}


class LinearLaw(NamedTuple):
    """A law near a steady motion, (LL1), with m states."""

    #: Shapes (m, m), (m, 2 n), (n, m) and (n, 2 n).
    A: Array
    B: Array
    C: Array
    D: Array


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
        Law, gains, and what it knows of the drives; effort limits count as none.
    mass : array, shape (n, n)
        M̂ of the controller [kg·m²].

    Raises
    ------
    CtcError
        If the law is not linear near a steady motion.

    """
    free = dict.fromkeys(('effort_limit', 'effort_rate_limit', 'error_limit'), np.inf)
    known = {name: x for name, x in _FRICTION.items() if config.takes(name)}
    config = config.changed({**free, **known, 'inertia_scale': 1.0, 'gravity_scale': 1.0,
                             'compiled': False})
    at = _SteadyMotion(config, mass)
    scale = at.moved()
    small, large = (at.differences(size, scale) for size in _SIZES)
    if not np.abs(small - large).max() <= _AGREE * np.abs(small).max():
        raise CtcError(f'law {config.law}{" " * bool(config.switching_in_force)}'
                       f'{config.switching_in_force} is not linear near a steady motion; its '
                       'stability is not computed')
    return _minimal(small, scale, at.states)


class _SteadyMotion:
    """The control step at a sample of the motion, as a function of what is remembered."""

    def __init__(self, config: ControllerConfig, mass: Array) -> None:
        made = Controller(config, Frozen(mass))
        n, self._delay, self._law = len(mass), config.input_delay, made.law
        h, one = made.settings.period, np.ones(n)
        self._settings, self._models = made.settings, Models(*(made.model,) * 3)
        before = _BEFORE + 2 * self._delay
        for k in range(-before, 0):
            made.step(*self._row(k * h * one, one), [
                self._row((k + j) * h * one, one)[2:] for j in range(1, self._delay + 1)])
        self._memories = made.memory._replace(turn=0.0), made.law_memory
        rolled = np.roll(made.transit, -ROWS * int(made.memory.turn), axis=0)
        self._at = np.concatenate([*_numbers(self._memories), rolled.ravel()])
        self._y = np.concatenate([0.0 * one, _SPEED * one])
        self._points = np.array([x for j in range(self._delay + 1)
                                 for x in self._row(j * h * one, one)[2:]])
        #: Number of what is remembered.
        self.states = len(self._at)

    @staticmethod
    def _row(q: Array, one: Array) -> tuple[Any, Any, Any, Any, Any]:
        """Return q, dq, q_d, dq_d and ddq_d on the motion."""
        dq = _SPEED * one
        return q, dq, q, dq, 0.0 * one

    def _stepped(self, values: Array) -> Array:
        """Return what is remembered a period later, and the torque, for what is now, and y."""
        m, n = self.states, len(self._y) // 2
        rest = values[:m].tolist()
        memory, law_memory = _record(self._memories, iter(rest))
        transit = values[m - ROWS * self._delay * n:m].reshape(-1, n).copy()
        context = Context(self._settings, self._models, transit, self._points)
        made = step(context, self._law, memory, law_memory, values[m:m + n], values[m + n:],
                    self._points)
        turn = int(made.memory.turn)
        after = np.roll(transit, -ROWS * turn, axis=0).ravel()
        return np.concatenate([
            *_numbers((made.memory._replace(turn=0.0), made.law_memory)), after, made.sent.tau])

    def moved(self) -> Array:
        """
        Return how far noise of 1 of q and of 1 / h of dq moves all, shape (m + 2 n,).

        0 for what it does not reach.
        """
        m, n = self.states, len(self._y) // 2
        rng, at = np.random.default_rng(0), np.concatenate([self._at, self._y])
        of_y = np.repeat([1.0, 1.0 / self._settings.period], n)
        before, d, most = self._stepped(at)[:m], np.zeros(m), np.zeros(m)
        for _ in range(_NOISY):
            y = _SIZES[0] * of_y * rng.standard_normal(2 * n)
            d = self._stepped(at + np.concatenate([d, y]))[:m] - before
            most = np.maximum(most, np.abs(d) / _SIZES[0])
        reached = most > _ROUNDING * np.maximum(np.abs(self._at), 1.0)
        return np.concatenate([np.where(reached, most, 0.0), of_y])

    def differences(self, size: float, scale: Array) -> Array:
        """Return the change of all and of τ, shape (m + n, m + 2 n), for changes of 1 `scale`."""
        at = np.concatenate([self._at, self._y])
        found = np.zeros((self.states + len(self._y) // 2, len(at)))
        for k in np.flatnonzero(scale):
            d = np.zeros(len(at))
            d[k] = size * scale[k]
            found[:, k] = (self._stepped(at + d) - self._stepped(at - d)) / (2.0 * size)
        found[:self.states] /= np.where(scale, scale, np.inf)[:self.states, np.newaxis]
        return found


def _numbers(record: Any) -> Iterator[Array]:
    """Yield the numbers of a record and of those in it."""
    for x in record:
        if isinstance(x, tuple):
            yield from _numbers(x)
        else:
            yield np.ravel(x).astype(float)


def _record(like: Any, values: Iterator[float]) -> Any:
    """Return a record with the next `values`."""
    parts = [_record(x, values) if isinstance(x, tuple) else
             np.array([next(values) for _ in range(x.size)]).reshape(x.shape)
             if isinstance(x, np.ndarray) else next(values) for x in like]
    return type(like)(*parts) if hasattr(like, '_fields') else tuple(parts)


def _minimal(found: Array, scale: Array, m: int) -> LinearLaw:
    """Return the part of a system that y reaches and that reaches τ, with y unscaled."""
    largest = np.abs(found).max(axis=1, keepdims=True, initial=1e-300)
    found = np.where(np.abs(found) > _ROUNDING * largest, found, 0.0)
    A, B, C, D = found[:m, :m], found[:m, m:], found[m:, :m], found[m:, m:]
    reaches = (C != 0.0).any(axis=0)
    for _ in range(m):
        reaches = reaches | (A[reaches] != 0.0).any(axis=0)
    kept = reaches & (scale[:m] > 0.0)
    return LinearLaw(A[np.ix_(kept, kept)], B[kept] / scale[m:], C[:, kept], D / scale[m:])

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
Switchings, which evaluate the term Ka sgn(v) of law (6).

The law `chattering` holds one, made from the parameters `switching` and `ka` of
`ControllerConfig`. A switching is a NamedTuple of its gains, marked by `switching`, as a law is
(`laws.base`). Its one method is `term`. Those that estimate the perturbation also have `updated`,
`advanced` and `estimate`. The memory of law (6) is theirs. z is the chattering term.

Implicit
--------
`Implicit` is the backward-Euler discretisation of Ka sgn(v). The term z is the element of
Ka Sgn(v) at the *next* sample, so that it can rest anywhere between -Ka and Ka once v is 0
(Acary & Brogliato 2010; Huber, Acary & Brogliato 2016, see docs/theory.md)::

    z ∈ Ka Sgn(v⁺),     v⁺ = b h M⁻¹ (w - z),     w = M y / (b h) - C v                     (SW1)

Where w is within ±Ka it is the solution. Otherwise joints at their bound push the others through
M⁻¹: z is the point of the box |z_i| ≤ ka_i nearest to w in the metric of M⁻¹, whatever b h.

Observer
--------
`ImplicitObserver` estimates the matched perturbation P = F(dq) - d(t), which includes errors of
the model. Over one period with the torque τ held, the filter (3) gives, exactly for its pole::

    v[k+1] = y[k] - b h M⁻¹ (N[k] - τ[k] + P[k]),     y[k] = a v[k] + (b h - c) u[k]

with u = Kv de + Kp e, N = M (ddq_d + u) + C dq + G, a = exp(-λ h), c = b (1 - a) / λ. From the
last sample's v follows the residual of the closed loop (8). The estimate follows it with a
bandwidth ω::

    r = M (y[k] - v[k+1]) / (b h) - (N[k] - τ[k]) - P̂ - ½ clipping,    P̂ += (1 - exp(-ω h)) r

With ω → ∞ the last residual is believed at once. P̂ is bounded by Ka, in the metric of M⁻¹: where
one joint's estimate meets its bound, the others' make up for it as far as the acceleration is
concerned. `clipping` is the torque that ±Ka has taken from the chattering term, where it was less
than Ka. Noise around a perturbation close to Ka is clipped on one side only. The mean of the
clipped torque must be made good, or v rests beside 0. A larger clipping error means that v is
still far from 0, and is left out.
"""

from __future__ import annotations

from math import exp
from typing import Any, NamedTuple, TypeVar

from ctc_chattering.compiled.compilable import dot, function, record, some
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.filter import design_filter, ErrorFilter
from ctc_chattering.control.laws.base import Estimator, with_defaults
from ctc_chattering.control.sample import Applied, State
from ctc_chattering.numerics.box_qp import clip, nearest
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class Perturbation(NamedTuple):
    """
    Memory of law (6).

    Attributes
    ----------
    perturbation : ndarray, shape (n,)
        P̂ [N·m].
    mass : ndarray, shape (n, n)
        M [kg·m²].
    nominal : ndarray, shape (n,)
        y [rad/s].
    torque_residual : ndarray, shape (n,)
        N - τ less the excess, with half of a small clipping error [N·m].
    known : float
        Truth of: there is a last sample.

    """

    perturbation: Array
    mass: Array
    nominal: Array
    torque_residual: Array
    known: float


T = TypeVar('T')


class Switching(Estimator):
    """Interface of a switching, with the defaults of `Estimator`."""

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> Switching:
        """Return the switching of a configuration and period [s]."""
        raise NotImplementedError

    def term(self, memory: Perturbation, state: State, compensation: Array) -> tuple[Array, Array]:
        """
        Return z within ±Ka, and its clipping error.

        Both have the shape (n,) [N·m].

        Parameters
        ----------
        memory : Perturbation
            With the estimate P̂.
        state : State
            In which the torque is applied.
        compensation : array, shape (n,)
            C v [N·m].

        """
        raise NotImplementedError


def _with_ka(switching: Any, kp: Array, kv: Array, ka: Array) -> Any:
    """Return a switching with another Ka."""
    return switching._replace(ka=ka)


def switching(kind: type[T]) -> type[T]:
    """
    Mark a switching of your own for law (6).

    It is a NamedTuple of its gains. The decorator returns the class with the methods of
    `Switching` that it lacks. It must have ``from_config`` and ``term``. A field ``ka`` is Ka, and
    follows it. The parameter ``switching`` takes the class itself, or its name
    ``package.module:Name``.

    Parameters
    ----------
    kind : type
        The class.

    """
    if 'ka' in vars(kind) and 'with_gains' not in vars(kind):
        setattr(kind, 'with_gains', _with_ka)  # noqa: B010
    return with_defaults(kind, Switching)


@switching
class Sign(NamedTuple):
    """Switching Ka sgn(v), with sgn(0) = 0."""

    #: Ka [N·m], shape (n,).
    ka: Array

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> Sign:
        """Return the switching of a configuration."""
        return cls(np.array(config.ka))

    def term(self, memory: Perturbation, state: State, compensation: Array) -> tuple[Array, Array]:
        """Return Ka sgn(v)."""
        return self.ka * np.sign(state.v), state.zero


@switching
class BoundaryLayer(NamedTuple):
    """Ka sat(v / width)."""

    #: Ka [N·m], shape (n,).
    ka: Array
    #: Half the width of the layer around v = 0 [rad/s].
    width: float

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> BoundaryLayer:
        """Return the switching of a configuration."""
        return cls(np.array(config.ka), config.boundary_layer)

    def term(self, memory: Perturbation, state: State, compensation: Array) -> tuple[Array, Array]:
        """Return Ka sat(v / width)."""
        return self.ka * clip(state.v / self.width, -1.0, 1.0), state.zero


@switching
class Implicit(NamedTuple):
    """The term by which the next v is 0."""

    #: Ka [N·m], shape (n,).
    ka: Array
    #: Filter (3), which predicts v.
    filter: ErrorFilter  # noqa: A003

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> Implicit:
        """Return the switching of a configuration."""
        return cls(np.array(config.ka), design_filter(config.lambda_, config.b, period))

    def term(self, memory: Perturbation, state: State, compensation: Array) -> tuple[Array, Array]:
        """Return z for no perturbation."""
        w = unclipped(self.filter, state, compensation)
        return nearest(state.M, w, self.ka), state.zero


@function
def unclipped(filter_: ErrorFilter, state: State, compensation: Array) -> Array:
    """Return w of (SW1), shape (n,) [N·m]."""
    y = filter_.nominal_response(state.v, state.u)
    return dot(state.M, y / filter_.scale) - compensation


@switching
class ImplicitObserver(NamedTuple):
    """The term of `Implicit` for w - P̂."""

    #: Ka [N·m], shape (n,), which bounds P̂ as well.
    ka: Array
    #: Filter (3), which predicts v.
    filter: ErrorFilter  # noqa: A003
    #: 1 - exp(-ω h).
    gain: float

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> ImplicitObserver:
        """Return the switching of a configuration."""
        return cls(np.array(config.ka), design_filter(config.lambda_, config.b, period),
                   1.0 - exp(-config.observer_bandwidth * period))

    def term(self, memory: Perturbation, state: State, compensation: Array) -> tuple[Array, Array]:
        """Return z for the estimated perturbation, and its clipping error."""
        w = unclipped(self.filter, state, compensation) - memory.perturbation
        z = nearest(state.M, w, self.ka)
        return z, w - z

    def updated(self, memory: Perturbation, now: State) -> Perturbation:
        """Return the memory with P̂ corrected by the measured v."""
        if memory.known == 0.0:
            return memory
        change = (memory.nominal - now.v) / self.filter.scale
        measured = dot(memory.mass, change) - memory.torque_residual
        residual = measured - memory.perturbation
        estimate = memory.perturbation + self.gain * residual
        perturbation = nearest(memory.mass, estimate, self.ka)
        return memory._replace(perturbation=perturbation, known=0.0)

    def advanced(self, memory: Perturbation, now: State, applied: Applied) -> Perturbation:
        """Predict the next v without perturbation and excess."""
        residual = now.N - applied.tau - applied.excess
        clipping = applied.clipping_error
        if some(clipping):
            is_small = np.abs(clipping) < self.ka
            residual = residual + np.where(is_small, 0.5 * clipping, 0.0)
        return memory._replace(
            mass=now.M,
            nominal=self.filter.nominal_response(now.v, now.u),
            torque_residual=residual,
            known=1.0)

    def estimate(self, memory: Perturbation, now: State) -> Array:
        """Return P̂."""
        return memory.perturbation

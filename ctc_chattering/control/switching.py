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
Switchings: the ways to evaluate the chattering term z of law (6), Ka sgn(v).

A switching is a NamedTuple of its gains, marked by `switching`, as a law is (`laws.base`). Its
one method is `term`. Those that estimate the perturbation have `updated`, `advanced` and
`estimate` as well; the memory of law (6) is theirs.

Implicit
--------
`Implicit` is the backward-Euler discretisation of Ka sgn(v): the term z is the element of
Ka Sgn(v) at the *next* sample, so that it can rest anywhere between -Ka and Ka once v is 0
(Acary & Brogliato 2010; Huber, Acary & Brogliato 2016; see docs/theory.md)::

    z ∈ Ka Sgn(v⁺),     v⁺ = b h M⁻¹ (w - z),     w = M y / (b h) - C v                     (SW1)

Where w is within ±Ka it is the solution. Otherwise joints at their bound push the others through
M⁻¹: z is the point of the box |z_i| ≤ ka_i nearest to w in the metric of M⁻¹, whatever b h.

Observer
--------
`ImplicitObserver` has an estimate of the matched perturbation P = F(dq) - d(t), model error
included. Over one period with the torque τ held, the filter (3) gives, exactly for its pole::

    v[k+1] = y[k] - b h M⁻¹ (N[k] - τ[k] + P[k]),     y[k] = a v[k] + (b h - c) u[k]

with u = Kv de + Kp e, N = M (ddq_d + u) + C dq + G, a = exp(-λ h), c = b (1 - a) / λ. What the
last sample's v says of P is the residual of the closed loop (8), and the estimate follows it with
a bandwidth ω::

    r = M (y[k] - v[k+1]) / (b h) - (N[k] - τ[k]) - P̂ - ½ clipping,    P̂ += (1 - exp(-ω h)) r

With ω → ∞ the last residual is believed at once. P̂ is bounded by Ka, in the metric of M⁻¹: where
one joint's estimate meets its bound, the others' make up for it as far as the acceleration is
concerned. `clipping` is the clipping error, what the bound ±Ka has taken from the chattering term,
where that was less than Ka: noise around a perturbation close to Ka is clipped on one side only,
and the mean of what is lost must be made good, or v rests beside 0. A larger clipping error means
that v is still far from 0, and is left out.
"""

from __future__ import annotations

from math import exp
from typing import NamedTuple, TypeVar

from ctc_chattering.compiled.compilable import dot, function, record, some
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.filter import design_filter, ErrorFilter
from ctc_chattering.control.laws.base import Estimator, with_defaults
from ctc_chattering.control.sample import Applied, State
from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class Perturbation(NamedTuple):
    """What has been estimated; arrays of shape (n,) unless they say otherwise."""

    #: P̂ [N·m].
    perturbation: Array
    #: Of the last sample: M [kg·m²], shape (n, n); y [rad/s]; N - τ less the excess, with half of
    #: a small clipping error [N·m]; and whether there was one, 1.0 or 0.0.
    mass: Array
    nominal: Array
    torque_residual: Array
    known: float


T = TypeVar('T')


class Switching(Estimator):
    """What a switching has; what it does not say is as in `laws.base.Law`."""

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> Switching:
        """Return the switching of a configuration, with the sample period [s]."""
        raise NotImplementedError

    def term(self, memory: Perturbation, at: State, compensation: Array) -> tuple[Array, Array]:
        """
        Return z, and what ±Ka has taken from it, each of shape (n,) [N·m]; |z| is within Ka.

        Parameters
        ----------
        memory : Perturbation
            With the estimate P̂.
        at : State
            In which the torque is applied.
        compensation : array, shape (n,)
            C v [N·m].

        """
        raise NotImplementedError


def switching(kind: type[T]) -> type[T]:
    """
    Mark a switching of your own for law (6), a NamedTuple of its gains.

    It returns the class with the methods of `Switching` that it lacks; all that it must have are
    ``from_config`` and ``term``. The parameter ``switching`` takes the class itself, or its name
    ``package.module:Name``.

    Parameters
    ----------
    kind : type
        The class.

    """
    return with_defaults(kind, Switching)


@switching
class Sign(NamedTuple):
    """Ka sgn(v), with sgn(0) = 0 as in the paper."""

    #: Ka [N·m], shape (n,).
    ka: Array

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> Sign:
        """Return the switching of a configuration."""
        return cls(np.array(config.ka))

    def with_gains(self, kp: Array, kv: Array, ka: Array) -> Sign:
        """Return the switching with another Ka."""
        return self._replace(ka=ka)

    def term(self, memory: Perturbation, at: State, compensation: Array) -> tuple[Array, Array]:
        """Return Ka sgn(v)."""
        return self.ka * np.sign(at.v), at.zero


@switching
class BoundaryLayer(NamedTuple):
    """Ka sat(v / width)."""

    #: Ka [N·m], shape (n,), and half the width of the layer around v = 0 [rad/s].
    ka: Array
    width: float

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> BoundaryLayer:
        """Return the switching of a configuration."""
        return cls(np.array(config.ka), config.boundary_layer)

    def with_gains(self, kp: Array, kv: Array, ka: Array) -> BoundaryLayer:
        """Return the switching with another Ka."""
        return self._replace(ka=ka)

    def term(self, memory: Perturbation, at: State, compensation: Array) -> tuple[Array, Array]:
        """Return Ka sat(v / width)."""
        return self.ka * np.minimum(np.maximum(at.v / self.width, -1.0), 1.0), at.zero


@switching
class Implicit(NamedTuple):
    """The term for which v vanishes at the next sample, as far as Ka allows."""

    #: Ka [N·m], shape (n,), and the filter (3), which predicts v.
    ka: Array
    filter: ErrorFilter  # noqa: A003

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> Implicit:
        """Return the switching of a configuration."""
        return cls(np.array(config.ka), design_filter(config.lambda_, config.b, period))

    def with_gains(self, kp: Array, kv: Array, ka: Array) -> Implicit:
        """Return the switching with another Ka."""
        return self._replace(ka=ka)

    def term(self, memory: Perturbation, at: State, compensation: Array) -> tuple[Array, Array]:
        """Return z for no perturbation."""
        return nearest(at.M, unclipped(self.filter, at, compensation), self.ka), at.zero


@function
def unclipped(filter_: ErrorFilter, at: State, compensation: Array) -> Array:
    """Return w of (SW1), shape (n,) [N·m]."""
    return dot(at.M, filter_.nominal_response(at.v, at.u) / filter_.scale) - compensation


@switching
class ImplicitObserver(NamedTuple):
    """The term of `Implicit` for w - P̂ in the place of w; the whole term stays within ±Ka."""

    #: Ka [N·m], shape (n,), which bounds P̂ as well; the filter (3); 1 - exp(-ω h).
    ka: Array
    filter: ErrorFilter  # noqa: A003
    gain: float

    @classmethod
    def from_config(cls, config: ControllerConfig, period: float) -> ImplicitObserver:
        """Return the switching of a configuration."""
        return cls(np.array(config.ka), design_filter(config.lambda_, config.b, period),
                   1.0 - exp(-config.observer_bandwidth * period))

    def with_gains(self, kp: Array, kv: Array, ka: Array) -> ImplicitObserver:
        """Return the switching with another Ka."""
        return self._replace(ka=ka)

    def term(self, memory: Perturbation, at: State, compensation: Array) -> tuple[Array, Array]:
        """Return z for the estimated perturbation, and its clipping error."""
        wanted = unclipped(self.filter, at, compensation) - memory.perturbation
        z = nearest(at.M, wanted, self.ka)
        return z, wanted - z

    def updated(self, memory: Perturbation, now: State) -> Perturbation:
        """Improve P̂ by what v has become."""
        if memory.known == 0.0:
            return memory
        residual = (dot(memory.mass, (memory.nominal - now.v) / self.filter.scale)
                    - memory.torque_residual - memory.perturbation)
        found = nearest(memory.mass, memory.perturbation + self.gain * residual, self.ka)
        return memory._replace(perturbation=found, known=0.0)

    def advanced(self, memory: Perturbation, now: State, applied: Applied) -> Perturbation:
        """Predict the next sample's v without a perturbation; anti-windup takes the excess out."""
        lost, torque_residual = applied.clipping_error, now.N - applied.tau - applied.excess
        if some(lost):
            torque_residual = torque_residual + np.where(np.abs(lost) < self.ka, 0.5 * lost, 0.0)
        return memory._replace(
            mass=now.M, nominal=self.filter.nominal_response(now.v, now.u),
            torque_residual=torque_residual, known=1.0)

    def estimate(self, memory: Perturbation, now: State) -> Array:
        """Return P̂."""
        return memory.perturbation

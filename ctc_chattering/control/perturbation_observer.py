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
An estimate of the matched perturbation P = F(dq) - d(t), model error included.

Over one period with the torque τ held, the filter (3) gives, exactly for its pole::

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
from typing import NamedTuple

from ctc_chattering.numerics.box_qp import nearest
from ctc_chattering.numerics.compilable import dot, record, some
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class Perturbation(NamedTuple):
    """What has been estimated; arrays of shape (n,) unless they say otherwise."""

    #: P̂ [N·m].
    perturbation: Array
    #: Of the last sample: M [kg·m²], shape (n, n); y [rad/s]; N - τ with half of a small clipping
    #: error [N·m]; and whether there was one, 1.0 or 0.0.
    mass: Array
    nominal: Array
    torque_residual: Array
    known: float


@record
class PerturbationObserver(NamedTuple):
    """Estimates the perturbation, sample by sample; made by `perturbation_observer`."""

    #: 1 - exp(-ω h).
    gain: float
    #: b h of the filter (3) [s], and Ka [N·m], shape (n,).
    scale: Array
    bound: Array

    def expect(self, last: Perturbation, mass: Array, nominal: Array, torque_residual: Array,
               clipping_error: Array) -> Perturbation:
        """
        Predict the next sample's v without a perturbation.

        Parameters
        ----------
        last : Perturbation
            What has been estimated so far.
        mass : array, shape (n, n)
            M [kg·m²].
        nominal : array, shape (n,)
            y [rad/s].
        torque_residual : array, shape (n,)
            N - τ, with the torque τ that is held from now on [N·m].
        clipping_error : array, shape (n,)
            What the bound has taken from the chattering term [N·m].

        """
        if some(clipping_error):
            shallow = np.abs(clipping_error) < self.bound
            torque_residual = torque_residual + np.where(shallow, 0.5 * clipping_error, 0.0)
        return last._replace(
            mass=mass, nominal=nominal, torque_residual=torque_residual, known=1.0)

    def improve(self, last: Perturbation, v: Array) -> Perturbation:
        """Return the estimate improved by what v, shape (n,) [rad/s], has become."""
        if last.known == 0.0:
            return last
        residual = (dot(last.mass, (last.nominal - v) / self.scale) - last.torque_residual
                    - last.perturbation)
        found = nearest(last.mass, last.perturbation + self.gain * residual, self.bound)
        return last._replace(perturbation=found, known=0.0)


def perturbation_observer(bandwidth: float, period: float, b: float, bound: Array
                          ) -> PerturbationObserver:
    """
    Return an observer.

    Parameters
    ----------
    bandwidth : float
        ω [rad/s].
    period : float
        h [s].
    b : float
        Gain of the filter (3).
    bound : array, shape (n,)
        Ka [N·m].

    """
    return PerturbationObserver(1.0 - exp(-bandwidth * period), np.full(len(bound), b * period),
                                bound)


def unperturbed(n: int) -> Perturbation:
    """Return P̂ = 0 of n joints."""
    zero = np.zeros(n)
    return Perturbation(zero, np.zeros((n, n)), zero, zero, 0.0)

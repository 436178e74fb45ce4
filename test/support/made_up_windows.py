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
"""Windows of made-up joints, without any motion that they come from."""

from __future__ import annotations

from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.identification.prior import BodyPrior
from ctc_chattering.identification.regression import Observations
from ctc_chattering.identification.regressor import BodyRegressor
from ctc_chattering.identification.windows import STRIBECK_VELOCITIES, Windows
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Prior of a model without a regressor.
NO_BODIES = BodyPrior.of(None, 0.2)


def windows(velocity: Array, model_torque: Array | None = None, weight: Array | None = None,
            bodies: Array | None = None, acceleration: Array | None = None) -> Windows:
    """
    Return windows in which joints slide one way with a constant velocity.

    Parameters
    ----------
    velocity : ndarray, shape (J, n)
        [rad/s]; a joint with 0 rests.
    model_torque, weight, bodies, acceleration : ndarray, optional
        As `Windows` has them; 0 and no bodies without.

    """
    count, n = velocity.shape
    none, direction = np.zeros((count, n)), np.sign(velocity)
    torque = none if model_torque is None else model_torque
    slow = np.exp(-np.square(velocity[..., None] / np.array(STRIBECK_VELOCITIES)))
    return Windows(
        t=np.asarray(0.025 * np.arange(count), float), centres=np.arange(count),
        model_torque=torque,
        weight=none if weight is None else weight,
        bodies=np.empty((count, n, 0)) if bodies is None else bodies,
        direction=direction, resting=1.0 - np.abs(direction), velocity=velocity,
        acceleration=none if acceleration is None else acceleration,
        stribeck=direction[..., None] * slow, load=direction * np.abs(torque))


def velocities(count: int, n: int, seed: int = 0) -> Array:
    """Return velocities that swing, shape (count, n) [rad/s]."""
    rng = np.random.default_rng(seed)
    t = 0.025 * np.arange(count)[:, None]
    sizes, phases = rng.uniform(0.3, 1.0, (2, n)), rng.uniform(0.0, 6.0, (2, n))
    return np.asarray(sizes[0] * np.sin(1.3 * t + phases[0]) + sizes[1] * np.sin(
        0.7 * t + phases[1]), float)


def arm_windows(urdf: str, joints: tuple[str, ...], count: int = 400, seed: int = 0
                ) -> tuple[Windows, BodyRegressor]:
    """Return windows of an arm in random states, of which each is constant, and its regressor."""
    model, rng = UrdfModel(urdf, joints), np.random.default_rng(seed)
    regressor = BodyRegressor.of(model)
    assert regressor is not None
    q, dq, ddq = rng.normal(size=(3, count, model.n))
    torque = np.array([model.inverse_dynamics(*rows) for rows in zip(
        q.tolist(), dq.tolist(), ddq.tolist())])
    weight = np.array([model.gravity_torque(x) for x in q.tolist()])
    bodies = np.array([regressor.torque(*rows) for rows in zip(q, dq, ddq)])
    return windows(dq, torque, weight, bodies, ddq), regressor


def observed(rows: Windows, torque: Array) -> Observations:
    """Return windows with a torque, shape (J, n) [N·m]."""
    return Observations.of(rows, torque)

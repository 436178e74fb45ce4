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

"""What a motion leaves of the torques and of the room between links."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
from typing import NamedTuple, Protocol

from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.excitation.best_motion import Quintics
from ctc_chattering.identification.excitation.collision import SelfCollision
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
import numpy as np

#: What may help where no motion keeps a limit.
ADVICE = 'choose smaller limits, a smaller position_range or another centre'
#: Part of a largest torque that is used, since it is computed in steps; the part of it, beneath
#: that, which the search enters reluctantly; and the step [s].
_TORQUE, _RELUCTANT, _TORQUE_STEP = 0.97, 0.1, 0.05
#: The same for distances, as multiples of those to be kept, and the step of the search [s].
_DISTANCE, _NEAR, _STEP = 0.05, 0.5, 0.025


class Margin(NamedTuple):
    """
    Where a motion comes nearest to a limit.

    Attributes
    ----------
    value : float
        More than 0 within the limit, 1 or more far from it.
    time : float
        When [s].
    at : callable
        The value as a function of position, velocity and acceleration there, each (n,).
    reason : str
        What limit it is, with numbers.

    """

    value: float
    time: float
    at: Callable[[Array, Array, Array], float]
    reason: str


class Limit(Protocol):
    """Something that a motion must keep, besides the bounds of each joint."""

    def margin(self, path: Quintics) -> Margin:
        """Return what a motion leaves of it."""


@dataclasses.dataclass(frozen=True)
class AssumedFriction:
    """Assumed Coulomb [N·m] and viscous [N·m·s/rad] friction, each of shape (n,)."""

    coulomb: Array
    viscous: Array

    def added(self, torque: Array, dq: Array) -> Array:
        """Return torque with friction; where a joint rests, friction acts with the torque."""
        smooth = torque + self.viscous * dq
        found: Array = smooth + self.coulomb * np.sign(np.where(dq == 0.0, smooth, dq))
        return found


@dataclasses.dataclass(frozen=True)
class TorqueLimit:
    """
    Largest torques.

    Attributes
    ----------
    names : tuple of str, length n
        Joints.
    model, friction
        Give the torque.
    effort : ndarray, shape (n,)
        Largest torques [N·m]; inf for unlimited.

    """

    names: tuple[str, ...]
    model: Model
    friction: AssumedFriction
    effort: Array

    def margin(self, path: Quintics) -> Margin:
        """Return what a motion leaves of the largest torques."""
        t = np.arange(0.0, path.times[-1] / NANOSECONDS, _TORQUE_STEP)
        torque = np.array([self._torque(*point) for point in path.at(t).transpose(1, 0, 2)])
        k, i = np.unravel_index(int((torque / self.effort).argmax()), torque.shape)

        def at(q: Array, dq: Array, ddq: Array) -> float:
            share = float(self._torque(q, dq, ddq)[i] / self.effort[i])
            return (_TORQUE - share) / _RELUCTANT
        return Margin((_TORQUE - float(torque[k, i] / self.effort[i])) / _RELUCTANT,
                      float(t[k]), at,
                      f'peak torque of {self.names[i]}: {torque[k, i]:.4g} is not allowed; '
                      f'at most {self.effort[i]:g} N*m, its effort limit: {ADVICE}')

    def _torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the magnitudes of torques with friction, shape (n,) [N·m]."""
        return np.abs(self.friction.added(
            np.array(self.model.inverse_dynamics(q.tolist(), dq.tolist(), ddq.tolist())), dq))


@dataclasses.dataclass(frozen=True)
class DistanceLimit:
    """
    Distances between links.

    Attributes
    ----------
    links : SelfCollision
        Gives them.

    """

    links: SelfCollision

    def margin(self, path: Quintics) -> Margin:
        """Return what a motion leaves of the distances to be kept."""
        t = np.arange(0.0, path.times[-1] / NANOSECONDS, _STEP)
        near = self.links.nearest(path.at(t)[0], _DISTANCE + _NEAR)

        def at(q: Array, _dq: Array, _ddq: Array) -> float:
            return (self.links.spare(near.pair, q) - _DISTANCE) / _NEAR
        return Margin((near.spare - _DISTANCE) / _NEAR, float(t[near.sample]), at,
                      'the motion is refused; nearest approach of two links: '
                      + self.links.text(near, float(t[near.sample])) + f' is needed: {ADVICE}')

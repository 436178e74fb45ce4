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
Friction of your own: a fall from rest like 1 / (1 + |dq| / v_s), in the place of Stribeck's.

In the parameter file, with this folder on PYTHONPATH::

    plant:
      ros__parameters: {friction_model: 'own_friction:Hyperbolic', coulomb_friction: [12.0, 12.0]}

``coulomb_friction`` is what holds a joint at rest; here a sliding joint loses up to 3 N·m of it.
`each` calls a function of numbers joint by joint; marked, all this runs compiled as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ctc_chattering.numerics.compilable import each, function, record

Vector = Sequence[float]


@function
def fallen(velocity: float, mode: float, fall: float, speed: float) -> float:
    """Return the friction of one joint less that near rest [N·m]."""
    return -mode * fall * abs(velocity) / (abs(velocity) + speed)


@record
class Hyperbolic(NamedTuple):
    """Parameters, joint by joint."""

    #: What is lost at high velocity [N·m]; velocity at which half of it is lost [rad/s].
    fall: Vector
    speed: Vector

    @classmethod
    def made(cls, joint_names: Sequence[str]) -> Hyperbolic:
        """Return the friction of a robot with these joints."""
        return cls([3.0] * len(joint_names), [0.05] * len(joint_names))

    def resistance(self, velocity: Vector, _load: Vector, mode: Vector) -> Vector:
        """Return friction beyond that of the parameters; see `NoFriction.resistance`."""
        return each(fallen, velocity, mode, self.fall, self.speed)

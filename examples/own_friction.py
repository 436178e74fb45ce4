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
Arrays are arrays of shape (n,); marked, all this runs compiled as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ctc_chattering.compiled.compilable import record
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@record
class Hyperbolic(NamedTuple):
    """Parameters, joint by joint."""

    #: What is lost at high velocity [N·m]; velocity at which half of it is lost [rad/s].
    fall: Array
    speed: Array

    @classmethod
    def for_joints(cls, joint_names: Sequence[str]) -> Hyperbolic:
        """Return the friction of a robot with these joints."""
        return cls(np.full(len(joint_names), 3.0), np.full(len(joint_names), 0.05))

    def resistance(self, velocity: Array, _load: Array, mode: Array) -> Array:
        """Return friction beyond that of the parameters; see `NoFriction.resistance`."""
        return -mode * self.fall * np.abs(velocity) / (np.abs(velocity) + self.speed)

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
Coordinates of the simulated robot.

They are its joints or, with elastic joints, links and motors. `plant.py` chooses one of two
records for a robot. It brings values of the joints onto the coordinates of `motion.py`, and
coordinates to what the encoders show.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import record
from ctc_chattering.dynamics.elastic_model import Elastic
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np


@record
class RigidJoints(NamedTuple):
    """Joints that are the coordinates, as in all compiled code."""

    rigid: bool = True

    def on_motors(self, x: Array) -> Array:
        """Return values of the joints as those of the motors."""
        return x

    def on_links(self, x: Array) -> Array:
        """Return values of the joints as those of the links."""
        return x

    def seen(self, x: Array) -> Array:
        """Return the values that the encoders see, shape (n,)."""
        return x


class ElasticJoints:
    """
    Joints with motors that are coordinates, as `RigidJoints`.

    Parameters
    ----------
    model : Elastic
        Links and motors.
    encoder_side : str
        Side that the encoders see, ``motor`` or ``link``.

    """

    def __init__(self, model: Elastic, encoder_side: str) -> None:
        self._zero = np.zeros(model.n)
        self._motors = model.motors
        # Links come before motors.
        self._seen: Any = model.motors if encoder_side == 'motor' else slice(len(model.motors))

    def on_motors(self, x: Array) -> Array:
        """Return values of the joints as those of the motors, else 0."""
        values: Array = self._zero.copy()
        values[self._motors] = x
        return values

    def on_links(self, x: Array) -> Array:
        """Return values of the joints as those of the links, else 0."""
        return np.concatenate((x, self._zero[len(x):]))

    def seen(self, x: Array) -> Array:
        """Return the values that the encoders see, shape (n,)."""
        values: Array = x[self._seen]
        return values

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

"""A robot with a fault, and how it is recorded."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses

from ctc_chattering.bags.recording import Recording
from ctc_chattering.trajectory.motions import Route
from faulty_robots import Faulty
import numpy as np
from rigid_bodies import Array

Rng = np.random.Generator


@dataclasses.dataclass(frozen=True)
class Case:
    """
    A robot with a fault, and how it is recorded.

    Attributes
    ----------
    robot : Faulty
        The truth.
    effort : str
        What the states have: none, motor, or link.
    alter : callable, optional
        What the recorder makes of the recording.
    bag : bool
        Whether it must go through a bag with receive jitter.
    slower : callable, optional
        What the lab makes of the usual motion.
    believed : str
        The arm whose description the user gives, if it is another one.
    own_delay : ndarray, shape (n,)
        Samples by which commands of a joint act later than those of the others.
    band : ndarray, shape (n,)
        Torque that each drive takes of its command [N·m].

    """

    robot: Faulty
    effort: str = 'none'
    alter: Callable[[Recording], Recording] | None = None
    bag: bool = False
    slower: Callable[[Route], Route] | None = None
    believed: str = ''
    own_delay: Array | float = 0.0
    band: Array | float = 0.0


Made = Callable[[Faulty, Rng, float], Faulty | Case]

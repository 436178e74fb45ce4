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

"""Sinusoids of one joint for hypothesis, their extremes, and samples of motions."""

from __future__ import annotations

import math

from ctc_chattering.trajectory.reference import ReferenceConfig
from ctc_chattering.trajectory.transitions import TimedMotion
from hypothesis import strategies as st
import numpy as np
import numpy.typing as npt

S = 1_000_000_000
positions = st.floats(-5.0, 5.0)
velocities = st.floats(-3.0, 3.0)
instants = st.integers(-10 * S, 1000 * S)
sinusoids = st.builds(
    ReferenceConfig, joint_names=st.just(('a',)), center=st.tuples(positions),
    amplitude=st.tuples(st.floats(-2.0, 2.0)), frequency=st.tuples(st.floats(0.0, 3.0)),
    phase=st.tuples(st.floats(-4.0, 4.0)))


def sample(motion: TimedMotion, t0: int, t1: int, count: int = 400) -> npt.NDArray[np.float64]:
    """Return what a motion does: shape (count, 3, n)."""
    return np.array([motion.at(t0 + (t1 - t0) * k // (count - 1)) for k in range(count)])


def ranges(config: ReferenceConfig) -> tuple[float, float, float, float]:
    """Return centre, amplitude, greatest velocity and acceleration of the one joint."""
    w = 2 * math.pi * config.frequency[0]
    a = abs(config.amplitude[0])
    return config.center[0], a, w * a, w * w * a

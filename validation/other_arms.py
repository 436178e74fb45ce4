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

"""Robots of the study of faults that are not in its table: of descriptions, and drawn."""

from __future__ import annotations

import numpy as np
import urdfs

#: Names of descriptions, joints, centres of the motion [rad], and Coulomb friction [N·m].
DESCRIBED = {
    'xarm7': ('xarm7', tuple(f'joint{i}' for i in range(1, 8)),
              (0.0, -0.3, 0.0, 1.2, 0.0, 1.0, 0.0), (2.0, 2.0, 1.5, 1.5, 0.8, 0.8, 0.3)),
    'ur10': ('ur10_robot', urdfs.UR5, (0.0, -1.0, 1.0, -1.0, -1.5, 0.0),
             (10.0, 10.0, 6.0, 2.0, 2.0, 0.8)),
    'z1': ('z1', tuple(f'joint{i}' for i in range(1, 7)), (0.0, 1.4, -1.4, 0.0, 0.0, 0.0),
           (1.5, 2.0, 1.5, 0.8, 0.5, 0.4)),
}


def drawn(seed: int) -> str:
    """Return an arm of three joints `j0` to `j2`, one perhaps prismatic, drawn at random."""
    rng = np.random.default_rng((seed, 6))
    slides = int(rng.integers(6))
    parts = [urdfs.link('base')]
    for i in range(3):
        axis = rng.normal(size=3) if rng.random() < 0.5 else np.eye(3)[rng.integers(3)]
        axis /= np.linalg.norm(axis)
        mass, length = rng.uniform(0.8, 4.0), rng.uniform(0.2, 0.5)
        inertia = mass * length ** 2 * rng.uniform(0.08, 0.12, 3)
        centre = rng.uniform(-0.4, 0.4, 3) * length
        parts += [urdfs.link(f'l{i}', mass, tuple(centre), tuple(inertia)), urdfs.joint(
            f'j{i}', 'prismatic' if i == slides else 'revolute', f'l{i - 1}' if i else 'base',
            f'l{i}', ' '.join(map(str, axis)),
            ' '.join(map(str, rng.uniform(-0.5, 0.5, 3) * length * 2.0)),
            '<limit lower="-3" upper="3" effort="300" velocity="2.5"/>')]
    return urdfs.urdf(parts)

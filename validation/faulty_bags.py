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

"""Bags of the independent plant as real recorders make them: shuffled, late, with losses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ctc_chattering.bags.recording import Recording
from motion_bags import messages_of, write
import numpy as np
from rosbags.rosbag2 import StoragePlugin


def bag_of(path: Path, recording: Recording, seed: int, urdf: str = '', loss: float = 0.0
           ) -> Path:
    """
    Write a recording into a bag, MCAP or sqlite3 by the seed, and return its path.

    Joints of the states are shuffled. Messages arrive up to a third of a period late, one in five
    hundred two periods late, each topic in order; a part `loss` of them does not arrive.
    """
    rng = np.random.default_rng((seed, 5))
    n = len(recording.joints)
    sent = messages_of(recording.t, recording.joints, recording.q, recording.dq, recording.effort,
                       recording.command, order=rng.permutation(n).tolist(), labels=False,
                       urdf=urdf)
    period = 1e9 * recording.period
    late = period * (0.3 * rng.random(len(sent)) + 2.0 * (rng.random(len(sent)) < 0.002))
    latest: dict[str, int] = {}
    arrived: list[tuple[str, int, Any]] = []
    for (topic, t, message), more, lost in zip(sent, late, rng.random(len(sent)) < loss):
        if t and lost:
            continue
        latest[topic] = max(t + int(more), latest.get(topic, 0) + 1)
        arrived.append((topic, latest[topic], message))
    arrived.sort(key=lambda x: x[1])
    return write(path, arrived, (StoragePlugin.MCAP, StoragePlugin.SQLITE3)[seed % 2])

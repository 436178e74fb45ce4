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

"""The recorded reference at many instants is that of the controller's buffer at each of them."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

from bags import Entry, write_bag
from ctc_chattering.bags.recorded_reference import read_reference, RecordedReference
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.trajectory.buffer import Trajectory
from motion_bags import point, trajectory
import numpy as np

NAMES = ['a', 'b', 'c']
START = 1_700_000_000_000_000_123


def chunk(first: int, steps: list[int], rng: np.random.Generator, names: list[str] = NAMES) -> Any:
    """Return a chunk of points at increasing instants after `first` [ns]."""
    after = np.cumsum(steps)
    return trajectory(START + first, names, [
        point(int(t), *rng.normal(size=(3, len(names)))) for t in after])


def read(path: Path, chunks: list[Any]) -> RecordedReference:
    write_bag(path, [Entry('/reference', k, x) for k, x in enumerate(chunks)])
    with closing(open_bag(path)) as bag:
        return read_reference(bag, ('c', 'a'))


def test_points_and_between_to_the_last_bit(tmp_path: Path) -> None:
    """Check chunks that replace parts of others, of several lengths, and some that are refused."""
    rng = np.random.default_rng(8)
    firsts = [0, 900, 1500, 1400, 400, 5000, 5003]
    chunks = [chunk(first, rng.integers(1, 400, 5 + 3 * (k % 3)).tolist(), rng)
              for k, first in enumerate(firsts)]
    expected = Trajectory()
    for message in chunks:
        times = [START + first + x.time_from_start.nanosec for first, x in zip(
            [message.header.stamp.nanosec - 123] * 99, message.points)]
        expected.extend(times, [
            tuple(getattr(x, name)[[2, 0]].tolist()
                  for name in ('positions', 'velocities', 'accelerations'))
            for x in message.points])
    broken = chunk(2000, [3, 3, 3], rng)
    broken.points[1].velocities[0] = np.nan
    refused = [broken, chunk(0, [5, 0, 5], rng), chunk(0, [1, 2], rng, ['a', 'b']),
               trajectory(START, NAMES, [])]
    reference = read(tmp_path / 'bag', [refused[0], *chunks[:3], *refused, *chunks[3:]])
    start = reference.start
    assert start == START + chunks[0].points[0].time_from_start.nanosec
    last = int(reference.t[-1])
    instants = np.unique(np.r_[reference.t, rng.integers(start, last, 500), last + 1, last + 900])
    found = reference.at(instants)
    for t, rows in zip(instants.tolist(), found):
        assert np.array(expected.at(t)).tobytes() == rows.tobytes(), t
    assert (found[-1, 1:] == 0.0).all()


def test_without_a_reference(tmp_path: Path) -> None:
    write_bag(tmp_path / 'bag', [Entry('/reference', 0, trajectory(0, ['other'], []))])
    reference = read(tmp_path / 'none', [trajectory(START, ['other'], [])])
    assert (len(reference.t), reference.points.shape, reference.start) == (0, (0, 3, 2), 0)

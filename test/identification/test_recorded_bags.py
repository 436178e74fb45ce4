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

"""Bags as users have them: with lost messages, of other storage, with another publisher."""

from __future__ import annotations

from functools import cache
from pathlib import Path
import shutil
from typing import Any

from ctc_chattering.identification.bag_motion import read_motion
from ctc_chattering.identification.findings import Reason, Severity
from ctc_chattering.identification.identified_robot import identify
from ctc_chattering.identification.recording import RecordingFault
from ctc_chattering.identification.results import IdentificationResults
from identified_bags import short
from identified_robots import Recorded
from motion_bags import joint_state, messages_of, S, write
import numpy as np
import pytest
from refusals import refused
from rosbags.rosbag2 import StoragePlugin
import yaml

Messages = list[tuple[str, int, Any]]


@cache
def made() -> Recorded:
    return short(1, 10.0)


def messages() -> Messages:
    x = made().recording
    return messages_of(x.t, x.joints, x.q, x.dq, x.effort, x.command)


def identified(bag: Path) -> IdentificationResults:
    return identify([read_motion(bag, model='two_link')], 'two_link').results


def check_friction(found: IdentificationResults) -> None:
    """Coulomb friction within 0.1 %, and within its interval."""
    for friction, coulomb in zip(found.found.friction, made().plant.coulomb_friction):
        assert friction.coulomb.value == pytest.approx(coulomb, rel=1e-3)
        assert friction.coulomb.value == pytest.approx(
            coulomb, abs=friction.coulomb.half + 1e-4 * coulomb)


def losing(path: Path, count: int, burst: int) -> Path:
    """Write a bag as our recorder does on a busy computer, which counts what it loses."""
    rng, lost = np.random.default_rng(1), set[int]()
    sent = messages()
    while len(lost) < count:
        first = int(rng.integers(len(sent) - burst))
        lost.update(range(first, first + int(rng.integers(1, burst + 1))))
    # It logs by the stamp of the last state that it received.
    kept = [(topic, t // 1_000_000 * 1_000_000, message)
            for k, (topic, t, message) in enumerate(sent) if k not in lost]
    bag = write(path, kept)
    counts: dict[str, int] = {}
    for k in lost:
        counts[sent[k][0]] = counts.get(sent[k][0], 0) + 1
    metadata = yaml.safe_load((bag / 'metadata.yaml').read_text())
    metadata['rosbag2_bagfile_information']['custom_data'] = {'dropped': str(counts)}
    (bag / 'metadata.yaml').write_text(yaml.safe_dump(metadata))
    return bag


@pytest.mark.parametrize(('count', 'burst', 'severity'), [
    (3, 1, Severity.NOTE), (1000, 100, Severity.CARE),
    pytest.param(160, 20, Severity.CARE, marks=pytest.mark.slow)])
def test_lost_messages_are_the_first_reason_and_cost_no_accuracy(
        tmp_path: Path, count: int, burst: int, severity: Severity) -> None:
    found = identified(losing(tmp_path / 'bag', count, burst))
    check_friction(found)
    for verdict in found.verdicts:
        first = verdict.findings[0]
        assert (first.reason, first.severity) == (Reason.DROPPED, severity)
        assert verdict.severity == severity


@pytest.mark.parametrize('storage', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize('in_folder', [True, False])
def test_the_file_alone_is_enough(tmp_path: Path, storage: StoragePlugin, in_folder: bool) -> None:
    """Bags come without metadata.yaml, too."""
    bag = write(tmp_path / 'bag', messages()[:4000], storage)
    (file,) = [x for x in bag.iterdir() if x.suffix != '.yaml']
    alone = tmp_path / 'alone'
    alone.mkdir()
    copy = Path(shutil.copy(file, alone))
    motion = read_motion(alone if in_folder else copy, model='two_link')
    assert np.array_equal(motion.recording.q, read_motion(bag, model='two_link').recording.q)


def test_another_publisher_of_joint_states_is_named(tmp_path: Path) -> None:
    others = []
    for k in range(100):
        t = S + k * S // 10 + 333_333
        others.append(('/joint_states', t, joint_state(
            t, made().recording.joints, np.zeros(2), None, None)))
    bag = write(tmp_path / 'bag', sorted(messages() + others, key=lambda sent: sent[1]))
    with refused(RecordingFault.SOURCES):
        identified(bag)

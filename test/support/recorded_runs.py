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

"""Runs that were recorded, and what they are compared by."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.result import Result
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.configuration.topics import DIAGNOSTICS
from ctc_chattering.simulation.closed_loop import Run
from processes import run_bringup
import yaml

FIELDS = ('t', 'q', 'dq', 'q_d', 'dq_d', 'ddq_d', 'tau', 'v')


def record(bag: Path, *arguments: str) -> Result:
    status, output = run_bringup('--record', str(bag), *arguments)
    assert status == 0, output
    return read_bag(bag)


def assert_equal(one: Run, other: Run, but: Sequence[str] = (), part: Any = slice(None)) -> None:
    """Check that two runs are equal to the last bit, the second in some samples."""
    for field in FIELDS:
        if field not in but:
            x, y = getattr(one, field), getattr(other, field)[part]
            assert x.shape == y.shape and x.tobytes() == y.tobytes(), field


def metadata(bag: Path) -> dict[str, Any]:
    text = (bag / 'metadata.yaml').read_text(encoding='utf-8')
    result: dict[str, Any] = yaml.safe_load(text)['rosbag2_bagfile_information']
    return result


def counts(bag: Path) -> dict[str, int]:
    """Return how many messages each topic has."""
    return {x['topic_metadata']['name']: x['message_count']
            for x in metadata(bag)['topics_with_message_count']}


def reports_of(bag: Path, node: str) -> list[dict[str, str]]:
    """Return what a node said in the diagnostics that a bag holds."""
    with closing(open_bag(bag)) as reader:
        return [{x.key: x.value for x in status.values}
                for _, message in reader.read(reader.named(DIAGNOSTICS))
                for status in message.status if status.name == f'/{node}']

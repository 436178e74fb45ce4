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
How a node spins: in lockstep by one call, since each call of EventsExecutor loses an object.

In 50,000 calls of `spin_until_future_complete` these are 50,000 allocated blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
import signal
import sys
from typing import Any

from ctc_chattering.ros.node import BaseNode
from ctc_chattering.ros.process import PROFILE_VARIABLES
from ctc_chattering.ros.spinning import spin_until_stopped
from domains import own_domain
from processes import CONFIG
import pytest
import rclpy

pytestmark = pytest.mark.ros


class Turning(BaseNode):
    """A node that counts its spins and turns, and does something in one of them."""

    def __init__(self) -> None:
        super().__init__('turning')
        self.spins = self.turns = 0
        self.at_turn: dict[int, Callable[[], object]] = {}
        self.quiet = False

    def spin(self, executor: Any) -> None:
        self.spins += 1
        super().spin(executor)

    def report(self, now: int) -> None:
        if not self.quiet:
            super().report(now)

    def idle(self) -> None:
        self.turns += 1
        self.at_turn.get(self.turns, lambda: None)()


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Iterator[Turning]:
    """Return a node of this process, with the profile that all nodes have."""
    for name in PROFILE_VARIABLES:
        monkeypatch.setenv(name, str(CONFIG / 'fastdds.xml'))
    with own_domain():
        rclpy.init()
        it = Turning()
        try:
            yield it
        finally:
            it.destroy_node()
            rclpy.try_shutdown()


def test_a_node_in_lockstep_spins_once_and_turns_meanwhile(node: Turning) -> None:
    node.lockstep = True
    node.at_turn[30] = lambda: node.done.set_result(None)
    spin_until_stopped(node)
    assert (node.spins, node.turns) == (1, 31)


def test_a_signal_ends_the_spin(node: Turning) -> None:
    node.lockstep = True
    node.stop = stop = list[int]()
    node.at_turn[3] = lambda: stop.append(signal.SIGTERM)
    spin_until_stopped(node)
    assert (node.spins, node.turns) == (1, 4)


def test_a_node_that_is_in_lockstep_no_more_spins_by_its_tick(node: Turning) -> None:
    node.lockstep = True
    node.at_turn[3] = lambda: setattr(node, 'lockstep', False)
    node.at_turn[9] = lambda: node.done.set_result(None)
    spin_until_stopped(node)
    assert (node.spins, node.turns) == (6, 9)


def test_a_node_in_lockstep_keeps_what_it_has_allocated(node: Turning) -> None:
    """
    Check three times 20 turns; by a spin for each there would be 20 blocks more each time.

    What is allocated once, about 30 blocks, is in one of them.
    """
    blocks = list[int]()
    node.lockstep = node.quiet = True
    for turn in (20, 40, 60, 80):
        node.at_turn[turn] = lambda: blocks.append(sys.getallocatedblocks())
    node.at_turn[81] = lambda: node.done.set_result(None)
    spin_until_stopped(node)
    assert min(after - before for before, after in pairwise(blocks)) < 10

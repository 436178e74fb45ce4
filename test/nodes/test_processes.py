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

"""Processes that end, are stopped or killed, and start again."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import random
import signal
import threading
import time

from ctc_chattering.launch import child_process
from faults import Diagnostics, KINDS, load, WARN
from processes import interrupt, PATIENCE, Probe, probe, wait_for
import pytest
from ros_messages import COMMANDS, ns
from sensor_msgs.msg import JointState

pytestmark = pytest.mark.ros


@pytest.mark.slow
def test_killed_nodes_started_again_heal_the_graph() -> None:
    """Without the controller simulated time stands still, and the plant says what it waits for."""
    arguments = {'controller': (), 'reference': (), 'plant': ('-p', 'pacing:=lockstep')}
    with probe() as it:
        diagnostics = Diagnostics(it)
        states = it.listen(JointState, 'joint_states')
        children = {name: it.start(name, *more) for name, more in arguments.items()}

        def moved() -> bool:
            """Return whether the last states were driven by torques, over 0.2 s."""
            return len([m for m in states[-2000:] if any(m.effort)]) > 200

        it.until(moved, 'motion')
        for victim in arguments:
            children[victim].process.send_signal(signal.SIGKILL)
            children[victim].process.wait(PATIENCE)
            if victim == 'controller':
                report = diagnostics.until(
                    'plant', lambda r: f'waiting for the answer on {COMMANDS}' in r.message,
                    'what it waits for')
                assert report.level == WARN
            diagnostics.next('controller' if victim == 'plant' else 'plant')
            before = 0 if victim == 'plant' else ns(states[-1].header.stamp) + 500_000_000
            states.clear()
            children[victim] = it.start(victim, *arguments[victim])
            it.until(lambda before=before: states and moved()  # type: ignore[misc]
                     and ns(states[-1].header.stamp) > before, f'recovery of {victim}')
            assert all(child.status is None for child in children.values())
        assert diagnostics.until('plant', lambda r: 'running' in r.message, 'health')
        assert not any('Traceback' in line for line in it.lines)


NUMBERS = (signal.SIGINT, signal.SIGTERM)
#: What is promised [s].
SOON = 1.0


def start(it: Probe, bag: Path, pacing: str = 'lockstep') -> list[child_process.Child]:
    return [it.start('recorder', '-p', f'bag:={bag}'), it.start('controller'),
            it.start('plant', '-p', f'pacing:={pacing}'), it.start('reference')]


def assert_all_end(it: Probe, dice: random.Random, within: float = 0.0) -> None:
    """End one process after the other, in any order and at moments of some time [s], soon."""
    begin = time.monotonic()
    moments = sorted(dice.uniform(0.0, within) for _ in it.children)
    for child, moment in zip(dice.sample(it.children, len(it.children)), moments):
        time.sleep(max(0.0, begin + moment - time.monotonic()))
        assert interrupt(child, *dice.choices(NUMBERS, k=dice.randint(1, 2))) < SOON, child.name
        assert child.status == 0, child.exit_report()
    assert [x for x in it.lines if 'Traceback' in x or 'Error' in x or 'xception' in x] == []


@pytest.mark.slow
@pytest.mark.parametrize('pacing', ['lockstep', 'real_time'])
def test_a_running_graph_ends_soon_on_a_loaded_machine(pacing: str, tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    with probe() as it:
        states = it.listen(JointState, 'joint_states')
        start(it, bag, pacing)
        it.until(lambda: (bag / 'bag_0.mcap').exists() and any(
            any(m.effort) for m in states[-1:]), 'motion')
        with load():
            assert_all_end(it, random.Random(pacing))
    assert (bag / 'metadata.yaml').exists()


@contextmanager
def flood(it: Probe) -> Iterator[None]:
    """Send messages of all kinds as fast as it goes."""
    publishers = [(it.node.create_publisher(kind.type, topic, 10), kind.valid)
                  for topic, kind in KINDS.items()]
    stop = threading.Event()

    def send() -> None:
        while not stop.is_set():
            for publisher, data in publishers:
                publisher.publish(data)

    thread = threading.Thread(target=send)
    it.until(lambda: all(p.get_subscription_count() for p, _ in publishers), 'the readers')
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@pytest.mark.slow
def test_nodes_end_soon_in_a_flood_of_messages(tmp_path: Path) -> None:
    """In lockstep: there a spin does not come back while there are messages."""
    with probe() as it:
        start(it, tmp_path / 'bag')
        with flood(it):
            assert_all_end(it, random.Random('lockstep'))


def takes_signals(child: child_process.Child) -> bool:
    """Return whether it has its own handlers, the interpreter being up."""
    lines = Path(f'/proc/{child.process.pid}/status').read_text().splitlines()
    caught = int(next(x for x in lines if x.startswith('SigCgt:')).split()[1], 16)
    return all(caught >> (number - 1) & 1 for number in NUMBERS)


@pytest.mark.slow
@pytest.mark.parametrize('round_', range(3))
def test_nodes_end_soon_at_any_moment_of_their_start(round_: int, tmp_path: Path) -> None:
    """All start at once, which keeps the machine busy, and each is stopped at a random moment."""
    with probe() as it:
        children = start(it, tmp_path / 'bag')
        wait_for(lambda: all(map(takes_signals, children)), 'their handlers')
        assert_all_end(it, random.Random(round_), 1.5)

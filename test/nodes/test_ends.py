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
SIGINT and SIGTERM end every process within a second, whatever it is doing.

A second of its own: what others on the machine take away from it is not counted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
import random
import signal
import threading
import time

from ctc_chattering.launch import child_process
from ctc_chattering.ros.topics import JOINT_STATES
from faults import KINDS, load, nodes_of
from processes import alive, bringup, CONFIG, PATIENCE, Probe, probe, Stopwatch, wait_for
import pytest
from sensor_msgs.msg import JointState

pytestmark = pytest.mark.ros
NODES = ('recorder', 'plant', 'controller', 'reference')
NUMBERS = (signal.SIGINT, signal.SIGTERM)
#: What is promised [s].
SOON = 1.0


def start(it: Probe, name: str, bag: Path, pacing: str = 'lockstep') -> child_process.Child:
    return it.start(name, *{'plant': ('-p', f'pacing:={pacing}'),
                            'recorder': ('-p', f'bag:={bag}')}.get(name, ()))


def moving(it: Probe) -> None:
    """Wait until torques drive the plant."""
    states: list[JointState] = []
    ear = it.node.create_subscription(JointState, JOINT_STATES, states.append, 10)
    it.until(lambda: sum(any(m.effort) for m in states) > 50, 'motion')
    it.node.destroy_subscription(ear)


def end(children: Sequence[child_process.Child], *numbers: int) -> None:
    """Send each the signals in quick succession; all must end soon, with status 0."""
    watches = {child.name: Stopwatch(child.process.pid) for child in children}
    for number in numbers:
        for child in children:
            child.signal(number)
    took: dict[str, float] = {}

    def ended() -> bool:
        for child in children:
            if child.status is None:
                took[child.name] = watches[child.name].read()
        return all(child.status is not None for child in children)

    wait_for(ended, 'the end')
    assert all(x < SOON for x in took.values()), took
    for child in children:
        assert child.status == 0, child.exit_report()


def nothing_raised(it: Probe) -> None:
    assert [x for x in it.lines if 'Traceback' in x or 'Error' in x or 'xception' in x] == []


@pytest.mark.slow
@pytest.mark.parametrize(('pacing', 'together'), [('lockstep', False), ('real_time', True)])
def test_a_running_graph_ends_soon_on_a_loaded_machine(
        pacing: str, together: bool, tmp_path: Path) -> None:
    """In any order while messages flow at the full rate, or all at once and asked twice."""
    dice = random.Random(f'{pacing} {together}')
    with probe() as it:
        children = [start(it, name, tmp_path / 'bag', pacing) for name in NODES]
        it.until(lambda: (tmp_path / 'bag' / 'bag_0.mcap').exists(), 'the recorder')
        moving(it)
        with load():
            if together:
                end(children, *dice.sample(NUMBERS, 2))
            else:
                for child in dice.sample(children, len(children)):
                    end([child], dice.choice(NUMBERS))
        nothing_raised(it)
        assert (tmp_path / 'bag' / 'metadata.yaml').exists()


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


def test_nodes_end_soon_in_a_flood_of_messages(tmp_path: Path) -> None:
    """In lockstep: there a spin does not come back while there are messages."""
    dice = random.Random('lockstep')
    with probe() as it:
        children = [start(it, name, tmp_path / 'bag') for name in NODES]
        with flood(it):
            for child in dice.sample(children, len(children)):
                end([child], dice.choice(NUMBERS))
        nothing_raised(it)


def takes_signals(child: child_process.Child) -> bool:
    """Return whether it has its own handlers, the interpreter being up."""
    lines = Path(f'/proc/{child.process.pid}/status').read_text().splitlines()
    caught = int(next(x for x in lines if x.startswith('SigCgt:')).split()[1], 16)
    return all(caught >> (number - 1) & 1 for number in NUMBERS)


@pytest.mark.slow
@pytest.mark.parametrize('round_', range(3))
def test_nodes_end_soon_at_any_moment_of_their_start(round_: int, tmp_path: Path) -> None:
    """All start at once, which keeps the machine busy, and each is stopped at a random moment."""
    dice = random.Random(round_)
    with probe() as it:
        children = [start(it, name, tmp_path / 'bag') for name in NODES]
        for child in children:
            wait_for(lambda child=child: takes_signals(child), 'its handlers')  # type: ignore
        begin = time.monotonic()
        moments = sorted(dice.uniform(0.0, 1.5) for _ in children)
        for child, moment in zip(dice.sample(children, len(children)), moments):
            time.sleep(max(0.0, begin + moment - time.monotonic()))
            end([child], *dice.choices(NUMBERS, k=dice.randint(1, 2)))
        nothing_raised(it)


@pytest.mark.slow
def test_bringup_ends_soon_on_a_loaded_machine(tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    with bringup('--params-file', str(CONFIG / 'friction.yaml'), '--duration', '0',
                 '--record', str(bag)) as process:
        wait_for(lambda: (bag / 'bag_0.mcap').exists()
                 and (bag / 'bag_0.mcap').stat().st_size > 20_000, 'a part of the bag')
        pids = nodes_of(process.pid)
        assert set(pids) == set(NODES)
        with load():
            watch = Stopwatch(process.pid, *pids.values())
            process.send_signal(signal.SIGTERM)
            process.send_signal(signal.SIGTERM)
            took = watch.end(process)
            output, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, output
    assert 'Traceback' not in output
    assert alive(list(pids.values())) == []
    assert (bag / 'metadata.yaml').exists()
    assert took < 3 * SOON  # First the loop, then the recorder, then itself.

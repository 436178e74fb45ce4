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

"""A computer that is too busy: processes of the real-time loop are stopped at random."""

from __future__ import annotations

import random
import signal
import time

from faults import Diagnostics, ERROR
from processes import CONFIG, Probe, probe
import pytest
from sensor_msgs.msg import JointState

pytestmark = pytest.mark.ros
STOPS, LONGEST, BETWEEN = 60, 0.1, 0.005
#: Largest speed that a stopped loop may leave behind [rad/s]; by default gains and limits it stays
#: below 8, and exceeds 100 where a torque is held for 0.1 s.
SPEED = 30.0


def start(it: Probe) -> None:
    """Start the paper's first experiment in real time."""
    file = ('--params-file', str(CONFIG / 'friction.yaml'))
    it.start('controller', *file)
    it.start('reference', *file)
    it.start('plant', *file, '-p', 'plant:pacing:=real_time', '-p',
             'plant:duration:=0.0')


def stop_at_random(it: Probe, seed: int = 1) -> int:
    """Stop plant or controller again and again; return how often, until one of them ends."""
    dice = random.Random(seed)
    victims = [child for child in it.children if child.name != 'reference']
    for count in range(STOPS):
        victim = dice.choice(victims)
        if any(child.status is not None for child in it.children):
            return count
        victim.signal(signal.SIGSTOP)
        until = time.monotonic() + dice.uniform(0.0, LONGEST)
        while time.monotonic() < until:
            it.executor.spin_once(timeout_sec=max(0.0, until - time.monotonic()))
        victim.signal(signal.SIGCONT)
        time.sleep(BETWEEN)
    return STOPS


@pytest.mark.slow
def test_the_motion_stays_bounded_and_recovers() -> None:
    """
    Check the motion, and what both nodes say of it.

    With a command_timeout of 0.1 s and drives without limits the plant ends after one or two
    seconds of this: its motion diverged.
    """
    with probe() as it:
        reports = Diagnostics(it)
        tracking = it.listen(JointState, 'controller/tracking', 10_000)

        def follows() -> bool:
            """Return whether the error has been small for the last 100 samples."""
            return len(tracking) >= 10 and all(
                max(map(abs, m.position[2:])) < 0.05 for m in tracking[-10:])

        start(it)
        it.until(follows, 'the motion')
        tracking.clear()
        assert stop_at_random(it) == STOPS
        level = {node: reports.next(node) for node in ('plant', 'controller')}
        for node, report in level.items():
            assert report.level == ERROR, (node, report)
            assert 'too busy, or processes are stopped' in report.message or (
                'no command' in report.message or 'no state' in report.message)
        met = len(tracking)
        it.until(lambda: len(tracking) > met + 10 and follows(), 'recovery')
        assert max(abs(a - b) for m in tracking
                   for a, b in zip(m.velocity[:2], m.velocity[2:])) < SPEED
        assert [child.status for child in it.children] == [None] * 3
        late = [x for x in it.lines if 'stale, ' in x]
        assert late and 'at most 20 ms late (state_timeout)' in late[0]

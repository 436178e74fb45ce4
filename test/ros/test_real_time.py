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

"""Priority, locked memory and processor of real processes; garbage that waits."""

from __future__ import annotations

from collections.abc import Callable
import gc
import os
from pathlib import Path
import resource
import signal
import subprocess
import sys
import time
from typing import Any, TypeVar
import weakref

from ctc_chattering.configuration.node_parameters import NodeConfig
from ctc_chattering.errors import ParameterError
from ctc_chattering.ros.real_time import garbage_off_the_loop, RealTime
from ctc_chattering.ros.topics import CLOCK, JOINT_STATES
from faults import Diagnostics
from processes import interrupt, probe
import pytest
from rights import WITH_RIGHTS
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

T = TypeVar('T')


def with_rights(start: Callable[..., T], *arguments: Any) -> T:
    """Have a process started that may have priority and locked memory."""
    def may() -> bool:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        except PermissionError:
            return False
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        return True

    if not WITH_RIGHTS.submit(may).result():
        pytest.skip('needs the right to SCHED_FIFO')
    return WITH_RIGHTS.submit(start, *arguments).result()


def policies(pid: int) -> set[tuple[int, int]]:
    """Return policy and priority of all threads of a process."""
    threads = [int(path.name) for path in Path(f'/proc/{pid}/task').iterdir()]
    assert len(threads) > 3  # The middleware's, too.
    return {(os.sched_getscheduler(x), os.sched_getparam(x).sched_priority) for x in threads}


def locked(pid: int) -> int:
    """Return how much memory of a process is locked [kB]."""
    status = Path(f'/proc/{pid}/status').read_text()
    return int(status.split('VmLck:')[1].split()[0])


@pytest.mark.ros
def test_a_controller_has_priority_while_time_is_real() -> None:
    """All threads get it with the first state of real time, and lose it where there is a clock."""
    with probe() as it:
        child = with_rights(it.start, 'controller', '-p', 'thread_priority:=50',
                            '-p', 'lock_memory:=true')
        diagnostics = Diagnostics(it)
        waiting = diagnostics.next('controller')
        assert waiting.values['scheduling'] == 'normal scheduling'
        assert policies(child.process.pid) == {(os.SCHED_OTHER, 0)}
        assert not locked(child.process.pid)
        states = it.node.create_publisher(JointState, JOINT_STATES, 10)

        def send() -> None:
            message = JointState(
                name=['joint1', 'joint2'], position=[0.0, 0.0], velocity=[0.0, 0.0])
            message.header.stamp = it.node.get_clock().now().to_msg()
            states.publish(message)

        it.node.create_timer(0.005, send)
        report = diagnostics.until(
            'controller', lambda r: r.values['scheduling'] != 'normal scheduling', 'priority')
        assert report.values['scheduling'] == 'SCHED_FIFO 50; memory locked'
        assert policies(child.process.pid) == {(os.SCHED_FIFO, 50)}
        assert locked(child.process.pid)
        it.node.create_publisher(Clock, CLOCK, 10)
        diagnostics.until(
            'controller', lambda r: r.values['scheduling'] == 'normal scheduling', 'its end')
        assert policies(child.process.pid) == {(os.SCHED_OTHER, 0)}
        assert interrupt(child, signal.SIGINT) < 5.0
        assert child.status == 0
        assert [line.split(']: ')[-1] for line in it.lines if 'SCHED' in line] == [
            'SCHED_FIFO 50; memory locked']


@pytest.mark.ros
def test_the_parameters_and_a_refusal() -> None:
    """One plant gets what its parameters ask for; another one says why not, and runs on."""
    arguments = ('-p', 'pacing:=real_time', '-p', 'cpu_affinity:=0', '-p', 'thread_priority:=7')
    with probe() as it:
        child = with_rights(it.start, 'plant', *arguments)
        report = Diagnostics(it).next('plant')
        assert report.values['scheduling'] == 'SCHED_FIFO 7'
        assert policies(child.process.pid) == {(os.SCHED_FIFO, 7)}
        assert os.sched_getaffinity(child.process.pid) == {0}
        assert not locked(child.process.pid)
        assert interrupt(child, signal.SIGINT) < 5.0
        it.lines.clear()
        child = it.start('plant', *arguments, '-p', 'lock_memory:=true')
        report = Diagnostics(it).next('plant')
        priority, memory = (resource.getrlimit(x)[0] for x in (14, resource.RLIMIT_MEMLOCK))
        assert report.values['scheduling'] == (
            'normal scheduling (SCHED_FIFO 7: Operation not permitted; needs rtprio 7 in '
            f'/etc/security/limits.conf, ulimit -r is {priority}; or CAP_SYS_NICE); memory not '
            f'locked (needs memlock unlimited in /etc/security/limits.conf, ulimit -l is '
            f'{memory // 1024}; or CAP_IPC_LOCK)')
        it.until(lambda: any(
            line.endswith(report.values['scheduling']) for line in it.lines), 'the line')
        assert policies(child.process.pid) == {(os.SCHED_OTHER, 0)}


def test_nothing_is_asked_for_by_default() -> None:
    """Not even by root: a node in real time is scheduled as all others, and locks no memory."""
    code = """
import os
from ctc_chattering.ros.real_time import RealTime
from ctc_chattering.configuration.node_parameters import NodeConfig
it = RealTime(NodeConfig())
assert it.update(True) == '' and it.outcome == 'normal scheduling'
assert os.sched_getscheduler(0) == os.SCHED_OTHER
"""
    assert with_rights(subprocess.run, [sys.executable, '-c', code]).returncode == 0


def test_a_processor_that_is_not_there() -> None:
    with pytest.raises(ParameterError, match=r'cpu_affinity: 1023 .*allowed: -1 \| \d'):
        RealTime(NodeConfig(cpu_affinity=1023))


class _Cycle:

    def __init__(self) -> None:
        self.me = self


def test_garbage_waits_until_it_is_asked_for() -> None:
    """No search for cycles within the loop, however much there is; what is asked for finds it."""
    with garbage_off_the_loop() as collect:
        assert gc.get_freeze_count()
        one = weakref.ref(_Cycle())
        collect()  # Too little to be worth it.
        assert one() is not None
        many = [weakref.ref(_Cycle()) for _ in range(10_000)]
        time.sleep(0)
        assert sum(x() is not None for x in many) == len(many)
        collect()
        assert one() is None
        assert not any(x() for x in many)
    assert gc.isenabled()
    assert not gc.get_freeze_count()

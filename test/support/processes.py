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

"""Help for tests that start real ROS 2 processes, each test in a domain of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

from ctc_chattering.launch import child_process
from ctc_chattering.ros.process import PROFILE_VARIABLES
from domains import own_domain
import pytest
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParameters
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSProfile
from stopwatch import PATIENCE as PATIENCE
from stopwatch import Stopwatch as Stopwatch

CONFIG = Path(__file__).resolve().parents[2] / 'config'
#: After which a service is asked again [s]: rmw drops an answer where it does not know the client
#: yet.
AGAIN = 2.0


class Probe:
    """A node of the test's own, and the processes under test."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        with pytest.MonkeyPatch.context() as it:
            # Without memory that others write into: a process killed while it does leaves a lock
            # behind, on which this one would crash or hang when it leaves.
            it.setenv(PROFILE_VARIABLES[0], str(CONFIG / 'fastdds.xml'))
            it.delenv(PROFILE_VARIABLES[1], raising=False)
            rclpy.init(context=self.context)
            self.node = rclpy.create_node('probe', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._client = cache(self.node.create_client)
        self.children: list[child_process.Child] = []
        self.lines: list[str] = []

    def start(self, name: str, *ros_args: str) -> child_process.Child:
        """Start one of the nodes."""
        arguments = ('--ros-args', *ros_args) if ros_args else ()
        child = child_process.Child(
            name, child_process.node_command(name, *arguments), self.lines.append)
        self.children.append(child)
        return child

    def until(self, done: Callable[[], Any], what: str = '') -> None:
        """Spin until `done` says so."""
        deadline = time.monotonic() + PATIENCE
        while not done():
            assert time.monotonic() < deadline, f'waited in vain for {what}: {self.lines}'
            self.executor.spin_once(timeout_sec=0.02)

    def until_said(self, *words: str) -> None:
        """Wait until a line with all words has come through the pipes."""
        self.until(lambda: any(
            all(word in line for word in words) for line in self.lines), words[-1])

    def listen(self, kind: Any, topic: str, qos: QoSProfile | int = 1000,
               raw: bool = False) -> list[Any]:
        """
        Return a list that fills with the messages on a topic.

        All that wait are taken at once: an executor, which takes one a turn, falls behind 1 kHz
        on a busy machine, further and further.
        """
        received: list[Any] = []

        def take(message: Any) -> None:
            received.append(message)
            with ear.handle:
                while (more := ear.handle.take_message(kind, raw)) is not None:
                    received.append(more[0])

        ear = self.node.create_subscription(kind, topic, take, qos, raw=raw)
        return received

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """Call a service and return the response."""
        client = self._client(kind, name)
        self.until(client.service_is_ready, f'service {name}')
        futures = [client.call_async(request)]
        asked = time.monotonic()

        def answered() -> bool:
            nonlocal asked
            if time.monotonic() - asked > AGAIN:
                asked = time.monotonic()
                futures.append(client.call_async(request))
            return any(future.done() for future in futures)

        self.until(answered, f'answer of {name}')
        return next(future.result() for future in futures if future.done())

    def set(self, node: str, name: str, value: Any) -> SetParametersResult:  # noqa: A003
        """Set a parameter as `ros2 param set` does."""
        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()])
        return self.call(SetParameters, f'/{node}/set_parameters', request).results[0]

    def get(self, node: str, name: str) -> Any:
        """Get a parameter as `ros2 param get` does."""
        request = GetParameters.Request(names=[name])
        response = self.call(GetParameters, f'/{node}/get_parameters', request)
        value = parameter_value_to_python(response.values[0])
        return list(value) if hasattr(value, '__iter__') and not isinstance(value, str) else value

    def close(self) -> None:
        """
        Stop everything.

        The test's own node is the last to leave: where others leave at the same time, Fast DDS
        2.14 can hang for ever with the interpreter's lock held. That the others have left is seen
        late on a busy machine, and of a killed one after the lease of `config/fastdds.xml`.
        """
        child_process.stop(self.children)
        deadline = time.monotonic() + PATIENCE
        # A publisher of every node.
        while (self.node.count_publishers('/parameter_events') > 1
               and time.monotonic() < deadline):
            self.executor.spin_once(timeout_sec=0.02)
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@contextmanager
def probe() -> Iterator[Probe]:
    """Yield a `Probe` in a domain of its own."""
    with own_domain():
        it = Probe()
        try:
            yield it
        finally:
            it.close()


#: By which ROS confines a graph to this host.
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'


@contextmanager
def bringup(*arguments: str, discovery: str = '') -> Iterator[subprocess.Popen[str]]:
    """Start bringup in a domain of its own, and confined by itself if not by the environment."""
    with own_domain():
        del os.environ[RANGE]
        if discovery:
            os.environ[RANGE] = discovery
        process = subprocess.Popen(
            [sys.executable, '-m', 'ctc_chattering.cli.bringup', *arguments], text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        try:
            yield process
        finally:
            if process.poll() is None:
                process.kill()
            process.communicate()


def run_bringup(*arguments: str) -> tuple[int, str]:
    """Run bringup to its end; return its status and output."""
    with bringup(*arguments) as process:
        try:
            output, _ = process.communicate(timeout=2 * PATIENCE)
        except subprocess.TimeoutExpired as error:
            pytest.fail(f'bringup has not ended: {error.output}')
        return process.returncode, output


def descendants(pid: int) -> dict[int, str]:
    """Return the command lines of all processes below `pid`, by process."""
    parents = {}
    for path in Path('/proc').glob('[0-9]*'):
        try:
            stat = (path / 'stat').read_text().rsplit(')', 1)[1].split()
            command = (path / 'cmdline').read_text().replace('\0', ' ')
        except OSError:
            continue
        if stat[0] != 'Z':
            parents[int(path.name)] = (int(stat[1]), command)
    found: dict[int, str] = {}
    ring = [pid]
    while ring:
        ring = [child for child, (parent, _) in parents.items() if parent in ring]
        found.update({child: parents[child][1] for child in ring})
    return found


def descriptors(pid: int) -> set[str]:
    """Return what the descriptors of a process point to; it may close some meanwhile."""
    found = set()
    for path in Path(f'/proc/{pid}/fd').iterdir():
        with suppress(FileNotFoundError):
            found.add(str(path.readlink()))
    return found


def has_port(pid: int) -> bool:
    """Return whether others can write into the memory of a process."""
    return any(path.startswith('/dev/shm/fastrtps_port') for path in descriptors(pid))


def wait_for(done: Callable[[], Any], what: str, patience: float = PATIENCE) -> None:
    """Poll until `done` says so."""
    deadline = time.monotonic() + patience
    while not done():
        assert time.monotonic() < deadline, f'waited in vain for {what}'
        time.sleep(0.02)


def alive(pids: Sequence[int]) -> list[int]:
    """Return those of `pids` that still run."""
    result = []
    for pid in pids:
        try:
            os.kill(pid, 0)
            if Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()[0] != 'Z':
                result.append(pid)
        except OSError:
            continue
    return result


def interrupt(child: child_process.Child, *numbers: int) -> float:
    """
    Send signals, SIGINT by default; return how long the end took [s], by a `Stopwatch`.

    Several come in quick succession.
    """
    watch = Stopwatch(child.process.pid)
    for number in numbers or (signal.SIGINT,):
        child.process.send_signal(number)
    return watch.end(child.process)

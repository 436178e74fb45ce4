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

"""A process in the graph: its end, Fast DDS, and security that is enforced."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap

from ctc_chattering.ros.process import PROFILE_VARIABLES, use_profile
from domains import own_domain
from processes import CONFIG, has_port, PATIENCE, probe, Stopwatch
import pytest
from rclpy.utilities import get_rmw_implementation_identifier


def test_it_is_used_unless_there_is_another_one(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in PROFILE_VARIABLES:
        monkeypatch.setenv(name, 'before the test')  # To be put back afterwards.
        monkeypatch.delenv(name)
    use_profile()
    assert os.environ[PROFILE_VARIABLES[0]] == str(CONFIG / 'fastdds.xml')
    for name in PROFILE_VARIABLES:
        monkeypatch.delenv(PROFILE_VARIABLES[0], raising=False)
        monkeypatch.setenv(name, 'theirs.xml')
        use_profile()
        assert [os.environ.get(x) for x in PROFILE_VARIABLES] == [
            'theirs.xml' if x == name else None for x in PROFILE_VARIABLES]
        monkeypatch.delenv(name)


@pytest.mark.ros
def test_no_process_writes_into_the_memory_of_a_node_by_default(
        monkeypatch: pytest.MonkeyPatch) -> None:
    """A node that has no port in shared memory cannot be cut off from it, nor hold others up."""
    if get_rmw_implementation_identifier() != 'rmw_fastrtps_cpp':
        pytest.skip('not Fast DDS')
    for name in PROFILE_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    with probe() as it:
        child = it.start('reference')
        it.until(lambda: 'reference' in it.node.get_node_names(), 'the node')
        assert not has_port(child.process.pid)
        assert not has_port(os.getpid())  # Else a killed node may take the tests with it.


#: Waits for ever and lets no thread of Python run.
HANG = 'ctypes.PyDLL(None).pause()'


def python(code: str) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, '-c', textwrap.dedent(code)], text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT)


@pytest.mark.parametrize('status', [0, 7])
def test_who_hangs_is_ended_with_its_status(status: int) -> None:
    process = python(f"""
        import ctypes
        from ctc_chattering.ros.process import end_after
        print('farewell')
        end_after(0.2, {status})
        {HANG}
    """)
    assert process.communicate(timeout=PATIENCE)[0] == 'farewell\n'
    assert process.returncode == status


def test_who_ends_before_ends_as_he_would() -> None:
    process = python("""
        from ctc_chattering.ros.process import end_after
        end_after(20.0, 7)
    """)
    assert process.communicate(timeout=PATIENCE)[0] == ''
    assert process.returncode == 0


@pytest.mark.ros
def test_a_node_that_the_middleware_does_not_let_go_ends() -> None:
    """As Fast DDS does it now and then: where the node's handle is destroyed."""
    with own_domain():
        process = python(f"""
            import ctypes
            import sys
            from ctc_chattering.nodes.plant import PlantNode
            from ctc_chattering.ros import process, run_node
            run_node._LEAVE_TIMEOUT_S = 3.0  # A busy machine must get that far before.

            class Stuck(PlantNode):
                def idle(self):
                    super().idle()
                    print('running', flush=True)

                def __del__(self):
                    print('hanging', flush=True)
                    {HANG}

            sys.exit(run_node.run(Stuck, 'plant', [], process.collect_signals()))
        """)
        try:
            assert process.stdout is not None
            assert 'running\n' in iter(process.stdout.readline, '')
            watch = Stopwatch(process.pid)
            process.send_signal(signal.SIGTERM)
            took = watch.end(process)
            output, _ = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    assert process.returncode == 0, output
    assert output.endswith('hanging\n')
    assert took < 3.0 + 5.0

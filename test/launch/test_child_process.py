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

"""Real processes under supervision."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
import os
from pathlib import Path
import signal
import subprocess
import sys
from threading import Event
from time import monotonic

from ctc_chattering.launch.child_process import Child, node_command, stop
from processes import alive, wait_for
import pytest

FOREVER = 'import time\nprint("ready")\nwhile True: time.sleep(60)'
IGNORE = 'import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n'
DEADLINE = 20.0
Start = Callable[[str], Child]


@pytest.fixture
def lines() -> list[str]:
    return []


@pytest.fixture
def start(lines: list[str]) -> Iterator[Start]:
    """Return a function that starts a child and waits for its first line."""
    children: list[Child] = []

    def run(code: str) -> Child:
        said = Event()

        def show(line: str) -> None:
            lines.append(line)
            said.set()
        children.append(Child('kid', [sys.executable, '-c', code], show))
        assert said.wait(DEADLINE)
        return children[-1]
    yield run
    for child in children:
        with suppress(ProcessLookupError):
            child.process.kill()
        child.process.wait(DEADLINE)


@pytest.mark.parametrize('command', [
    node_command('plant', '--help'), node_command('live', '--help', program='ctc')])
def test_the_current_directory_has_no_modules(command: list[str], tmp_path: Path) -> None:
    """A directory of bags may have a `yaml.py`; one that is named on PYTHONPATH is searched."""
    for name in ('yaml', 'argparse', 'runpy', 'ctc_chattering'):
        (tmp_path / f'{name}.py').write_text('raise SystemExit("trapped")')
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert '--help' in result.stdout and 'trapped' not in result.stderr
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False,
                            env={**os.environ, 'PYTHONPATH': str(tmp_path)})
    assert 'trapped' in result.stderr


def test_output_and_exit_report(start: Start, lines: list[str]) -> None:
    """Check both streams, in order, and that the report has status and the last lines."""
    child = start('import sys\nfor i in range(50): print("line", i)\n'
                  'sys.stderr.write("oops \\udcff\\n"); sys.stdout.buffer.write(b"\\xff\\n")\n'
                  'sys.exit(3)')
    child.process.wait(DEADLINE)
    text = child.exit_report()
    assert child.status == 3
    assert lines[:50] == [f'[kid] line {i}' for i in range(50)]
    assert len(lines) == 52
    assert text.startswith('kid ended with status 3. ')
    assert 'line 49' in text
    assert 'line 10' not in text
    assert 'oops' in text


@pytest.mark.parametrize(('code', 'words'), [
    ('import os\nprint("x")\nos.kill(os.getpid(), 11)', ['ended with signal SIGSEGV', 'x']),
    ('raise SystemExit(7)', ['kid ended with status 7', 'it printed nothing'])])
def test_exit_report_names_signal_or_status(code: str, words: list[str]) -> None:
    child = Child('kid', [sys.executable, '-c', code], lambda _: None)
    child.process.wait(DEADLINE)
    assert [word for word in words if word not in child.exit_report()] == []


@pytest.mark.parametrize(('before', 'number'), [
    ('import signal\nsignal.signal(signal.SIGINT, signal.SIG_DFL)\n', signal.SIGINT),
    (IGNORE, signal.SIGTERM),
    (IGNORE + 'signal.signal(signal.SIGTERM, signal.SIG_IGN)\n', signal.SIGKILL)])
def test_stop_escalates(start: Start, before: str, number: signal.Signals) -> None:
    """Check that a child gets as many signals as it takes, and no more patience than that."""
    child = start(before + FOREVER)
    assert child.status is None
    assert os.getpgid(child.process.pid) != os.getpgid(0)  # Ctrl-C reaches the parent only.
    begin = monotonic()
    stop([child], patience=0.2)
    assert child.status == -number
    steps = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL).index(number)
    assert monotonic() - begin >= 0.2 * steps - 0.01


def test_stop_lets_a_child_finish(start: Start, lines: list[str]) -> None:
    """Check that work after SIGINT is done before the next signal."""
    child = start(f'try:\n  {FOREVER.replace(chr(10), chr(10) + "  ")}\n'
                  'except KeyboardInterrupt:\n  time.sleep(0.3); print("closed")')
    stop([child], patience=DEADLINE)
    assert child.status == 0
    assert 'closed' in child.exit_report()
    assert lines[-1] == '[kid] closed'


def test_children_outlive_no_parent() -> None:
    """Kill a parent with SIGKILL; its child, which ignores SIGINT, must go too."""
    kid = ('import os\nfrom ctc_chattering.launch.child_process import end_with\n'
           f'{IGNORE}end_with(os.getppid())\n{FOREVER}')
    code = ('import sys\nfrom threading import Event\n'
            'from ctc_chattering.launch.child_process import Child\nready, lines = Event(), []\n'
            f'child = Child("kid", [sys.executable, "-c", {kid!r}], lambda line: (\n'
            '    lines.append(line), ready.set()))\n'
            'ready.wait()\nprint(lines[0], child.process.pid, flush=True)\nchild.process.wait()')
    root = str(Path(__file__).parents[2])
    with subprocess.Popen([sys.executable, '-c', code], stdout=subprocess.PIPE, text=True,
                          env={**os.environ, 'PYTHONPATH': root}) as parent:
        assert parent.stdout is not None
        _, first, number = parent.stdout.readline().split()
        assert first == 'ready'
        pid = int(number)
        os.kill(pid, 0)
        parent.kill()
    wait_for(lambda: not alive([pid]), 'the end of the child')

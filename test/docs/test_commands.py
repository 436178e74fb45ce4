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

"""The command lines of README and docs are valid, and those that can run here succeed."""

from __future__ import annotations

from collections.abc import Iterator
import os
from pathlib import Path
import re
import shlex
import signal
import subprocess
import sys
from typing import Any, NamedTuple

from ctc_chattering.cli.bringup import make_parser as bringup_parser
from ctc_chattering.cli.ctc import make_parser as ctc_parser
from ctc_chattering.cli.node import _make_parser as node_parser
from ctc_chattering.configuration.node_parameters import NODE_DESCRIPTIONS
from ctc_chattering.ros import ros_arguments
from domains import own_domain
from processes import PATIENCE
import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = (ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *(
    path for folder in ('docs', 'validation') for path in sorted((ROOT / folder).glob('*.md'))))
#: Beginnings of the lines that run in `make test`, and of those that run in `make slow`. Others
#: need the network, a robot, a cluster or minutes, or other tests run them.
FAST = ('ctc new-robot', 'ctc check-model --model', 'bringup pendulum')
RUNS = (*FAST, 'ctc check-model', 'ctc compare', 'ctc excite', 'ctc map gains', 'ctc plot',
        'ctc tune friction', 'bringup panda', 'bringup excite', 'bringup --pacing',
        'bringup ur5',
        *(f'ros2 run ctc_chattering {name} --ros-args --params-file'
          for name in ('plant', 'controller', 'reference')))
#: Replacement of the client ros2, and of the commands that pip installs, for short runs.
PRELUDE = f"""
shopt -s expand_aliases
ros2() {{
    case "$1 $2 $3" in
        "pkg prefix --share") echo {shlex.quote(str(ROOT))};;
        "run ctc_chattering "*) shift 2; "$@";;
        *) echo "ros2 $* is not here" >&2; return 97;;
    esac
}}
ctc() {{ {shlex.quote(sys.executable)} -m ctc_chattering.cli.ctc "$@"; }}
bringup() {{ {shlex.quote(sys.executable)} -m ctc_chattering.cli.bringup "$@" --duration 0.2; }}
""" + ''.join(
    f'{name}() {{ exec {shlex.quote(sys.executable)} -m ctc_chattering.cli.node {name} "$@"; }}\n'
    for name in NODE_DESCRIPTIONS)


class Line(NamedTuple):
    """A command, the assignments that stand before it in its block, and the lines before it."""

    page: str
    text: str
    before: tuple[str, ...]


def lines() -> Iterator[Line]:
    for page in PAGES:
        for block in re.findall(r'```sh\n(.*?)```', page.read_text(encoding='utf-8'), re.DOTALL):
            before: tuple[str, ...] = ()
            for line in block.replace('\\\n', ' ').splitlines():
                text = ' '.join(re.sub(r'(^|\s)#.*', '', line).split())
                if text:
                    yield Line(page.name, text, before)
                    before = (*before, text)


LINES = list(lines())


def is_assignment(text: str) -> bool:
    return re.match(r'(export )?\w+=', text) is not None


def ours(line: Line) -> list[str]:
    """Return the words of a command of this package, or an empty list for another program."""
    words = shlex.split(line.text)
    if words[:3] == ['ros2', 'run', '--prefix']:
        del words[2:4]
    if words[:3] == ['ros2', 'run', 'ctc_chattering']:
        words = words[3:]
    return words if words[0] in ('ctc', 'bringup', *NODE_DESCRIPTIONS) else []


def test_every_beginning_of_the_list_is_in_the_docs() -> None:
    for start in RUNS:
        assert any(line.text.startswith(start) for line in LINES), start


@pytest.mark.parametrize(
    'line', [x for x in LINES if ours(x)], ids=lambda x: f'{x.page}: {x.text}')
def test_every_command_line_has_valid_options(line: Line) -> None:
    """Check options, parameters and remaps, also of lines that do not run here."""
    name, *arguments = ours(line)
    if name == 'ctc':
        ctc_parser().parse_args(arguments)
        return
    own, ros = ros_arguments.parse(arguments)
    (bringup_parser() if name == 'bringup' else node_parser(name)).parse_args(own)
    rules = tuple(x for x in ros.parameters if x[0] != '--params-file')
    ros._replace(parameters=rules).values([name])


def test_ctc_and_bringup_are_written_without_ros2_run() -> None:
    """
    Check that pages write them as pip installs them, and that install.md has aliases of both.

    Single nodes are written with `ros2 run`.
    """
    written = [line.text for line in LINES if line.text.startswith('ros2 run')
               and ours(line)[:1] in (['ctc'], ['bringup'])]
    assert not written
    (alias,) = (line.text for line in LINES if line.text.startswith('alias '))
    assert shlex.split(alias)[1:] == [f'{name}=ros2 run ctc_chattering {name}'
                                      for name in ('ctc', 'bringup')]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a directory with the file that docs/robots.md has the reader write, and its model."""
    page = (ROOT / 'docs' / 'robots.md').read_text(encoding='utf-8')
    found = re.search('`pendulum.yaml`:\n\n```yaml\n(.*?)```', page, re.DOTALL)
    assert found
    (tmp_path / 'pendulum.yaml').write_text(found[1])
    (tmp_path / 'examples').symlink_to(ROOT / 'examples')
    return tmp_path


def runs() -> Iterator[Any]:
    for line in LINES:
        if line.text.startswith(RUNS):
            yield pytest.param(line, id=f'{line.page}: {line.text}', marks=[
                pytest.mark.ros, *([] if line.text.startswith(FAST) else [pytest.mark.slow])])


@pytest.mark.parametrize('line', list(runs()))
def test_the_command_succeeds(line: Line, folder: Path) -> None:
    """Run a line after the assignments before it. Stop a node when it waits for its topics."""
    before = [x for x in line.before if is_assignment(x)]
    if ours(line)[:2] in (['ctc', 'plot'], ['ctc', 'learn']):
        before += [x for x in line.before if ' bringup ' in f' {x} ']
    if ' excite/' in line.text:
        before = [x.text for x in LINES if x.text.startswith('ctc excite')] + before
    with own_domain():
        process = subprocess.Popen(
            ['bash', '-c', '\n'.join((PRELUDE, 'set -e', *before, line.text))], cwd=folder,
            text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            env={**os.environ, 'PYTHONPATH': str(ROOT), 'PYTHONUNBUFFERED': '1'})
        try:
            said = []
            if ours(line)[0] in NODE_DESCRIPTIONS:
                assert process.stdout is not None
                for text in process.stdout:
                    said.append(text)
                    if 'waits for' in text:
                        break
                process.send_signal(signal.SIGINT)
            output, _ = process.communicate(timeout=10 * PATIENCE)  # A comparison takes minutes.
        finally:
            process.kill()
    assert process.returncode == 0, ''.join(said) + output


@pytest.mark.slow
@pytest.mark.parametrize('law', ['compensation', 'observer_feedback'])
def test_the_readme_shows_what_ctc_simulate_prints(law: str, tmp_path: Path) -> None:
    """Compare the comment behind a line of the first ten minutes, up to its dots."""
    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    (shown,) = re.findall(rf'^ctc simulate ur5 --law {law} +# (.*) \.\.\.$', text, re.MULTILINE)
    output = subprocess.run(
        [sys.executable, '-m', 'ctc_chattering.cli.ctc', 'simulate', 'ur5', '--law', law],
        cwd=tmp_path, env={**os.environ, 'PYTHONPATH': str(ROOT)}, text=True,
        stdout=subprocess.PIPE, timeout=10 * PATIENCE, check=True).stdout
    assert ' '.join(shown.split()) in ' '.join(output.split())

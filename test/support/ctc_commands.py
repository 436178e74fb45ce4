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

"""Commands of the package, run in this process or in one of their own."""

from __future__ import annotations

from contextlib import redirect_stderr, redirect_stdout
import io
import os
from pathlib import Path
import subprocess
import sys
import warnings

from ctc_chattering.cli.ctc import main
import pytest

ROOT = Path(__file__).resolve().parents[2]
Finished = subprocess.CompletedProcess[str]


def python(*arguments: object, cwd: Path = ROOT, path: Path = ROOT, timeout: float = 60.0
           ) -> Finished:
    """Run Python, which imports from `path` before all else that is installed."""
    return subprocess.run(
        [sys.executable, *map(str, arguments)], cwd=cwd, text=True, capture_output=True,
        timeout=timeout, check=False, env={
            **os.environ, 'PYTHONPATH': os.pathsep.join(map(str, (path, ROOT))),
            'COLUMNS': '200'})


def ctc_process(*arguments: object, cwd: Path = ROOT, path: Path = ROOT, timeout: float = 60.0
                ) -> Finished:
    return python('-m', 'ctc_chattering.cli.ctc', *arguments, cwd=cwd, path=path, timeout=timeout)


def ctc(*arguments: object, cwd: Path = ROOT) -> Finished:
    """Run the command as `ctc_process` does, but here: libraries are loaded only once."""
    words = [str(x) for x in arguments]
    out, err = io.StringIO(), io.StringIO()
    before = Path.cwd()
    os.chdir(cwd)
    try:
        with (pytest.MonkeyPatch.context() as patch, warnings.catch_warnings(record=True) as said,
              redirect_stdout(out), redirect_stderr(err)):
            patch.setenv('COLUMNS', '200')
            patch.setenv('PYTHONSAFEPATH', '1')  # As the command does.
            warnings.simplefilter('ignore')
            for kind in (UserWarning, RuntimeWarning, SyntaxWarning, FutureWarning):
                warnings.simplefilter('default', kind)
            try:
                status = main(words)
            except SystemExit as end:  # argparse
                status = int(end.code or 0)
    finally:
        os.chdir(before)
    shown = ''.join(f'{x.category.__name__}: {x.message}\n' for x in said)
    return Finished(words, status, out.getvalue(), err.getvalue() + shown)


def refused(result: Finished, *words: object) -> None:
    """Assert one line on stderr with all `words`, and a status that says so."""
    assert result.returncode != 0
    assert len(result.stderr.splitlines()) == 1
    assert 'Traceback' not in result.stderr
    assert [word for word in words if str(word) not in result.stderr] == []

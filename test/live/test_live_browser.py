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

"""Opening the page: a browser gets a file of the user's own, and no token in its arguments."""

from __future__ import annotations

import json
import os
from pathlib import Path
import subprocess
import sys

from processes import wait_for
import pytest

URL = 'http://127.0.0.1:8080/?token=secret&more="<b>'
OPEN = (f'from ctc_chattering.live.browser import opened\n'
        f'with opened({URL!r}) as done:\n'
        '    print(done, flush=True)\n'
        '    input()\n')
BROWSER = """#!{python}
import json, os, sys
from pathlib import Path
from urllib.parse import unquote, urlparse
file = Path(unquote(urlparse(sys.argv[1]).path))
made = Path({out!r} + '.part')
made.write_text(json.dumps([sys.argv[1], file.stat().st_mode & 0o77, file.read_text(),
                            file.parent.stat().st_mode & 0o77]))
made.rename({out!r})
"""


@pytest.mark.parametrize('window', [True, False])
def test_the_browser_gets_a_file_that_nobody_else_reads(tmp_path: Path, window: bool) -> None:
    """Check it with a browser of a window, which ends with "&", and one that takes a terminal."""
    out, browser = tmp_path / 'seen.json', tmp_path / 'browser'
    browser.write_text(BROWSER.format(python=sys.executable, out=str(out)))
    browser.chmod(0o755)
    started = subprocess.Popen(
        [sys.executable, '-c', OPEN], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        env={**os.environ, 'TMPDIR': str(tmp_path), 'BROWSER': f'{browser} %s' + ' &' * window})
    assert started.stdout is not None
    assert started.stdout.readline() == f'{window}\n'
    if window:
        wait_for(out.exists, 'the browser')
        argument, _, text, readers = json.loads(out.read_text())
        assert 'secret' not in argument
        assert readers == 0
        assert 'url=http://127.0.0.1:8080/?token=secret&amp;more=&#34;&lt;b&gt;' in text
    started.communicate('\n')
    assert started.returncode == 0
    assert not list(tmp_path.rglob('page.html'))
    assert out.exists() == window

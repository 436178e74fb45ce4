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

"""The page in the browser of this machine, without its token in the list of processes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import tempfile
import webbrowser

from ctc_chattering.analysis.markup import fragment

_LEADS = ('<!DOCTYPE html><meta charset="utf-8">'
          '<meta http-equiv="refresh" content="0; url={{ url }}">')


@contextmanager
def opened(url: str) -> Iterator[bool]:
    """
    Open an address in a browser with a window of its own; yield whether there is one.

    The browser is given a file that leads to the address: other users of this machine can read
    the arguments of its process, but not the file, which is removed at the end.
    """
    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        browser = None
    # The browsers of this class take the terminal.
    if browser is None or type(browser) is webbrowser.GenericBrowser:
        yield False
        return
    with tempfile.TemporaryDirectory(prefix='ctc_live_') as folder:
        page = Path(folder) / 'page.html'
        page.write_text(str(fragment(_LEADS, url=url)), encoding='utf-8')
        yield browser.open(page.as_uri())

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

"""Small folders of text files: made, read, and guarded against changes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ctc_chattering.output_folder import LIST


def fill(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def contents(path: Path) -> dict[str, str]:
    """Return the files of a folder without its list; a link by where it leads to."""
    return {str(x.relative_to(path)): f'-> {x.readlink()}' if x.is_symlink() else x.read_text()
            for x in path.rglob('*') if (x.is_file() or x.is_symlink()) and x.name != LIST}


@contextmanager
def victim(path: Path) -> Iterator[Path]:
    """Yield a file outside a folder; assert that it is as it was."""
    file = path / 'victim'
    file.write_text('secret')
    yield file
    assert file.read_text() == 'secret' and not file.is_symlink()

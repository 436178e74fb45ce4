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

"""Archives that are packed again."""

from __future__ import annotations

import io
from pathlib import Path
import tarfile
import time

from distributions import pack


def archive(path: Path, names: list[str], **owner: int) -> Path:
    with tarfile.open(path, 'w:gz') as stream:
        for name in names:
            member = tarfile.TarInfo(name)
            member.size, member.mtime, member.uid = 4, int(time.time()), owner['uid']
            stream.addfile(member, io.BytesIO(b'text'))
    return path


def test_order_time_and_owner_do_not_matter(tmp_path: Path) -> None:
    one = archive(tmp_path / 'one.tar.gz', ['p/a', 'p/b'], uid=0)
    other = archive(tmp_path / 'other.tar.gz', ['p/b', 'p/a'], uid=1000)
    assert one.read_bytes() != other.read_bytes()
    for path in (one, other):
        pack(path, 1_700_000_000)
    assert one.read_bytes() == other.read_bytes()
    with tarfile.open(one) as stream:
        assert [(x.name, x.mtime, x.uname) for x in stream] == [
            ('p/a', 1_700_000_000, ''), ('p/b', 1_700_000_000, '')]

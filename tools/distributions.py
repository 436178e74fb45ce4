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

"""
Builds sdist and wheel of the last commit in ``dist/``: the same bytes from the same commit.

The date of the commit is the one of all files. The sdist is packed again, because setuptools
writes the time of the build into it. Another version of setuptools may give other bytes.
"""

from __future__ import annotations

import gzip
import io
import os
from pathlib import Path
import subprocess
import sys
import tarfile
import tempfile

ROOT = Path(__file__).resolve().parents[1]


def built(root: Path, target: Path, isolated: bool = True) -> list[Path]:
    """
    Build the last commit of a repository, and return the files.

    Parameters
    ----------
    root, target : Path
        The repository, and the directory for the files.
    isolated : bool
        Whether setuptools comes from PyPI.

    """
    def git(*words: str) -> bytes:
        return subprocess.run(['git', *words], cwd=root, stdout=subprocess.PIPE, check=True).stdout
    epoch = int(git('log', '-1', '--format=%ct'))
    os.umask(0o022)
    with tempfile.TemporaryDirectory() as scratch:
        with tarfile.open(fileobj=io.BytesIO(git('archive', 'HEAD'))) as tree:
            tree.extractall(scratch)
        subprocess.run(
            [sys.executable, '-m', 'build', '--outdir', str(target.resolve()),
             *([] if isolated else ['--no-isolation']), scratch],
            env={**os.environ, 'SOURCE_DATE_EPOCH': str(epoch)}, stdout=subprocess.DEVNULL,
            check=True)
    for path in target.glob('*.tar.gz'):
        pack(path, epoch)
    return sorted(target.iterdir())


def pack(path: Path, epoch: int) -> None:
    """Pack an archive again, sorted, with one time and without owners."""
    with tarfile.open(path) as archive:
        members = [(x, x.isfile() and archive.extractfile(x)) for x in archive.getmembers()]
        contents = [(x, data.read() if data else b'') for x, data in members]
    with path.open('wb') as raw, gzip.GzipFile('', 'wb', mtime=epoch, fileobj=raw) as stream, \
            tarfile.open(fileobj=stream, mode='w', format=tarfile.PAX_FORMAT) as archive:
        for member, data in sorted(contents, key=lambda x: x[0].name):
            member.mtime, member.uid, member.gid = epoch, 0, 0
            member.uname = member.gname = ''
            member.pax_headers = {}
            archive.addfile(member, io.BytesIO(data))


if __name__ == '__main__':
    for file in built(ROOT, ROOT / 'dist'):
        print(file)

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
Folders that commands write, beside files of the user.

A folder that a command has written contains a list of its files, `LIST`. The list has the digest
of each file's content: a copy or a clone has other sizes and times. Commands only ever remove
files of the list that nobody has changed since. The files of a user stay.

New output is made in a folder beside the old one, and takes its place in one step of the file
system. A process that is killed leaves the old output or the new one.

1. `check_folder` refuses a folder that is not the command's.
2. `new_folder` makes the whole output again. `held` lets a command replace single files.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
import ctypes
import errno
import fcntl
import hashlib
import json
import os
from pathlib import Path
import shutil
import stat
from typing import BinaryIO, NamedTuple

from ctc_chattering.errors import CtcError
from ctc_chattering.input_files import kind_of, read_text
from ctc_chattering.output_files import (
    incomplete_path,
    is_incomplete,
    NO_LINK,
    replacing,
    writing,
)

#: The list of files in a folder: a line of JSON for the command, and for each file.
LIST = '.ctc_output'


class FileList(NamedTuple):
    """
    List of the files that a command has written.

    Attributes
    ----------
    command : str
        The command, or '' without a list.
    digests : dict of str to set of str
        Digests of every content that each file has had. A process may have been killed between
        two.

    """

    command: str
    digests: dict[str, set[str]]

    def is_unchanged(self, folder: Path, name: str) -> bool:
        """Return whether a file is as the command wrote it."""
        return name in self.digests and _digest(folder / name) in self.digests[name]


class FolderContents(NamedTuple):
    """
    Paths in a folder by owner, relative to it.

    Attributes
    ----------
    output : list of str
        Files of the list as the command has written them, and those that it has not completed.
    changed : list of str
        Files of the list that somebody has changed since.
    foreign : list of str
        All other files, links and empty folders.

    """

    output: list[str]
    changed: list[str]
    foreign: list[str]


def read_contents(folder: Path) -> FolderContents:
    """Return the contents of a folder."""
    contents = FolderContents([], [], [])
    with writing(folder):
        files = _read_list(folder)
        for name in _names(folder):
            if is_incomplete(name) or files.is_unchanged(folder, name):
                contents.output.append(name)
            elif name in files.digests:
                contents.changed.append(name)
            else:
                contents.foreign.append(name)
    return contents


def _read_list(folder: Path) -> FileList:
    """Return the list of a folder, which may be empty."""
    path, command, digests = folder / LIST, '', dict[str, set[str]]()
    if _is_file(path):
        for line in read_text(path).splitlines():
            with suppress(ValueError, AttributeError, KeyError):  # Empty, or cut off.
                entry = json.loads(line)
                command = str(entry.get('command', command))
                if 'file' in entry:
                    digests.setdefault(str(entry['file']), set()).add(str(entry['sha256']))
    return FileList(command, digests)


def _names(folder: Path) -> Iterator[str]:
    """Yield files, links and empty folders in order, without `LIST`."""

    def fail(error: OSError) -> None:
        raise error

    for root, folders, files in os.walk(folder, onerror=fail):
        folders.sort()
        links = [x for x in folders if Path(root, x).is_symlink()]
        for path in (Path(root, name) for name in sorted([*files, *links])):
            if path != folder / LIST or not _is_file(path):
                yield str(path.relative_to(folder))
        if not (folders or files) and Path(root) != folder:
            yield str(Path(root).relative_to(folder))


def _is_file(path: Path) -> bool:
    """Return whether this is a regular file."""
    return path.is_file() and not path.is_symlink()


def _digest(path: Path) -> str:
    """Return the digest of a regular file, or ''."""
    if not _is_file(path):
        return ''
    digest = hashlib.sha256()
    with path.open('rb') as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def check_owner(path: Path, command: str) -> None:
    """
    Raise unless a folder is new, empty or the command's.

    Raises
    ------
    CtcError
        If it is not, or contains more than the output of a command. The message says what to do.

    """
    with writing(path):
        if path.is_symlink() and not path.exists():
            raise CtcError(f'{path}: is a link to nothing; choose another --out')
        _check_not_shared(path)
        if not path.exists():
            return
        mode = path.stat().st_mode
        if not stat.S_ISDIR(mode):
            raise CtcError(f'{path}: is {kind_of(mode)}, not a folder; choose another --out')
        owner, first = _read_list(path).command, next(_names(path), '')
    if first and not owner:
        raise CtcError(
            f'{path}: contains {first}, and no list of what ctc has written; choose '
            'a new or an empty folder as --out'
        )
    if first and owner != command:
        raise CtcError(
            f'{path}: has the output of {owner}, which {command} does not replace; '
            'choose another --out'
        )


def _check_not_shared(path: Path) -> None:
    """Raise `CtcError` for a folder that commands must not own."""
    resolved = path.resolve()
    shared = {'the working directory': Path.cwd()}
    with suppress(RuntimeError):  # A user may have no home.
        shared['the home folder'] = Path.home()
    reasons = [
        f'is {name}, or above it'
        for name, folder in shared.items()
        if folder.resolve().is_relative_to(resolved)
    ]
    if os.path.ismount(resolved):
        reasons.append('is the top of a file system')
    if reasons:
        raise CtcError(
            f'{path}: {reasons[0]}; choose a folder for the output alone, such as '
            f'--out {path / "output"}'
        )


def _check_writable(path: Path) -> None:
    """Raise unless a folder can be made beside this one."""
    with writing(path):
        folder = incomplete_path(path.resolve())
        missing = [x for x in (folder, *folder.parents) if not x.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        for folder in missing:
            folder.rmdir()


def check_folder(path: Path, command: str, overwrite: bool = False) -> None:
    """
    Raise unless a command may write to this folder.

    Parameters
    ----------
    path : Path
        The folder. It is new, or empty, or one that the same command has written.
    command : str
        The command, such as ``ctc plot``.
    overwrite : bool
        Whether output that is there may be replaced.

    Raises
    ------
    CtcError
        If it may not, or cannot. The message says what to do.

    """
    check_owner(path, command)
    _check_writable(path)
    if not path.exists():
        return
    contents = read_contents(path)
    written = [*contents.output, *contents.changed]
    if written and not overwrite:
        raise CtcError(
            f'{path / written[0]}: exists already; choose another --out, or --overwrite'
        )
    if contents.changed:
        raise CtcError(
            f'{path / contents.changed[0]}: was changed since {command} wrote it; move '
            'it away, or choose another --out'
        )


class OutputFolder:
    """
    A folder that only this process writes.

    Parameters
    ----------
    path : Path
        The folder.
    command : str
        The command that writes it.
    stream : BinaryIO
        Its list, open and locked.

    """

    def __init__(self, path: Path, command: str, stream: BinaryIO) -> None:
        self.path, self.command, self._stream = path, command, stream
        self._note(command=command)

    @contextmanager
    def replacing(self, name: str) -> Iterator[BinaryIO]:
        """
        Yield a stream for a file as `output_files.replacing` does.

        The list has the file before it has its name.

        Raises
        ------
        CtcError
            If there is a file that this command has not written, or that was changed since.

        """
        self._check_unchanged(name)
        path = self.path / name
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
            self._note_file(name, incomplete_path(path))

    @contextmanager
    def replacing_files(self) -> Iterator[Path]:
        """
        Yield an empty folder whose files replace those here.

        They take their places when the context ends.

        Raises
        ------
        CtcError
            As `replacing` does.

        """
        scratch = self.path / '.files.part'
        with writing(scratch):
            if scratch.is_dir() and not scratch.is_symlink():
                shutil.rmtree(scratch)
            scratch.unlink(missing_ok=True)
            scratch.mkdir()
        yield scratch
        with writing(self.path):
            for name in list(_names(scratch)):
                self._check_unchanged(name)
                self._note_file(name, scratch / name)
                (self.path / name).parent.mkdir(parents=True, exist_ok=True)
                (scratch / name).replace(self.path / name)
            shutil.rmtree(scratch)

    def begin(self) -> None:
        """Remove all files, and begin a new list."""
        with writing(self.path):
            for path in self.path.iterdir():
                if path.is_dir() and not path.is_symlink():
                    shutil.rmtree(path)
                elif path.name != LIST:
                    path.unlink()
            self._stream.truncate(0)
        self._note(command=self.command)

    def take_place(self, path: Path) -> None:
        """
        Give this folder the place of the old output.

        Before that, files of the user there get a second name here.

        Raises
        ------
        CtcError
            If a file of the user has the name of a new one.

        """
        with writing(path):
            names = list(_names(self.path))
            for name in names:
                self._note_file(name, self.path / name)
            if not os.path.lexists(path) or not any(path.iterdir()):
                self.path.rename(path)
                return
            for name in names:
                _sync(self.path / name)
            contents = read_contents(path)
            kept = [*contents.changed, *contents.foreign]
            for name in kept:
                self._keep(path / name, self.path / name)
            shutil.copymode(path, self.path)
            _exchange(self.path, path)
        with suppress(OSError):  # What remains is hidden, and the next output takes its place.
            _remove(self.path, [*contents.output, *kept])

    def _keep(self, path: Path, target: Path) -> None:
        """Give a user's file or empty folder a second name."""
        try:
            if path.is_dir() and not path.is_symlink():
                target.mkdir(parents=True, exist_ok=True)
                return
            target.parent.mkdir(parents=True, exist_ok=True)
            os.link(path, target, follow_symlinks=False)
        except (FileExistsError, NotADirectoryError):
            raise CtcError(
                f'{path}: has the name of a file that {self.command} writes; move it '
                'away, or choose another --out'
            ) from None
        except OSError as error:
            raise CtcError(
                f'{path}: cannot stay beside the new output: {error.strerror}; move it '
                'away, or choose another --out'
            ) from None

    def _check_unchanged(self, name: str) -> None:
        """
        Raise if somebody changed a file.

        A link to it, or above it, is refused also.
        """
        path = self.path / name
        for parent in reversed([path, *path.parents]):
            if parent != self.path and parent.is_relative_to(self.path) and parent.is_symlink():
                raise CtcError(f'{parent}: is a link, which is not followed; remove it')
        if os.path.lexists(path) and not _read_list(self.path).is_unchanged(self.path, name):
            raise CtcError(
                f'{path}: is not as {self.command} wrote it; move it away, or choose another --out'
            )

    def _note_file(self, name: str, content: Path) -> None:
        """Add a file with its digest to the list."""
        self._note(file=name, sha256=_digest(content))

    def _note(self, **entry: str) -> None:
        """Add an entry to the list."""
        with writing(self.path / LIST):
            # On a line of its own, also after an entry that was cut off.
            self._stream.write(f'\n{json.dumps(entry)}\n'.encode())


def _sync(path: Path) -> None:
    """Flush a file to the disk."""
    if _is_file(path):
        descriptor = os.open(path, os.O_RDONLY | NO_LINK)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _exchange(first: Path, second: Path) -> None:
    """
    Let two folders have each other's name.

    Where the file system cannot do it in one step, as NFS, one of them has no name in between.
    """
    rename = getattr(ctypes.CDLL(None, use_errno=True), 'renameat2', None)
    error = errno.ENOSYS
    if rename is not None:
        here, exchange = -100, 2  # AT_FDCWD and RENAME_EXCHANGE of Linux.
        if rename(here, os.fsencode(first), here, os.fsencode(second), exchange) == 0:
            return
        error = ctypes.get_errno()
    if error not in (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP):
        raise OSError(error, os.strerror(error))
    aside = first.with_name(f'{first.name}.old')
    second.rename(aside)
    first.rename(second)
    aside.rename(first)


def _remove(folder: Path, names: Sequence[str]) -> None:
    """Remove these files, and the folder if empty then."""
    for name in names:
        with suppress(IsADirectoryError):
            (folder / name).unlink(missing_ok=True)
    for root, _, _ in os.walk(folder, topdown=False):
        if Path(root) == folder:  # Without its list, nobody would know whose it is.
            (folder / LIST).unlink()
        Path(root).rmdir()


@contextmanager
def held(path: Path, command: str) -> Iterator[OutputFolder]:
    """
    Hold a folder for this process, however that ends.

    It is made if it does not exist.

    Parameters
    ----------
    path : Path
        A folder that `check_owner` allows.
    command : str
        The command that writes it.

    Raises
    ------
    CtcError
        If another process holds it, or it cannot be written.

    """
    with writing(path):
        path.mkdir(parents=True, exist_ok=True)
        for link in filter(Path.is_symlink, (path, path / LIST)):
            raise CtcError(f'{link}: is a link, which is not followed; remove it')
        descriptor = os.open(path / LIST, os.O_RDWR | os.O_CREAT | os.O_APPEND | NO_LINK, 0o666)
    with os.fdopen(descriptor, 'r+b', buffering=0) as stream:
        _lock(stream, path)
        yield OutputFolder(path, command, stream)


def _lock(stream: BinaryIO, path: Path) -> None:
    """Lock the list of a folder, or raise `CtcError`."""
    status = os.fstat(stream.fileno())
    if not stat.S_ISREG(status.st_mode):
        raise CtcError(f'{path / LIST}: is {kind_of(status.st_mode)}; remove it')
    with writing(path):
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Another process may have moved the folder meanwhile.
            is_locked = os.path.samestat(status, (path / LIST).stat())
        except (BlockingIOError, FileNotFoundError):
            is_locked = False
        if not is_locked:
            raise CtcError(
                f'{path}: another process is writing there; wait until it ends, or '
                'choose another --out'
            )


def claim(path: Path, command: str, name: str) -> Path:
    """
    Return a user's folder in a command's folder.

    Both are made if necessary.

    Raises
    ------
    CtcError
        As `check_owner` does, if there is a link in its place, or it cannot be made.

    """
    check_owner(path, command)
    folder = path / name
    if not _read_list(path).command:
        with held(path.resolve(), command):
            pass
    with writing(folder):
        folder.mkdir(exist_ok=True)
        if folder.is_symlink():
            raise CtcError(f'{folder}: is a link, which is not followed; remove it')
    return folder


@contextmanager
def beside(path: Path, command: str) -> Iterator[OutputFolder]:
    """
    Hold the folder of the new output.

    The output gets the name `path` later. The folder may have what a process that was killed has
    made.

    Raises
    ------
    CtcError
        As `held` does, or if the folder has files and no list of them.

    """
    incomplete = incomplete_path(path.resolve())
    with writing(path):
        incomplete.mkdir(parents=True, exist_ok=True)
        owner = _read_list(incomplete).command
    check_owner(incomplete, owner or command)
    with held(incomplete, command) as folder:
        yield folder


@contextmanager
def new_folder(path: Path, command: str, overwrite: bool = False) -> Iterator[Path]:
    """
    Yield an empty folder that replaces the old output.

    It gets the name `path` when the context ends without an error.

    Parameters
    ----------
    path, command, overwrite
        As `check_folder` takes them.

    Raises
    ------
    CtcError
        As `check_folder` does, if another process writes there, or the folder cannot be written.

    """
    check_folder(path, command, overwrite)
    with beside(path, command) as folder:
        folder.begin()
        try:
            yield folder.path
            folder.take_place(path.resolve())
        except BaseException:
            shutil.rmtree(folder.path, ignore_errors=True)
            raise

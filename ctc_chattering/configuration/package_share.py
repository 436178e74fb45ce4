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
Files of the package and of robots.

Users refer to them by path, name or ``package://``, in parameter files and commands. The
experiments of the paper are at the end.
"""

from __future__ import annotations

from contextlib import suppress
import os
from pathlib import Path
import sys
from typing import Any

from ctc_chattering.errors import CtcError, prefixed, suggest, UsageError
from ctc_chattering.input_files import read_text


def config_directory() -> Path:
    """
    Return the directory of the experiments' parameter files.

    It is `config/` beside the package in a checkout, and `share/ctc_chattering/config` under the
    prefix that pip or colcon has installed to.

    Raises
    ------
    CtcError
        If there is none.

    """
    for prefix in (*Path(__file__).resolve().parents, Path(sys.prefix)):
        checkout = (prefix / 'package.xml').exists()
        folder = prefix / ('config' if checkout else 'share/ctc_chattering/config')
        if (folder / 'friction.yaml').exists():  # One of the files that are always shipped.
            return folder
    raise CtcError('the configuration files of ctc_chattering are not installed')


def find_config(text: str, beside: Path = Path(), folder: str = '') -> Path:
    """
    Return the file that `text` names.

    A missing path with a directory is returned unchecked.

    Parameters
    ----------
    text : str
        A path, or a name of the package's files such as ``panda``.
    beside : Path
        Directory from which a relative path counts.
    folder : str
        Folder below `config_directory`, for example ``cases`` or ``maps``.

    Raises
    ------
    UsageError
        If a bare name is neither a file nor a shipped configuration.

    """
    files = {path.stem: path for path in sorted((config_directory() / folder).glob('*.yaml'))}
    if text in files:
        return files[text]
    if Path(text).name == text and not os.path.lexists(beside / text):
        raise UsageError(f'{text}: there is no such file, and the package has only '
                         f'{", ".join(files)}{suggest(text, files)}')
    return beside / text


_SCHEME = 'package://'
#: Robots of the package's files.
_ROBOTS = f'{_SCHEME}example-robot-data/'
#: Installation of these robots and of Pinocchio, for their model.
_INSTALL = 'pip install example-robot-data pin'
#: Formats of meshes that are read.
_MESH_FORMATS = ('.stl', '.dae', '.obj')
#: Largest file of a mesh that is read [bytes].
_MAX_MESH_SIZE = 50_000_000


def read_description(location: str) -> str:
    """
    Return the text of a description.

    Parameters
    ----------
    location : str
        Path of the file, or ``package://NAME/PATH`` for `PATH` below ``share/NAME`` of an
        installation of ROS 2, of the Python environment, or of a wheel in it.

    Raises
    ------
    CtcError
        If it cannot be read.

    """
    path = find_file(location)
    with prefixed('description: '):
        return read_text(path)


def find_file(location: str) -> Path:
    """
    Return the path of a named file.

    Parameters
    ----------
    location : str
        As `read_description` takes it.

    Raises
    ------
    CtcError
        If its package is not installed.

    """
    if not location.startswith(_SCHEME):
        return Path(location)
    relative_path = Path('share', *location.removeprefix(_SCHEME).split('/'))
    ament = filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep))
    prefixes = [*map(Path, ament), Path(sys.prefix)]
    for entry in filter(None, sys.path):
        cmeel_prefix = Path(entry, 'cmeel.prefix')
        if cmeel_prefix.is_dir():
            prefixes.append(cmeel_prefix)
    for prefix in prefixes:
        path = prefix / relative_path
        if os.path.isfile(path):  # noqa: PTH113 - A path may be too long for a system.
            return path
    hint = f'; {_INSTALL}' if location.startswith(_ROBOTS) else ''
    raise CtcError(f'description: {location}: there is no installed file {relative_path} below '
                   f'{", ".join(map(str, prefixes))}{hint}')


def find_mesh(location: str) -> Path | None:
    """
    Return the file of a mesh, if it may be read.

    STL, COLLADA and OBJ are read, up to 50 MB. A foreign URDF may name any file.
    """
    with suppress(CtcError):
        path = find_file(location.removeprefix('file://'))
        is_mesh = path.suffix.lower() in _MESH_FORMATS and path.is_file()
        if is_mesh and path.stat().st_size <= _MAX_MESH_SIZE:
            return path
    return None


#: Experiments by the name of their bag: a parameter file of the package, and values of the
#: controller that replace the file's. They are figures 2 to 9 of the paper, the switching that
#: this package recommends, and the switch from one law to the other. With that switching Ka is
#: above friction.
EXPERIMENTS: dict[str, tuple[str, dict[str, Any]]] = {
    'friction_compensation': ('friction', {'law': 'compensation'}),
    'friction_chattering': ('friction', {'law': 'chattering'}),
    'friction_chattering_implicit_observer': ('friction', {
        'law': 'chattering', 'switching': 'implicit_observer', 'ka': [12.0, 12.0]}),
    'disturbance_compensation': ('disturbance', {'law': 'compensation'}),
    'disturbance_chattering': ('disturbance', {'law': 'chattering'}),
    'switch': ('switch', {})}

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

"""Files of the package and of robots by path, name or ``package://``; the paper's experiments."""

from __future__ import annotations

from contextlib import suppress
import os
from pathlib import Path
import sys
from typing import Any

from ctc_chattering.errors import CtcError, suggest, UsageError
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
        found = prefix / ('config' if checkout else 'share/ctc_chattering/config')
        if (found / 'friction.yaml').exists():
            return found
    raise CtcError('the configuration files of ctc_chattering are not installed')


def find_config(text: str, beside: Path = Path(), folder: str = '') -> Path:
    """
    Return the file that `text` names.

    Parameters
    ----------
    text : str
        A path, or ``panda`` for the package's own.
    beside : Path
        Directory from which a relative path counts.
    folder : str
        Of the package's own, below `config_directory`.

    Raises
    ------
    UsageError
        If `text` has no directory, and names neither.

    """
    own = {path.stem: path for path in sorted((config_directory() / folder).glob('*.yaml'))}
    if text in own:
        return own[text]
    if Path(text).name == text and not os.path.lexists(beside / text):
        raise UsageError(f'{text}: no such file, and the package has none with this name: '
                         f'{", ".join(own)}{suggest(text, own)}')
    return beside / text


_SCHEME = 'package://'
#: The robots of the package's own files, and how they come with what their model needs.
_ROBOTS, _INSTALL = f'{_SCHEME}example-robot-data/', 'pip install example-robot-data pin'
#: What meshes are read from, and how large these files may be [bytes].
_MESHES, _MESH_SIZE = ('.stl', '.dae', '.obj'), 50_000_000


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
    try:
        return read_text(path)
    except CtcError as error:
        raise CtcError(f'description: {error}') from None


def find_file(location: str) -> Path:
    """
    Return where a file is that a description or a parameter names.

    Parameters
    ----------
    location : str
        As `read_description` takes it.

    Raises
    ------
    CtcError
        If it is of a package that is not installed.

    """
    if not location.startswith(_SCHEME):
        return Path(location)
    below = Path('share', *location.removeprefix(_SCHEME).split('/'))
    ament = filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep))
    bundles = (Path(entry, 'cmeel.prefix') for entry in filter(None, sys.path))
    looked = [*map(Path, ament), Path(sys.prefix), *filter(Path.is_dir, bundles)]
    for prefix in looked:
        if os.path.isfile(prefix / below):  # noqa: PTH113 - A path may be too long for a system.
            return prefix / below
    hint = f'; {_INSTALL}' if location.startswith(_ROBOTS) else ''
    raise CtcError(f'description: {location}: not installed; looked for {below} below '
                   f'{", ".join(map(str, looked))}{hint}')


def find_mesh(location: str) -> Path | None:
    """
    Return the file of a mesh that a URDF names; None where it is not to be read.

    Read are STL, COLLADA and OBJ, up to 50 MB: a URDF of others may name any file.
    """
    with suppress(CtcError):
        path = find_file(location.removeprefix('file://'))
        if path.suffix.lower() in _MESHES and path.is_file() and (
                path.stat().st_size <= _MESH_SIZE):
            return path
    return None


#: Figures 2 to 9 of the paper, the switching that this package recommends (Ka above friction),
#: and the switch from one law to the other: a parameter file of the package, and values of the
#: controller in the place of its own, by the name of the bag.
EXPERIMENTS: dict[str, tuple[str, dict[str, Any]]] = {
    'friction_compensation': ('friction', {'law': 'compensation'}),
    'friction_chattering': ('friction', {'law': 'chattering'}),
    'friction_chattering_implicit_observer': ('friction', {
        'law': 'chattering', 'switching': 'implicit_observer', 'ka': [12.0, 12.0]}),
    'disturbance_compensation': ('disturbance', {'law': 'compensation'}),
    'disturbance_chattering': ('disturbance', {'law': 'chattering'}),
    'switch': ('switch', {})}

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

"""Where the installed configuration files are, however the package was installed."""

from __future__ import annotations

from pathlib import Path
import sys

from ctc_chattering.errors import CtcError, near, UsageError


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
    package = Path(__file__).resolve().parents[1]
    candidates = [package.parent / 'config'] if (package.parent / 'package.xml').exists() else []
    candidates += [prefix / 'share' / 'ctc_chattering' / 'config'
                   for prefix in (*package.parents, Path(sys.prefix))]
    for candidate in candidates:
        if (candidate / 'friction.yaml').exists():
            return candidate
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
    if Path(text).name == text and not (beside / text).exists():
        raise UsageError(f'{text}: no such file, and the package has none with this name: '
                         f'{", ".join(own)}{near(text, own)}')
    return beside / text

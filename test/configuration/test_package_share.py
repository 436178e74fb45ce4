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

"""Where the configuration files are."""

from __future__ import annotations

from pathlib import Path
import shutil
import subprocess
import sys

import ctc_chattering

SHOW = 'from ctc_chattering.configuration.package_share import config_directory as c; print(c())'
SOURCE = Path(__file__).parents[2]


def shown(site: Path, code: str = SHOW) -> subprocess.CompletedProcess[str]:
    """Run `code` with the package of the directory `site`."""
    return subprocess.run([sys.executable, '-B', '-c', code], cwd=site, text=True,
                          capture_output=True, timeout=60, check=False,
                          env={'PYTHONPATH': str(site)})


def copied(site: Path) -> None:
    source, target = Path(ctc_chattering.__file__).parent, site / 'ctc_chattering'
    (target / 'configuration').mkdir(parents=True)
    for name in ('__init__.py', 'errors.py', 'configuration/__init__.py',
                 'configuration/package_share.py'):
        shutil.copy(source / name, target / name)


def test_installed_below_a_prefix(tmp_path: Path) -> None:
    """Check an installation, and that a `config` beside it which is not ours is passed over."""
    site = tmp_path / 'lib' / 'python3' / 'site-packages'
    copied(site)
    share = tmp_path / 'share' / 'ctc_chattering' / 'config'
    shutil.copytree(SOURCE / 'config', share)
    (site / 'config').mkdir()
    (site / 'config' / 'friction.yaml').write_text('')
    assert Path(shown(site).stdout.strip()) == share


def test_not_installed(tmp_path: Path) -> None:
    """Check the error, one line of ours."""
    copied(tmp_path)
    code = (f'import sys\nfrom ctc_chattering.errors import CtcError\nsys.prefix = "/nowhere"\n'
            f'try:\n    {SHOW}\nexcept CtcError as error:\n    print("refused:", error)')
    result = shown(tmp_path, code.replace('; print', '\n    print'))
    assert result.stdout.startswith('refused: ')
    assert len(result.stdout.splitlines()) == 1

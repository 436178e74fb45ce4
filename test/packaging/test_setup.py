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

"""The installation."""

from __future__ import annotations

from pathlib import Path
import re
import subprocess
import sys

ROOT = Path(__file__).resolve().parents[2]


def test_setup_runs_where_colcon_s_symlink_install_runs_it(tmp_path: Path) -> None:
    """Check it in a directory of links without README.md, as colcon makes one."""
    for name in ('setup.py', 'setup.cfg', 'ctc_chattering', 'config', 'launch', 'resource'):
        (tmp_path / name).symlink_to(ROOT / name)
    result = subprocess.run(
        [sys.executable, 'setup.py', '--name', '--long-description'], cwd=tmp_path, text=True,
        capture_output=True, timeout=60, check=False)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith('ctc_chattering\n# ctc_chattering\n')


def test_the_readme_installs_extras_that_there_are() -> None:
    readme = (ROOT / 'README.md').read_text(encoding='utf-8')
    setup = (ROOT / 'setup.py').read_text(encoding='utf-8')
    named = re.findall(r"pip install ['\"]?(?:\.|ctc_chattering)\[([\w,]+)\]", readme)
    assert named
    for name in ','.join(named).split(','):
        assert f"'{name}': [" in setup


def test_a_build_has_all_files_of_the_package(tmp_path: Path) -> None:
    """Check the files that are no modules, such as the template of the page."""
    subprocess.run([sys.executable, 'setup.py', '--quiet', 'build', '--build-base', tmp_path],
                   cwd=ROOT, timeout=60, capture_output=True, check=True)

    def contents(package: Path) -> set[Path]:
        return {path.relative_to(package) for path in package.rglob('*')
                if path.is_file() and path.suffix != '.pyc'}

    built = contents(tmp_path / 'lib' / 'ctc_chattering')
    assert built == contents(ROOT / 'ctc_chattering')
    assert Path('analysis/web/plots.js') in built


def test_an_installation_has_the_license(tmp_path: Path) -> None:
    subprocess.run(
        [sys.executable, 'setup.py', '--quiet', 'install_data', '--install-dir', tmp_path],
        cwd=ROOT, timeout=60, capture_output=True, check=True)
    share = tmp_path / 'share' / 'ctc_chattering'
    assert (share / 'LICENSE').read_bytes() == (ROOT / 'LICENSE').read_bytes()
    assert (share / 'package.xml').is_file()

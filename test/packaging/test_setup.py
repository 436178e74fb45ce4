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

import ast
from pathlib import Path
import re
import shlex
import subprocess
import sys
from typing import Any

ROOT = Path(__file__).resolve().parents[2]


def test_setup_runs_where_colcon_s_symlink_install_runs_it(tmp_path: Path) -> None:
    """Check it in a directory of links without README.md, as colcon makes one."""
    for name in ('setup.py', 'setup.cfg', 'ctc_chattering', 'config', 'resource'):
        (tmp_path / name).symlink_to(ROOT / name)
    result = subprocess.run(
        [sys.executable, 'setup.py', '--name', '--long-description'], cwd=tmp_path, text=True,
        capture_output=True, timeout=60, check=False)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith('ctc_chattering\n# ctc_chattering\n')


def requirements() -> dict[str, Any]:
    """Return what setup.py requires, always and for each extra."""
    tree = ast.parse((ROOT / 'setup.py').read_text(encoding='utf-8'))
    (call,) = (x for x in ast.walk(tree) if isinstance(x, ast.Call)
               and isinstance(x.func, ast.Name) and x.func.id == 'setup')
    return {x.arg: ast.literal_eval(x.value) for x in call.keywords
            if x.arg in ('install_requires', 'extras_require')}


def names(words: list[str]) -> set[str]:
    return {re.split('[<>=]', word)[0] for word in words}


def test_the_readme_installs_what_is_needed() -> None:
    """Beside apt's ROS 2, and without; in both ways what --params-file panda needs, too."""
    lines = re.findall(r'pip install (.*?)(?:`|\n)', (ROOT / 'README.md').read_text())
    beside, alone, robots = (shlex.split(line.split(' && ')[0]) for line in lines)
    required = requirements()
    assert names(required['install_requires']) - names(beside) == {'numpy', 'PyYAML', 'setuptools'}
    assert alone == ['.[ros,urdf]']
    assert set(robots) == {'pin', 'example-robot-data'} == set(required['extras_require']['urdf'])


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

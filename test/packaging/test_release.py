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

"""What a release needs, and the installation."""

from __future__ import annotations

import ast
from pathlib import Path
import re
import subprocess
import sys
from typing import Any
from xml.etree import ElementTree

import ctc_chattering
import yaml

ROOT = Path(__file__).resolve().parents[2]
#: Requirements of pip that rosdep has no key for: what writes bags, and what that needs.
WITHOUT_KEY = {'lz4', 'mcap', 'zstandard'}
MANIFEST = ElementTree.parse(ROOT / 'package.xml').getroot()


def called_with() -> dict[str, Any]:
    """Return the arguments of `setup` that are literals."""
    tree = ast.parse((ROOT / 'setup.py').read_text(encoding='utf-8'))
    (call,) = (x for x in ast.walk(tree) if isinstance(x, ast.Call)
               and isinstance(x.func, ast.Name) and x.func.id == 'setup')
    return {x.arg or '': ast.literal_eval(x.value) for x in call.keywords if x.arg in (
        'version', 'install_requires', 'extras_require', 'description', 'license')}


SETUP = called_with()


def texts(tag: str) -> set[str]:
    return {x.text or '' for x in MANIFEST.findall(tag)}


def names(words: list[str]) -> set[str]:
    return {re.split(r'[<>=\[]', word)[0] for word in words}


def test_all_manifests_have_one_version() -> None:
    log = (ROOT / 'CHANGELOG.rst').read_text(encoding='utf-8')
    versions = re.findall(r'^(\d+\.\d+\.\d+) \(\d{4}-\d\d-\d\d\)\n-+$', log, re.MULTILINE)
    citation = yaml.safe_load((ROOT / 'CITATION.cff').read_text(encoding='utf-8'))
    assert versions[0] == ctc_chattering.__version__ == SETUP['version'] == citation['version']
    assert texts('version') == {versions[0]}
    title = 'Changelog for package ctc_chattering'
    assert log.splitlines()[:3] == ['^' * len(title), title, '^' * len(title)]
    assert texts('license') == {SETUP['license']} == {citation['license']}


def test_rosdep_finds_what_is_needed_but_what_comes_from_pip() -> None:
    needed = texts('exec_depend') | texts('depend')
    keys = {x for x in needed if x.startswith('python3-')}
    assert all(re.fullmatch(r'[a-z_]+', x) for x in needed - keys)
    assert {x for x in keys if 'pip' in x} == {'python3-rosbags-pip'}
    of_pip = {f'python3-{x.lower()}' for x in names(SETUP['install_requires'])}
    assert {x.replace('pyyaml', 'yaml') for x in of_pip} == {
        x.removesuffix('-pip') for x in keys} | {
        'python3-setuptools', *(f'python3-{x}' for x in WITHOUT_KEY)}


def test_the_extra_all_has_every_feature() -> None:
    extras = dict(SETUP['extras_require'])
    readme = (ROOT / 'README.md').read_text(encoding='utf-8')
    named = re.findall(r"pip install ['\"]?(?:\.|ctc_chattering)\[([\w,]+)\]", readme)
    assert named and set(','.join(named).split(',')) <= set(extras)
    (everything,) = extras['all']
    assert everything.startswith('ctc_chattering[')
    features = set(re.findall(r'\w+', everything)[1:])
    assert features == set(extras) - {'all', 'docs', 'lint', 'test'}
    page = (ROOT / 'docs' / 'install.md').read_text(encoding='utf-8')
    rows = dict(re.findall(r'^\| `(\w+)` \|.*?\| (.*) \|$', page, re.MULTILINE))
    assert set(rows) == features
    words = names([word for name in features for word in extras[name]])
    assert set(re.findall(r'`([\w-]+)`', ' '.join(
        row.split(' | ')[0] for row in rows.values()))) == words


def test_every_module_begins_with_the_copyright() -> None:
    """Check what `ament_copyright` looks for."""
    header = (ROOT / 'setup.py').read_text(encoding='utf-8').partition('\n\n')[0] + '\n'
    assert header.startswith('# Copyright 2026 The ctc_chattering maintainers\n')
    folders = 'ctc_chattering', 'docs', 'examples', 'launch', 'test', 'tools', 'validation'
    files = [ROOT / 'setup.py', *(x for name in folders for x in (ROOT / name).rglob('*.py'))]
    assert len(files) > 400
    without = [str(x) for x in files if not x.read_text(encoding='utf-8').startswith(header)]
    assert not without


def test_setup_runs_where_colcon_s_symlink_install_runs_it(tmp_path: Path) -> None:
    """Check it in a directory of links without README.md, as colcon makes one."""
    for name in ('setup.py', 'setup.cfg', 'ctc_chattering', 'config', 'launch', 'resource'):
        (tmp_path / name).symlink_to(ROOT / name)
    result = subprocess.run(
        [sys.executable, 'setup.py', '--name', '--long-description'], cwd=tmp_path, text=True,
        capture_output=True, timeout=60, check=False)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith('ctc_chattering\n# ctc_chattering\n')


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
    assert Path('c_export/templates/ros2_control/controller.cpp') in built


def test_every_pip_builds_a_wheel() -> None:
    """
    Check the build backend, without which old pips run setup.py.

    With the options of setup.cfg, setup.py installs the commands where `ros2 run` finds them,
    and not on the path.
    """
    text = (ROOT / 'pyproject.toml').read_text(encoding='utf-8')
    assert "build-backend = 'setuptools.build_meta'" in text


def test_an_installation_has_the_license(tmp_path: Path) -> None:
    subprocess.run(
        [sys.executable, 'setup.py', '--quiet', 'install_data', '--install-dir', tmp_path],
        cwd=ROOT, timeout=60, capture_output=True, check=True)
    share = tmp_path / 'share' / 'ctc_chattering'
    assert (share / 'LICENSE').read_bytes() == (ROOT / 'LICENSE').read_bytes()
    assert (share / 'package.xml').is_file()

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

"""What the package gives, which folder may import which, and that names are unique."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
import doctest
from functools import cache
from importlib.resources import files
import inspect
from pathlib import Path
import re
from typing import Any

import ctc_chattering
from ctc_chattering.compiled import compilable
import pytest

ROOT = Path(ctc_chattering.__file__).parent
#: Each imports only what stands before it.
ORDER = ('errors', 'number_format', 'input_files', 'output_files', 'output_folder',
         'parameters', 'compiled',
         'numerics', 'dynamics', 'trajectory', 'control', 'margins', 'controller', 'simulation',
         'configuration', 'learning', 'analysis', 'c_export', 'ros', 'bags', 'nodes', 'launch',
         'runs', 'identification', 'live', 'cli')
FOLDERS = ORDER[ORDER.index('compiled'):]
#: These know nothing of ROS.
NUMERIC = (*ORDER[:ORDER.index('ros')], 'identification')
#: Packages that ROS brings.
ROS = ('builtin_interfaces', 'rcl_interfaces', 'rclpy', 'rpyutils')


def modules() -> Iterator[tuple[str, Path]]:
    """Yield the modules with the folder, or top-level module, that they belong to."""
    for path in sorted(ROOT.rglob('*.py')):
        part = path.relative_to(ROOT).parts[0].removesuffix('.py')
        if part != '__init__':
            yield part, path


@cache
def syntax(path: Path) -> list[ast.AST]:
    """Return the nodes of a module."""
    return list(ast.walk(ast.parse(path.read_text(encoding='utf-8'))))


def imported(path: Path) -> Iterator[str]:
    """Yield the dotted names of all that a module imports."""
    for node in syntax(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f'{node.module}.{alias.name}' for alias in node.names)


def test_folders_import_along_the_table_of_the_design() -> None:
    """Each name in a row stands for an import of what is above; no folder imports others."""
    assert {part for part, _ in modules()} == set(ORDER)
    page = (ROOT.parent / 'docs' / 'design.md').read_text(encoding='utf-8')
    rows = re.findall(r'^\| `(\w+)/` \|.*\| (.*) \| .* \|$', page, re.MULTILINE)
    assert [part for part, _ in rows] == list(FOLDERS)
    arrows = {(part, name) for part, names in rows for name in re.findall(r'`(\w+)`', names)}
    imports = {(part, name.split('.')[1]) for part, path in modules() for name in imported(path)
               if name.startswith('ctc_chattering.')
               and name.split('.')[1] in set(FOLDERS) - {part}}
    assert arrows <= imports
    assert all(ORDER.index(name) < ORDER.index(part) for part, name in arrows)
    reached = set(arrows)
    while more := {(a, d) for a, b in reached for c, d in arrows if b == c} - reached:
        reached |= more
    assert imports <= reached


def test_no_two_modules_import_each_other() -> None:
    names = {'.'.join(('ctc_chattering', *path.relative_to(ROOT).with_suffix('').parts)): path
             for _, path in modules()}
    below = {name: {x for full in imported(path)
                    for x in (full, full.rpartition('.')[0]) if x in names and x != name}
             for name, path in names.items()}
    done: set[str] = set()
    while ready := {name for name, need in below.items() if name not in done and need <= done}:
        done |= ready
    assert set(below) == done, f'in cycles: {sorted(set(below) - done)}'


def test_what_is_numeric_knows_nothing_of_ros() -> None:
    wrong = [f'{path.relative_to(ROOT)} imports {name}' for part, path in modules()
             if part in NUMERIC for name in imported(path)
             if name.split('.')[0] in ROS or name.split('.')[0].endswith('_msgs')]
    assert not wrong


def test_the_package_has_types_and_the_version_of_its_manifest() -> None:
    assert files('ctc_chattering').joinpath('py.typed').is_file()
    manifest = (ROOT.parent / 'package.xml').read_text(encoding='utf-8')
    assert f'<version>{ctc_chattering.__version__}</version>' in manifest
    with pytest.raises(AttributeError, match='no attribute'):
        getattr(ctc_chattering, 'something_else')  # noqa: B009


def public() -> Iterator[tuple[str, Any]]:
    """Yield the public names, and what they are, without the version."""
    for name in ctc_chattering.__all__:
        if name != '__version__':
            yield name, getattr(ctc_chattering, name)


def test_type_checkers_see_the_public_names() -> None:
    """Compare the stub with the table from which names are imported."""
    imports = [node for node in ast.parse((ROOT / '__init__.pyi').read_text(encoding='utf-8')).body
               if isinstance(node, ast.ImportFrom)]
    assert all(alias.name == alias.asname for node in imports for alias in node.names)
    stub = {alias.name: str(node.module).removeprefix('ctc_chattering.')
            for node in imports for alias in node.names}
    assert stub == ctc_chattering._MODULES


def test_the_examples_in_docstrings_are_right(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    runner, count = doctest.DocTestRunner(), 0
    for name, found in (('ctc_chattering', ctc_chattering), *public()):
        for case in doctest.DocTestFinder(recurse=False).find(found, name, globs={}):
            runner.run(case)
            count += len(case.examples)
    # What the examples mark is of no file.
    for function in [x for x in compilable.FUNCTIONS if x.__module__ == '__main__']:
        compilable.FUNCTIONS.remove(function)
    for record in [x for x in compilable.RECORDS if x.__module__ == '__main__']:
        del compilable.RECORDS[record]
    assert (runner.summarize().failed, count >= 20) == (0, True)


@pytest.mark.parametrize('name, found', list(public()))
def test_docstrings_of_public_names_describe_their_parameters(
        name: str, found: Any) -> None:
    """Check every parameter, and the word for what is raised by what checks arguments."""
    assert f'`{name}`' in (ctc_chattering.__doc__ or '')
    text = inspect.getdoc(found) or ''
    parts = re.split(r'^(\w+)\n-+$', text, flags=re.MULTILINE)
    sections = dict(zip(parts[1::2], parts[2::2]))
    entries = sections.get('Parameters', '') + sections.get('Attributes', '')
    described = {x.strip(' *') for line in re.findall(r'^(\S.*)$', entries, re.MULTILINE)
                 for x in line.split(' : ')[0].split(',')}
    assert len(parts[0].split()) > 3
    if name != 'CtcError':
        assert set(inspect.signature(found).parameters) <= described | {'args', 'values'}
    if hasattr(found, '__wrapped__'):
        assert 'Raises' in sections or name == 'laws'


#: The number of a displayed equation: the last of its line, after two spaces or more.
NUMBER = re.compile(r'\S {2,}\(([A-Z]{0,3}\d*)\)$', re.MULTILINE)


def repeated(found: Iterable[tuple[str, str]]) -> Mapping[str, list[str]]:
    """Return the names that stand in several places, with these."""
    places: dict[str, list[str]] = defaultdict(list)
    for name, place in found:
        places[name].append(place)
    return {name: where for name, where in places.items() if len(where) > 1}


def test_no_two_classes_have_one_name_and_no_two_equations_one_number() -> None:
    """A class that is private to a module counts as any other."""
    kinds = ast.Module, ast.ClassDef, ast.FunctionDef
    nodes = [(path.name, node) for _, path in modules()
             for node in syntax(path) if isinstance(node, kinds)]
    assert not repeated((node.name.lstrip('_'), path) for path, node in nodes
                        if isinstance(node, ast.ClassDef))
    assert not repeated(
        (number, path) for path, node in nodes
        for number in NUMBER.findall(ast.get_docstring(node) or ''))

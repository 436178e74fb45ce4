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

"""A name stands for one thing: classes, and the numbers of equations."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
import re

import ctc_chattering
import pytest

ROOT = Path(ctc_chattering.__file__).parent
#: The number of a displayed equation: the last of its line, after two spaces or more.
NUMBER = re.compile(r'\S {2,}\(([A-Z]{0,3}\d*)\)$', re.MULTILINE)


def trees() -> Iterator[tuple[str, ast.Module]]:
    """Yield path, relative to the package, and content of every module."""
    for path in sorted(ROOT.rglob('*.py')):
        yield path.relative_to(ROOT).as_posix(), ast.parse(path.read_text(encoding='utf-8'))


def classes(tree: ast.Module) -> Iterator[str]:
    """Yield the names of a module's classes; one that is private to it counts as any other."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            yield node.name.lstrip('_')


def equations(tree: ast.Module) -> Iterator[str]:
    """Yield the numbers of the equations that a module's docstrings display."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
            yield from NUMBER.findall(ast.get_docstring(node) or '')


def repeated(found: Iterable[tuple[str, str]]) -> Mapping[str, list[str]]:
    """Return the names that stand in several places, with these."""
    places: dict[str, list[str]] = defaultdict(list)
    for name, place in found:
        places[name].append(place)
    return {name: where for name, where in places.items() if len(where) > 1}


def test_no_two_classes_have_one_name() -> None:
    clashes = repeated((name, place) for place, tree in trees() for name in classes(tree))
    assert not clashes


def test_no_two_equations_have_one_number() -> None:
    assert not repeated(
        (number, place) for place, tree in trees() for number in equations(tree))


@pytest.mark.parametrize('text', ['"""\nOne.\n\n    x = 1    (SL1)\n    y = (2)\n"""',
                                  'def f():\n    """\n    x = a (b)  (SL1)\n    """\n'])
def test_a_number_is_found_where_an_equation_has_one(text: str) -> None:
    assert list(equations(ast.parse(text))) == ['SL1']
    assert repeated([('SL1', 'a'), ('SL1', 'b'), ('2', 'c')]) == {'SL1': ['a', 'b']}


def test_a_private_class_is_one_as_well() -> None:
    assert list(classes(ast.parse('class A:\n    class _B: ...'))) == ['A', 'B']

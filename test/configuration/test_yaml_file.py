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

"""YAML of every kind of file that a user writes: a key that stands twice is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.trajectory_file import read_trajectory
from ctc_chattering.configuration.yaml_file import read_yaml, yaml_text
from ctc_chattering.errors import CtcError
from ctc_chattering.ros.ros_arguments import parse
from ctc_chattering.runs.conditions import read_cases
from ctc_chattering.runs.spec import read_spec
import pytest


def as_a_node(path: Path) -> object:
    return parse(['--ros-args', '--params-file', str(path)])[1].values(['controller'])


@pytest.mark.parametrize(('read', 'text', 'key', 'lines'), [
    (parameter_file.load, 'plant: {}\n/**: {}\nplant: {}\n', 'plant', (1, 3)),
    (as_a_node, 'controller:\n  ros__parameters:\n    ka: [1.0, 1.0]\n\n    ka: [2.0, 2.0]\n',
     'ka', (3, 5)),
    (read_spec, 'repeats: 2\nseed: 0\nrepeats: 3\n', 'repeats', (1, 3)),
    (lambda path: read_trajectory(path, ('a',)), 'points: []\npoints: []\n', 'points', (1, 2)),
    (read_yaml, '{a: 1, a: 1}', 'a', (1, 1))])
def test_a_key_that_stands_twice(read: Callable[[Path], object], text: str, key: str,
                                 lines: tuple[int, int], tmp_path: Path) -> None:
    path = tmp_path / 'file.yaml'
    path.write_text(text)
    with pytest.raises(CtcError) as error:
        read(path)
    assert str(error.value) == (f'{path}: key {key} appears twice in one mapping, in lines '
                                f'{lines[0]} and {lines[1]}')


@pytest.mark.parametrize(('text', 'word'), [
    ('/controller: {ros__parameters: {}}\ncontroller: {ros__parameters: {}}\n',
     'section /controller'),
    ('controller: {ros__parameters: {a.b: 1, a: {b: 2}}}\n', 'section /controller')])
def test_two_spellings_of_one_name(tmp_path: Path, text: str, word: str) -> None:
    path = tmp_path / 'file.yaml'
    path.write_text(text)
    with pytest.raises(CtcError, match=f'{word}, or a parameter in it, appears twice'):
        parameter_file.read(path)


def test_what_is_merged_may_be_replaced(tmp_path: Path) -> None:
    """Check an anchor that is merged before YAML has constructed it, too."""
    path = tmp_path / 'file.yaml'
    path.write_text('b: &b {x: 1}\nouter: {inner: &c {<<: *b, x: 2}}\nd: {<<: *c, x: 4, y: 3}\n')
    assert read_yaml(path) == {
        'b': {'x': 1}, 'outer': {'inner': {'x': 2}}, 'd': {'x': 4, 'y': 3}}


def test_equal_values_are_written_twice() -> None:
    """Anchors such as &id001 are no numbers to read or to change."""
    twice = [0.0, 1.0]
    tree = {'plant': {'initial_position': twice}, 'reference': {'center': twice}}
    assert yaml_text(tree) == (
        'plant:\n  initial_position: [0.0, 1.0]\nreference:\n  center: [0.0, 1.0]\n')


#: A file of each kind, as short as it can be.
KINDS = {
    'a parameter file': '/**:\n  ros__parameters: {joint_names: [a]}\n',
    'a spec of ctc map or ctc tune': 'params_file: friction\nduration: 1.0\n',
    'a file of waypoints': 'joint_names: [a]\npoints: []\n',
    'a file of conditions': 'overrides: {}\ncases: {}\n'}
READERS: dict[Callable[[Path], object], str] = {
    parameter_file.load: 'a parameter file', as_a_node: 'a parameter file',
    read_spec: 'a spec of ctc map or ctc tune',
    lambda path: read_trajectory(path, ('a',)): 'a file of waypoints',
    read_cases: 'a file of conditions'}


@pytest.mark.parametrize(('read', 'expected'), READERS.items())
def test_a_file_of_another_kind_is_named(
        read: Callable[[Path], object], expected: str, tmp_path: Path) -> None:
    """And where such a file belongs."""
    path = tmp_path / 'file.yaml'
    for kind, text in KINDS.items():
        if kind != expected:
            path.write_text(text)
            with pytest.raises(CtcError) as error:
                read(path)
            assert str(error.value).startswith(f'{path}: this is {kind}, not {expected}; ')

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

"""The launch file, without launch: what it imports, and the parameters of its nodes."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

from ctc_chattering.cli.bringup import make_parser
from ctc_chattering.cli.options import load_setup
from ctc_chattering.errors import CtcError
from ctc_chattering.launch.graph import node_values
import pytest

pytestmark = pytest.mark.ros


FILE = Path(__file__).resolve().parents[2] / 'launch' / 'bringup.launch.py'


def test_it_compiles_and_uses_what_there_is() -> None:
    """Check its syntax, what it imports, and that its arguments are options of bringup."""
    tree = ast.parse(FILE.read_text(encoding='utf-8'))
    compile(tree, FILE, 'exec')
    for line in (x for x in tree.body if isinstance(x, ast.ImportFrom)):
        assert line.module is not None
        if line.module.partition('.')[0] not in ('launch', 'launch_ros'):
            module = importlib.import_module(line.module)
            assert all(hasattr(module, x.name) for x in line.names)
    (arguments,) = (ast.literal_eval(x.value) for x in tree.body if isinstance(x, ast.Assign)
                    and ast.unparse(x.targets[0]) == 'ARGUMENTS')
    options = vars(make_parser().parse_args([]))
    assert set(options) - set(arguments) == {'live'}
    assert set(arguments) <= set(options)


def test_its_nodes_wait_for_one_another_and_not_for_bringup(tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    setup = load_setup(make_parser().parse_args(['--params-file', 'panda']))
    values = node_values(setup, bag, with_bringup=False)
    names = ['recorder', 'plant', 'controller', 'reference']
    assert list(values) == names
    assert [values[x]['wait_for'] for x in names[1:]] == [names] * 3
    assert values['recorder']['bag'] == str(bag)
    events = load_setup(make_parser().parse_args(['--params-file', 'switch']))
    with pytest.raises(CtcError, match='events are not allowed in a launch file; run bringup'):
        node_values(events, None, with_bringup=False)
    with pytest.raises(CtcError, match='exists already'):
        node_values(setup, tmp_path, with_bringup=False)

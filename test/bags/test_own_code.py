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

"""A bag, a topic or a remote parameter runs no code; a user's own class does, if it is one."""

from __future__ import annotations

from pathlib import Path
import sys

from bags import entries, Entry, parameters, write_bag
from ctc_chattering.analysis.result import simulate
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.configuration import parameter_file
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.dynamics.registry import make_model
from ctc_chattering.errors import CtcError
from ctc_chattering.live.skeleton import skeleton_of
from ctc_chattering.ros.messages import message_type
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_commands import ctc, ctc_process, refused
import pytest
from std_msgs.msg import String

EXAMPLES = Path(__file__).resolve().parents[2] / 'examples'
SETUP = parameter_file.load(None, {'plant': {'duration': 0.3}})
#: A module that says that it was imported, and whose functions say that they were called.
TRAP = """
from pathlib import Path
Path(__file__).with_name('imported').touch()
def called(*arguments):
    Path(__file__).with_name('called').touch()
class Outer:
    class Law:
        made = called
class Callable:
    __new__ = called
"""
#: Named like a class in a bag: what it would have run, and which parameter.
NAMES = [('model', 'trap:called'), ('switching', 'trap:called'), ('law', 'trap:Outer.Law'),
         ('model', 'builtins:exec'), ('law', 'own_law:LeakyIntegral')]


@pytest.fixture
def trap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / 'trap.py').write_text(TRAP)
    monkeypatch.syspath_prepend(str(EXAMPLES))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, 'trap', raising=False)
    return tmp_path


def bag(path: Path, name: str, value: str) -> Path:
    """Write the bag of a run, which names something as an attacker would."""
    found: list[Entry] = entries(simulate(SETUP), SETUP.plant)
    found = [x for x in found if not x.topic.endswith('/parameters')]
    values = {**SETUP.controller.as_mapping(), name: value}
    plant = {**SETUP.plant.as_mapping(), 'friction_model': 'trap:called',
             **({'model': value} if name == 'model' else {})}
    write_bag(path / 'bag', [
        parameters('plant', 0, plant, True), parameters('controller', 0, values, True), *found])
    return path / 'bag'


def untouched(trap: Path) -> bool:
    return not (trap / 'imported').exists() and 'trap' not in sys.modules


@pytest.mark.parametrize(('name', 'value'), NAMES)
def test_a_bag_runs_nothing(name: str, value: str, trap: Path) -> None:
    refusal = f'(?s){name}.*(name code; give --{name} |not allowed)'
    with pytest.raises(CtcError, match=refusal) as error:
        read_bag(bag(trap, name, value))
    assert str(error.value).startswith(str(trap))
    assert untouched(trap)


def test_no_command_runs_it(trap: Path) -> None:
    """The module lies beside the bag, in the directory where the command runs."""
    path = bag(trap, 'model', 'trap:called')
    for word, *options in (('plot',), ('identify',), ('live', '--export', 'page.html')):
        refused(ctc(word, path, *options, cwd=trap), '--model package.module:Name')
    refused(ctc_process('export', path, cwd=trap, path=trap), '--model package.module:Name')
    assert untouched(trap)


def test_what_a_graph_names_stays_a_name(trap: Path) -> None:
    """Nothing is made of what a controller's parameters have, as the page shows them."""
    config = ControllerConfig.from_mapping(
        dict.fromkeys(('model', 'law', 'switching'), 'trap:called'))
    assert config.law == 'trap:called' and skeleton_of(config) is None
    assert untouched(trap)


def test_the_user_gives_the_class(trap: Path) -> None:
    found = read_bag(bag(trap, 'law', 'own_law:LeakyIntegral'), law='own_law:LeakyIntegral')
    assert found.config.law == 'own_law:LeakyIntegral'
    assert len(found.t) == 301
    result = ctc('export', trap / 'bag', '--law', 'own_law:LeakyIntegral', cwd=trap)
    assert '301 samples' in result.stdout, result.stderr


@pytest.mark.parametrize('name', ['trap:called', 'trap:Callable', 'trap:Outer', 'os:system',
                                  'own_law:Leaky', 'own_law:np'])
def test_what_a_user_names_is_a_class_of_the_kind(name: str, trap: Path) -> None:
    """Nothing of what is named is called before."""
    for make in (lambda: Controller(ControllerConfig(law=name)),
                 lambda: Controller(ControllerConfig(switching=name)),
                 lambda: make_model(name, 9.81),
                 lambda: Plant(PlantConfig(friction_model=name))):
        with pytest.raises(CtcError, match=f'(law|switching|model) {name} is not a class'):
            make()
    assert not (trap / 'called').exists()


def test_a_type_of_messages_imports_no_module(trap: Path) -> None:
    """A bag that is replayed names types: `trap` is a module, and no package of messages."""
    (trap / 'trapped').mkdir()
    (trap / 'trapped' / '__init__.py').write_text(TRAP)
    for kind in ('trap/msg/String', 'trapped/msg/String', 'os.path/msg/x', 'this/msg/x'):
        with pytest.raises(CtcError, match='not installed'):
            message_type(kind)
    assert untouched(trap) and not (trap / 'trapped' / 'imported').exists()
    assert message_type('std_msgs/msg/String') is String

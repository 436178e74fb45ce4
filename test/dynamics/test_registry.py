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

"""The models by name, among them a class of the user's."""

from __future__ import annotations

from collections.abc import Sequence
import sys
from types import SimpleNamespace

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.dynamics.registry import check_model, make_model, MODELS
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
from oracles import Masses, paper_g
import pytest
from urdfs import two_links


class Cart(Masses):
    """Carts of 2 kg on a slope."""

    def __init__(self, joint_names: Sequence[str], gravity: float) -> None:
        super().__init__((2.0 * np.eye(len(joint_names))).tolist())
        self.gravity = gravity

    def gravity_torque(self, q: Vector) -> Vector:
        return [self.gravity] * len(q)


class Pair(Cart):
    """Has two joints, whatever their names."""

    def __init__(self, _joint_names: Sequence[str], gravity: float) -> None:
        super().__init__(('a', 'b'), gravity)


class Broken(Cart):
    """Cannot be made."""

    def __init__(self, _joint_names: Sequence[str], _gravity: float) -> None:
        raise KeyError('wheel')


@pytest.fixture(autouse=True)
def own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have a module of the user's."""
    monkeypatch.setitem(sys.modules, 'carts.slope', SimpleNamespace(
        Cart=Cart, Pair=Pair, Broken=Broken, NoModel=dict))


def test_two_link() -> None:
    """Check that the gravity is passed on, and that other numbers of joints are refused."""
    assert MODELS == ('two_link', 'urdf')
    model = make_model('two_link', 3.0)
    np.testing.assert_allclose(model.gravity_torque([1.0, 0.5]), paper_g([1.0, 0.5], 3.0))
    for names in ((), ('a',), ('a', 'b', 'c')):
        with pytest.raises(CtcError, match='2 names'):
            check_model('two_link', names)


def test_urdf() -> None:
    """Check names, gravity and locked joints, and that there must be a text."""
    model = make_model('urdf', 2.0, ('b',), two_links(), {'a': 0.4})
    assert isinstance(model, UrdfModel)
    assert (model.joint_names, model.gravity) == (('b',), 2.0)
    assert model.gravity_torque([0.1]) == pytest.approx([2.0 * 1.5 * 0.25 * np.sin(0.5)])
    with pytest.raises(CtcError, match='model urdf needs the parameter description'):
        make_model('urdf', 9.81, ('a', 'b'), ' \n')


def test_a_class() -> None:
    """Check a controller and a plant of three joints with a class of the user's."""
    names = ('x', 'y', 'z')
    model = make_model('carts.slope:Cart', 1.5, names)
    assert (model.n, model.gravity_torque([0.0] * 3)) == (3, [1.5] * 3)
    config = ControllerConfig(model='carts.slope:Cart', joint_names=names, law='compensation',
                              gravity=1.5)
    rest = [0.0] * 3
    assert Controller(config).step(rest, rest, rest, rest, [1.0] * 3).tau == [3.5] * 3
    plant = Plant(PlantConfig(model='carts.slope:Cart', joint_names=names, gravity=1.5,
                              coulomb_friction=(0.0,) * 3))
    plant.step([3.5] * 3)
    assert plant.dq == pytest.approx([1e-3] * 3)


@pytest.mark.parametrize('name', ['puma', ':B', 'a.b', 'a..b:C', 'a:b:C'])
def test_names_that_are_none(name: str) -> None:
    for refuse in (lambda: check_model(name, ('a', 'b')), lambda: make_model(name, 9.81),
                   lambda: ControllerConfig(model=name), lambda: PlantConfig(model=name)):
        with pytest.raises(ParameterError, match=r'two_link \| urdf \| package.module:Name'):
            refuse()


@pytest.mark.parametrize(('name', 'words'), [
    ('nowhere.at_all:Cart', 'nowhere.at_all:Cart cannot be imported: ModuleNotFoundError'),
    ('carts.slope:Nothing', 'carts.slope:Nothing cannot be imported: AttributeError'),
    ('carts.slope:Broken', "cannot be constructed: KeyError: 'wheel'"),
    ('carts.slope:NoModel', 'not a class derived from ctc_chattering.Model'),
    ('carts.slope:Pair', 'joint_names: .* 2 names for model carts.slope:Pair')])
def test_classes_that_are_none(name: str, words: str) -> None:
    """Check one line that says what is wrong."""
    with pytest.raises(CtcError, match=words) as error:
        make_model(name, 9.81, ('a', 'b', 'c'))
    assert '\n' not in str(error.value)

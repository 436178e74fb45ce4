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

from pathlib import Path
import textwrap

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.dynamics.registry import check_model, make_model, MODELS
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
import numpy as np
from oracles import paper_g
import pytest
from urdfs import two_links

OWN = textwrap.dedent('''
    from ctc_chattering.dynamics.model import Model
    from ctc_chattering.errors import CtcError

    class Cart(Model):
        """A row of carts on a slope."""

        def __init__(self, joint_names, gravity):
            self.n, self.gravity = len(joint_names), gravity

        def mass_matrix(self, q):
            return [[2.0 * (i == j) for i in range(self.n)] for j in range(self.n)]

        def coriolis_matrix(self, q, dq):
            return [[0.0] * self.n] * self.n

        def gravity_torque(self, q):
            return [self.gravity] * self.n

        def potential_energy(self, q):
            return self.gravity * sum(q)

    class Pair(Cart):
        def __init__(self, joint_names, gravity):
            super().__init__(('a', 'b'), gravity)

    class Picky(Cart):
        def __init__(self, joint_names, gravity):
            raise CtcError('no carts today')

    class Broken(Cart):
        def __init__(self, joint_names, gravity):
            raise KeyError('wheel')

    class NoModel:
        n = 2
        def __init__(self, joint_names, gravity):
            pass
''')


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the name of a module of the user's."""
    tmp_path.joinpath('carts').mkdir()
    (tmp_path / 'carts' / '__init__.py').touch()
    (tmp_path / 'carts' / 'slope.py').write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    return 'carts.slope'


def test_two_link() -> None:
    """Check that the gravity is passed on, and that other numbers of joints are refused."""
    assert MODELS == ('two_link', 'urdf')
    model = make_model('two_link', 3.0)
    assert isinstance(model, TwoLink)
    np.testing.assert_allclose(model.gravity_torque([1.0, 0.5]), paper_g([1.0, 0.5], 3.0))
    check_model('two_link', ('a', 'b'))
    for names in ((), ('a',), ('a', 'b', 'c')):
        with pytest.raises(CtcError, match='2 names'):
            check_model('two_link', names)
        with pytest.raises(CtcError, match='2 names'):
            make_model('two_link', 9.81, names)


def test_urdf() -> None:
    """Check names, gravity and locked joints, and that there must be a text."""
    model = make_model('urdf', 2.0, ('b',), two_links(), {'a': 0.4})
    assert isinstance(model, UrdfModel)
    assert (model.joint_names, model.gravity) == (('b',), 2.0)
    assert model.gravity_torque([0.1]) == pytest.approx([2.0 * 1.5 * 0.25 * np.sin(0.5)])
    for text in ('', ' \n'):
        with pytest.raises(CtcError, match='model urdf needs the parameter description'):
            make_model('urdf', 9.81, ('a', 'b'), text)


def test_a_class(own: str) -> None:
    """Check a controller and a plant of three joints with a class of the user's."""
    names = ('x', 'y', 'z')
    model = make_model(f'{own}:Cart', 1.5, names)
    assert (model.n, model.gravity_torque([0.0] * 3)) == (3, [1.5] * 3)
    config = ControllerConfig(model=f'{own}:Cart', joint_names=names, law='compensation',
                              gravity=1.5)
    rest = [0.0] * 3
    assert Controller(config).step(rest, rest, rest, rest, [1.0] * 3).tau == [3.5] * 3
    plant = Plant(PlantConfig(model=f'{own}:Cart', joint_names=names, gravity=1.5,
                              coulomb_friction=(0.0,) * 3))
    plant.step([3.5] * 3)
    assert plant.dq == pytest.approx([1e-3] * 3)


@pytest.mark.parametrize('name', ['puma', '', 'a:', ':B', 'a.b', 'a..b:C', 'a b:C', 'a:b:C'])
def test_names_that_are_none(name: str) -> None:
    for refuse in (lambda: check_model(name, ('a', 'b')), lambda: make_model(name, 9.81),
                   lambda: ControllerConfig(model=name), lambda: PlantConfig(model=name)):
        with pytest.raises(ParameterError, match=r'two_link \| urdf \| package.module:Name'):
            refuse()


@pytest.mark.parametrize(('name', 'words'), [
    ('nowhere.at_all:Cart', 'no model nowhere.at_all:Cart: ModuleNotFoundError'),
    ('carts.slope:Nothing', 'no model carts.slope:Nothing: AttributeError'),
    ('carts.slope:Broken', "cannot be made: KeyError: 'wheel'"),
    ('carts.slope:Picky', '^no carts today$'),
    ('carts.slope:NoModel', 'no class derived from ctc_chattering.Model'),
    ('carts.slope:Pair', 'joint_names: .* 2 names for model carts.slope:Pair')])
@pytest.mark.usefixtures('own')
def test_classes_that_are_none(name: str, words: str) -> None:
    """Check one line that says what is wrong."""
    with pytest.raises(CtcError, match=words) as error:
        make_model(name, 9.81, ('a', 'b', 'c'))
    assert '\n' not in str(error.value)

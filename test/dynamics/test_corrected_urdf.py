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

"""Bodies: pseudo-inertias, what no rigid body has, and corrected URDFs."""

from __future__ import annotations

from itertools import product
import re
import xml.etree.ElementTree as ET

from ctc_chattering.dynamics.corrected_urdf import corrected_urdf
from ctc_chattering.dynamics.model_check import inertia_faults
from ctc_chattering.dynamics.pseudo_inertia import parameters_of, pseudo_inertia
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array
import mujoco
import numpy as np
import pinocchio as pin
import pytest
from urdfs import grip, joint, link, PANDA, panda, TWO_LINKS, two_links, urdf

ROBOTS = {'panda': (panda(), PANDA), 'two links': (two_links(), ('b', 'a'))}


def rows(model: UrdfModel) -> Array:
    """Return the parameters of the bodies, shape (n, 10)."""
    return model.inertial_parameters().reshape(-1, 10)


def heavier(model: UrdfModel, seed: int = 1) -> Array:
    """Return the parameters with a mass somewhere on each body but the first."""
    rng, found = np.random.default_rng(seed), rows(model)
    for i in range(1, model.n):
        at = np.append(rng.uniform(-0.2, 0.2, 3), 1.0)
        found[i] = parameters_of(
            pseudo_inertia(found[i]) + 0.3 * found[i, 0] * np.outer(at, at))
    return found


def read_by_pinocchio(text: str, names: tuple[str, ...]) -> Array:
    """Return the parameters that Pinocchio has of the whole text, other joints locked at 0."""
    full = pin.buildModelFromXML(text)
    others = [i for i in range(1, full.njoints) if full.names[i] not in names]
    model = pin.buildReducedModel(full, others, pin.neutral(full))
    return np.array([model.inertias[model.getJointId(name)].toDynamicParameters()
                     for name in names])


@pytest.mark.parametrize('robot', list(ROBOTS))
def test_pinocchio_reads_the_parameters(robot: str) -> None:
    text, names = ROBOTS[robot]
    model = UrdfModel(text, names)
    wanted = heavier(model)
    made = corrected_urdf(text, names, wanted, np.linspace(0.1, 0.5, model.n).tolist())
    np.testing.assert_allclose(read_by_pinocchio(made, names), wanted, rtol=0, atol=1e-9)
    assert UrdfModel(made, names).rotor_inertias == pytest.approx(np.linspace(0.1, 0.5, model.n))
    assert inertia_faults(made, names) == inertia_faults(text, names)


@pytest.mark.parametrize('robot', list(ROBOTS))
def test_all_else_stays(robot: str) -> None:
    text, names = ROBOTS[robot]
    model = UrdfModel(text, names)
    same, made = (ET.canonicalize(
        corrected_urdf(text, names, parameters, [rotor] * model.n, [0, 0, -9.81]),
        with_comments=True) for parameters, rotor in ((rows(model), 0.0), (heavier(model), 0.2)))
    again = corrected_urdf(made, names, rows(model), [0.3] * model.n)
    text = ET.canonicalize(text, with_comments=True)
    assert same == text
    inertial = re.compile(r'<inertial>.*?</inertial>', re.DOTALL)
    rotor = re.compile(
        r'<dynamics damping="0" rotor_inertia="0.2"></dynamics>| rotor_inertia="0.2"')
    assert inertial.sub('', rotor.sub('', made)) == inertial.sub('', text)
    changed = [a for a, b in zip(inertial.findall(text), inertial.findall(made)) if a != b]
    assert len(changed) == model.n - 1
    assert again.count('rotor_inertia="0.3"') == again.count('rotor_inertia') == model.n


@pytest.mark.parametrize('robot', list(ROBOTS))
def test_gravity_is_along_z_of_the_new_root(robot: str) -> None:
    """Against Pinocchio with that gravity; MuJoCo takes the text too."""
    text, names = ROBOTS[robot]
    gravity = [0.5, -0.8, -9.7]
    model = UrdfModel(text, names, float(np.linalg.norm(gravity)))
    made = corrected_urdf(text, names, rows(model), (), gravity)
    tilted = UrdfModel(made, names, float(np.linalg.norm(gravity)))
    model._model.gravity.linear = np.array(gravity)
    q = np.random.default_rng(2).uniform(-1, 1, model.n).tolist()
    np.testing.assert_allclose(tilted.gravity_torque(q), model.gravity_torque(q), atol=1e-12)
    np.testing.assert_allclose(tilted.mass_matrix(q), model.mass_matrix(q), atol=1e-12)
    assert pin.buildModelFromXML(made).njoints == pin.buildModelFromXML(text).njoints
    plain = re.sub(r'<(visual|collision)>.*?</\1>', '', made, flags=re.DOTALL)
    assert mujoco.MjModel.from_xml_string(plain).nv >= model.n
    # The arm itself keeps its frames: only the way from the root is turned.
    before, after = Tree(text), Tree(made)
    moved = [name for name in before.origins if before.origins[name] != after.origins[name]]
    assert moved == []


def test_a_wall_mount_is_tilted_too() -> None:
    """Pitch is a right angle, where roll and yaw are one."""
    text = urdf([link('world'), link('base', 1.0, inertia=(1, 1, 1)),
                 link('arm', 2.0, (0.2, 0.1, 0.3), (0.1, 0.1, 0.1)),
                 joint('mount', 'fixed', 'world', 'base', rpy='0.3 1.5707963267948966 0.2'),
                 joint('turn', 'continuous', 'base', 'arm', '1 0 0')])
    for x, y in product((-0.7, 0.0, 0.4), repeat=2):
        model = UrdfModel(text, ['turn'])
        made = corrected_urdf(text, ['turn'], rows(model), (), [x, y, -9.0])
        size = float(np.linalg.norm([x, y, 9.0]))
        model._model.gravity.linear = np.array([x, y, -9.0])
        assert UrdfModel(made, ['turn'], size).gravity_torque([0.7]) == pytest.approx(
            model.gravity_torque([0.7]))


def test_links_of_one_body() -> None:
    """The heaviest takes the difference; if nothing can have it, each its part of the mass."""
    text, names = grip('fixed', ''), ['turn']
    model = UrdfModel(text, names)
    body = rows(model)
    at = np.array([0.1, 0.2, 0.0, 1.0])
    more = parameters_of(pseudo_inertia(body[0]) + 0.5 * np.outer(at, at))[None]
    masses = [float(x.get('value', '')) for x in ET.fromstring(
        corrected_urdf(text, names, more).encode()).iter('mass')]
    assert masses == pytest.approx([2.5, 0.3, 0.4])
    less = 0.1 * body
    made = corrected_urdf(text, names, less)
    masses = [float(x.get('value', '')) for x in ET.fromstring(made.encode()).iter('mass')]
    assert masses == pytest.approx([0.2, 0.03, 0.04])
    np.testing.assert_allclose(rows(UrdfModel(made, names)), less, atol=1e-12)
    assert not inertia_faults(made, names)


def test_a_locked_joint_where_it_is() -> None:
    text, names, locked = grip(mimic=''), ['turn'], {'f1': 0.3, 'f2': -0.2}
    model = UrdfModel(text, names, locked=locked)
    wanted = rows(model) * 1.5
    made = corrected_urdf(text, names, wanted, locked=locked)
    np.testing.assert_allclose(
        rows(UrdfModel(made, names, locked=locked)), wanted, atol=1e-12)


@pytest.mark.parametrize('change, words', [
    ({'parameters': np.ones((2, 10))}, 'no body can have'),
    ({'parameters': np.full((2, 10), np.nan)}, 'no body can have'),
    ({'rotor': [np.nan, 0.0]}, 'cannot be corrected'),
    ({'rotor': [0.1]}, 'cannot be corrected'),
    ({'parameters': np.zeros((2, 10))}, 'no body can have'),
    ({'rotor': [-0.1, 0.0]}, 'negative'),
    ({'gravity': [0.0, 0.0, 0.0]}, 'three numbers that are not all 0'),
    ({'gravity': [0.0, -9.81]}, 'three numbers that are not all 0')])
def test_refused(change: dict[str, object], words: str) -> None:
    arguments = {'parameters': rows(UrdfModel(two_links(), TWO_LINKS)), **change}
    with pytest.raises(CtcError, match=words):
        corrected_urdf(two_links(), TWO_LINKS, **arguments)  # type: ignore[arg-type]

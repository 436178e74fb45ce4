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

"""Files of the package and of robots: where they are found, and what is said if not."""

from __future__ import annotations

import math
import os
from pathlib import Path
import shutil
import subprocess
import sys

import ctc_chattering
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.package_share import (
    EXPERIMENTS,
    find_config,
    find_mesh,
    read_description,
)
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation.closed_loop import Event
import pytest
from urdfs import panda, two_links, ur5

SHOW = 'from ctc_chattering.configuration.package_share import config_directory as c; print(c())'
SOURCE = Path(__file__).parents[2]


def shown(site: Path, code: str = SHOW) -> subprocess.CompletedProcess[str]:
    """Run `code` with the package of the directory `site`."""
    return subprocess.run([sys.executable, '-B', '-c', code], cwd=site, text=True,
                          capture_output=True, timeout=60, check=False,
                          env={'PYTHONPATH': str(site)})


def copied(site: Path) -> None:
    source, target = Path(ctc_chattering.__file__).parent, site / 'ctc_chattering'
    (target / 'configuration').mkdir(parents=True)
    for name in ('__init__.py', 'errors.py', 'configuration/__init__.py',
                 'configuration/package_share.py'):
        shutil.copy(source / name, target / name)


def test_installed_below_a_prefix(tmp_path: Path) -> None:
    """Check an installation, and that a `config` beside it which is not ours is passed over."""
    site = tmp_path / 'lib' / 'python3' / 'site-packages'
    copied(site)
    share = tmp_path / 'share' / 'ctc_chattering' / 'config'
    shutil.copytree(SOURCE / 'config', share)
    (site / 'config').mkdir()
    (site / 'config' / 'friction.yaml').write_text('')
    assert Path(shown(site).stdout.strip()) == share


def test_not_installed(tmp_path: Path) -> None:
    """Check the error, one line of ours."""
    copied(tmp_path)
    code = (f'import sys\nfrom ctc_chattering.errors import CtcError\nsys.prefix = "/nowhere"\n'
            f'try:\n    {SHOW}\nexcept CtcError as error:\n    print("refused:", error)')
    result = shown(tmp_path, code.replace('; print', '\n    print'))
    assert result.stdout.startswith('refused: ')
    assert len(result.stdout.splitlines()) == 1


ROBOTS = 'package://example-robot-data/robots'


@pytest.fixture(autouse=True)
def no_installation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)


def install(prefix: Path, text: str, package: str = 'arm', path: str = 'urdf/arm.urdf') -> Path:
    """Put a description where a package below `prefix` has it."""
    file = prefix / 'share' / package / path
    file.parent.mkdir(parents=True)
    file.write_text(text, encoding='utf-8')
    return file


def refusal(location: str) -> str:
    with pytest.raises(CtcError) as refused:
        read_description(location)
    text = str(refused.value)
    assert len(text.splitlines()) == 1
    assert text.startswith(f'description: {location}: ')
    return text.removeprefix(f'description: {location}: ')


def test_a_path_is_read_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = two_links().replace('name="r"', 'name="Änderung"')
    (tmp_path / 'arm.urdf').write_text(text, encoding='utf-8')
    assert read_description(str(tmp_path / 'arm.urdf')) == text
    monkeypatch.chdir(tmp_path)
    assert read_description('arm.urdf') == text


def test_a_package_is_found_below_the_installations_in_their_order(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As ROS has it: an overlay stands before what it lies upon; empty entries do not matter."""
    overlay, base = tmp_path / 'overlay', tmp_path / 'base'
    install(base, 'base')
    monkeypatch.setenv('AMENT_PREFIX_PATH', os.pathsep.join([str(overlay), '', str(base), '']))
    assert read_description('package://arm/urdf/arm.urdf') == 'base'
    install(overlay, 'overlay')
    assert read_description('package://arm/urdf/arm.urdf') == 'overlay'


def test_a_package_is_found_in_the_environment_and_in_a_wheel(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    environment, site = tmp_path / 'environment', tmp_path / 'site'
    install(environment, 'of the environment', 'one')
    install(site / 'cmeel.prefix', 'of a wheel', 'two')
    install(site / 'cmeel.prefix', 'hidden', 'one')
    monkeypatch.setattr(sys, 'prefix', str(environment))
    monkeypatch.setattr(sys, 'path', ['', str(tmp_path / 'nothing'), str(site)])
    assert read_description('package://one/urdf/arm.urdf') == 'of the environment'
    assert read_description('package://two/urdf/arm.urdf') == 'of a wheel'


def test_the_robots_of_the_configurations_come_from_their_wheel() -> None:
    """The same texts as by the wheel's list of files."""
    assert read_description(f'{ROBOTS}/panda_description/urdf/panda.urdf') == panda()
    assert read_description(f'{ROBOTS}/ur_description/urdf/ur5_robot.urdf') == ur5()


def test_what_is_not_installed_is_said_with_the_places(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, '', path='urdf/arm.urdf/a_directory')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    for location in ('package://arm/urdf/arm.urdf', 'package://arm/no.urdf', 'package://arm',
                     'package://', 'package://nowhere/x'):
        text = refusal(location)
        below = '/'.join(['share', *location.removeprefix('package://').split('/')]).rstrip('/')
        assert text.startswith(f'there is no installed file {below} below ')
        assert str(tmp_path) in text
        assert sys.prefix in text


def test_what_cannot_be_read_is_said_in_one_line(tmp_path: Path) -> None:
    binary = tmp_path / 'arm.urdf'
    binary.write_bytes(b'\xff\xfe\x00\x01')
    assert refusal(str(binary)) == 'not a text file'
    assert refusal(str(tmp_path / 'no.urdf')) == 'No such file or directory'
    assert refusal(str(tmp_path)) == 'is a folder; a regular file is needed'
    assert refusal(f'{binary}/x') == 'Not a directory'
    assert refusal('a\0b') == 'embedded null byte'
    assert 'too long' in refusal('x' * 5000)


@pytest.mark.parametrize(('shared', 'needs'), [
    ('model: urdf', {'plant', 'controller', 'reference'}), ('', set())])
def test_a_parameter_file_reads_it_for_those_who_need_it(
        tmp_path: Path, shared: str, needs: set[str]) -> None:
    robot, file = tmp_path / 'arm.urdf', tmp_path / 'params.yaml'
    file.write_text(f"""
/**: {{ros__parameters: {{joint_names: [a, b], description: {robot}}}}}
reference: {{ros__parameters: {{center: [0, 0], amplitude: [0.1, 0.1]}}}}
""".replace('joint_names', f'{shared}, joint_names' if shared else 'joint_names'))
    if needs:
        with pytest.raises(CtcError, match=r'^description: .*arm\.urdf: No such file'):
            parameter_file.load(file)
        robot.write_text(two_links())
    setup = parameter_file.load(file)
    assert setup.descriptions == dict.fromkeys(needs, two_links())
    assert parameter_file.load(file, {'/**': {'description': ''}}).descriptions == {}


def test_files_of_meshes_are_of_known_formats_and_not_too_large(tmp_path: Path) -> None:
    """Check what a URDF of others may name: no other file is opened, and no huge one."""
    for name, size in (('a.stl', 84), ('b.DAE', 100), ('huge.stl', 50_000_001), ('a.txt', 9)):
        with (tmp_path / name).open('wb') as file:
            file.truncate(size)
    assert find_mesh(f'file://{tmp_path}/a.stl') == tmp_path / 'a.stl'
    assert find_mesh(f'{tmp_path}/b.DAE') == tmp_path / 'b.DAE'
    for name in ('huge.stl', 'a.txt', 'none.stl', ''):
        assert find_mesh(f'file://{tmp_path}/{name}') is None
    for location in ('file:///etc/passwd', '/dev/zero', 'package://nobody/has/this.stl'):
        assert find_mesh(location) is None


def test_all_figures_and_the_switch() -> None:
    """Check both laws of both experiments, and the switch from one to the other at 5 s."""
    setups = {name: parameter_file.load(find_config(file), {'controller': values})
              for name, (file, values) in EXPERIMENTS.items()}
    assert len(setups) == len(EXPERIMENTS) == 6
    observer = setups['friction_chattering_implicit_observer'].controller
    assert (observer.law, observer.switching, observer.ka) == (
        'chattering', 'implicit_observer', (12.0, 12.0))
    others = [s.controller for name, s in setups.items() if 'observer' not in name]
    assert {(c.switching, c.ka) for c in others} == {('sign', (10.0, 10.0))}
    assert {(s.plant.experiment, s.controller.law) for s in setups.values()} == {
        ('friction', 'compensation'), ('friction', 'chattering'),
        ('disturbance', 'compensation'), ('disturbance', 'chattering'),
        ('switch', 'compensation')}
    for name, setup in setups.items():
        expected = (Event(5.0, 'controller', {'law': 'chattering'}),) if name == 'switch' else ()
        c, p, r = setup.controller, setup.plant, setup.reference
        assert (setup.events, p.pacing, p.duration) == (expected, 'lockstep', 10.0)
        # Section 4, number by number.
        assert (c.kp, c.kv, c.lambda_, c.b) == ((100, 100), (50, 50), 10, 1)
        assert (p.coulomb_friction, p.gravity) == ((9.9, 9.9), 9.81)
        assert p.disturbance_frequency == (1, 2)
        assert p.disturbance_amplitude == ((1, 1) if p.experiment == 'disturbance' else (0, 0))
        assert (p.initial_position, p.initial_velocity) == ((0, 0), (0, 0))
        assert (r.center, r.amplitude) == ((math.pi, math.pi / 2), (0.5, 0.5))
        assert (r.frequency, r.phase) == ((1, 1), (0, 0))
        assert c.control_period == p.control_period == r.control_period == 0.001
        assert c.effort_limit == p.torque_saturation

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

"""Command lines of the executables: what is meant is applied, what means nothing is refused."""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys
from typing import Any

from ctc_chattering import __version__
from ctc_chattering.cli import bringup, node
from ctc_chattering.cli.command_line import guarded
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.node_parameters import NODE_DESCRIPTIONS
from ctc_chattering.errors import UsageError
from ctc_chattering.ros import ros_arguments
from ctc_chattering.ros.ros_arguments import bringup_values, parse
import pytest

ROOT = Path(__file__).parents[2]
FRICTION = ROOT / 'config' / 'friction.yaml'


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / 'p.yaml'


def values(executable: str, *arguments: object) -> dict[str, Any]:
    _, ros = parse(['--ros-args', *map(str, arguments)])
    return ros.values([executable])[executable]


def test_the_last_one_wins(file: Path) -> None:
    """Check what ROS itself takes otherwise: files with both sections, -p after a file's own."""
    file.write_text('controller: {ros__parameters: {law: chattering, b: 2.0}}\n'
                    '/**: {ros__parameters: {law: compensation, gravity: 1.0, duration: 3.0}}\n')
    given = ('--params-file', file)
    assert values('controller', *given) == {'law': 'chattering', 'b': 2.0, 'gravity': 1.0}
    assert values('controller', *given, '-p', 'law:=compensation')['law'] == 'compensation'
    assert values('controller', '-p', 'law:=compensation', *given)['law'] == 'chattering'
    assert values('controller', '-p', 'controller:b:=3', '-p', 'b:=4') == {'b': 4.0}
    assert values('plant', *given) == {'gravity': 1.0, 'duration': 3.0}


@pytest.mark.parametrize(('section', 'remaps', 'applies'), [
    ('controller', [], True), ('controller', ['__ns:=/r'], True),
    ('/r/controller', ['__ns:=/r'], True), ('/r/controller', [], False),
    ('/r/controller', ['__ns:=/s'], False), ('/r/controller', ['__ns:=/r', '__ns:=/s'], True),
    ('/**', ['__ns:=/r/s'], True), ('/r/**', ['__ns:=/r'], True), ('/r/**', ['__ns:=/s'], False),
    ('/*', [], True), ('/*', ['__ns:=/r'], False), ('/**/controller', ['__ns:=/r/s'], True),
    ('controller', ['__node:=left'], False), ('left', ['__node:=left'], True),
    ('left', ['controller:__node:=left'], True)])
def test_sections_by_name_and_namespace(
        file: Path, section: str, remaps: list[str], applies: bool) -> None:
    file.write_text(f'"{section}": {{ros__parameters: {{b: 2.0}}}}\n')
    arguments = [word for remap in remaps for word in ('-r', remap)]
    if applies:
        assert values('controller', *arguments, '--params-file', file) == {'b': 2.0}
    else:
        with pytest.raises(UsageError, match='no section is for'):
            values('controller', *arguments, '--params-file', file)


def test_what_is_for_ros_is_left_to_ros() -> None:
    rest = ['-r', 'joint_states:=/a', '--log-level', 'debug', '--disable-rosout-logs']
    own, ros = parse(['--x', '--ros-args', *rest, '-p', 'b:=2', '--', '--y'])
    assert (own, list(ros.for_ros)) == (['--x', '--y'], rest)
    assert ros.values(['controller']) == {'controller': {'b': 2.0}}


@pytest.mark.parametrize(('arguments', 'words'), [
    (['--law', 'compensation'], ['--law compensation']), (['compensation'], ['compensation']),
    (['--ros-args', '-p', 'lawx:=foo'], ['lawx', 'law']),
    (['--ros-args', '-p', 'pacing:=lockstep'], ['pacing']),
    (['--ros-args', '-p', 'plant:b:=1.0'], ['no node is called plant', 'controller']),
    (['--ros-args', '-r', '__node:=x', '-p', 'controller:b:=1.0'], ['controller', 'x']),
    (['--ros-args', '-p', 'qos_overrides./joint_states.subscription.depth:=1'], ['qos_over']),
    (['--ros-args', '-p', 'law'], ['NAME:=VALUE']), (['--ros-args', '-p', 'b:=[1'], ['YAML']),
    (['--ros-args', '-p', 'b:='], ['YAML']), (['--ros-args', '-p'], ['NAME:=VALUE'])])
def test_what_means_nothing_is_refused_in_one_line_with_status_2(
        arguments: list[str], words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert guarded('controller', lambda: node._run('controller', arguments)) == 2
    output = capsys.readouterr()
    assert output.out == ''
    assert output.err.startswith('controller: ')
    assert len(output.err.splitlines()) == 1
    assert [word for word in words if word not in output.err] == []


@pytest.mark.parametrize(('arguments', 'words'), [
    (['--laws', 'compensation'], ['--laws']), (['--pacing', 'fast'], ['fast', 'lockstep']),
    (['--params-file', 'missing.yaml'], ['missing.yaml: there is no such file']),
    (['--duration', 'nan'], ['bringup: duration: nan is not allowed']),
    (['--control-period', '0.0'], ['control_period: 0.0 is not allowed']),
    (['--ros-args', '-p', 'lawx:=foo'], ['lawx', 'law']),
    (['--ros-args', '-p', 'nod:law:=x'], ['nod', 'controller']),
    (['--ros-args', '-r', '__node:=foo'], ['__node']),
    (['--ros-args', '-r', 'controller:__node:=foo'], ['__node']),
    (['--ros-args', '-r', 'controller:__ns:=/foo'], ['__ns']),
    (['--pacing', 'real_time', '--ros-args', '-p', 'use_sim_time:=true'], ['real_time'])])
def test_bringup_refuses_what_means_nothing(
        arguments: list[str], words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert bringup.main(arguments) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    assert [word for word in words if word not in error] == []


def test_bringup_overwrites_nothing_and_refuses_what_a_node_would(
        file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as secure:
        secure.setenv('ROS_SECURITY_ENABLE', 'true')
        secure.setenv('ROS_SECURITY_STRATEGY', 'Enforce')
        assert bringup.main(['--record', str(tmp_path / 'bag')]) == 1
    error = capsys.readouterr().err
    assert 'ROS_SECURITY_KEYSTORE is not set' in error and len(error.splitlines()) == 1
    assert bringup.main(['--record', '/']) == 1
    assert capsys.readouterr().err == 'bringup: /: exists already, not overwritten\n'
    (tmp_path / 'link').symlink_to('nowhere')
    assert bringup.main(['--record', str(tmp_path / 'link')]) == 1
    assert capsys.readouterr().err.endswith('link: exists already, not overwritten\n')
    assert bringup.main(['--ros-args', '--params-file', 'x' * 300]) == 2
    assert capsys.readouterr().err.endswith('x: there is no such file\n')
    file.write_text("bringup: {ros__parameters: {events: ['1.0 controller ka [-1.0, 0.0]']}}")
    assert bringup.main(['--params-file', str(file)]) == 1
    assert capsys.readouterr().err.startswith('bringup: ka: [-1.0, 0.0] is not allowed')


def test_arguments_of_bringup_for_ros_stand_above_its_own(file: Path) -> None:
    file.write_text('controller: {ros__parameters: {b: 2.0, kp: [1, 2.5]}}\n')
    _, ros = parse(['--ros-args', '-p', 'law:=chattering', '--params-file', str(file), '-p',
                    'law:=compensation', '-p', 'plant:gravity:=1', '-p', 'controller:gravity:=1',
                    '-p', 'control_period:=0.002', '-p', 'use_sim_time:=true'])
    setup = parameter_file.load(FRICTION, {
        **bringup_values(ros), '/**': {'control_period': 0.005}})
    assert (setup.controller.law, setup.controller.b) == ('compensation', 2.0)
    assert setup.controller.kp == (1.0, 2.5)
    assert setup.plant.gravity == setup.controller.gravity == 1.0
    assert setup.plant.control_period == setup.reference.control_period == 0.002
    with pytest.raises(UsageError, match='plant'):
        file.write_text('/other/plant: {ros__parameters: {gravity: 1.0}}\n')
        bringup_values(parse(['--ros-args', '--params-file', str(file)])[1])


#: Hides packages, before anything is imported.
WITHOUT = """
import sys
class Without:
    def find_spec(self, name, path=None, target=None):
        top = name.split('.')[0]
        if top in {missing} or (top.endswith('_msgs') and 'rclpy' in {missing}):
            raise ModuleNotFoundError(name, name=name)
sys.meta_path.insert(0, Without())
"""


def python_without(missing: tuple[str, ...], code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, '-c', WITHOUT.format(missing=missing) + code], cwd=ROOT, text=True,
        timeout=60, capture_output=True, check=True)


def test_help_and_version_need_no_ros() -> None:
    """Check both in a Python that has none, and what is said there when a node is to run."""
    names = list(NODE_DESCRIPTIONS)
    result = python_without(('rclpy',), f"""
from ctc_chattering.cli.node import main
for name in {names}:
    for more in (['--version'], ['--help'], []):
        try:
            print('status', main(name, [name, *more]))
        except SystemExit as end:
            print('status', end.code)
""")
    for name in names:
        assert f'{__version__}\nstatus 0\nusage: {name} ' in result.stdout
        assert NODE_DESCRIPTIONS[name] in result.stdout
    assert result.stdout.count(
        '`ctc parameters` lists all parameters.\nstatus 0\nstatus 2\n') == len(names)
    for name, line in zip(names, result.stderr.splitlines(), strict=True):
        assert line.startswith(f'{name}: ')
        assert line.endswith(' is missing; install it (docs/install.md)')


def test_nodes_of_the_loop_need_no_tools() -> None:
    """Check that what only tools need is not imported, and is named with its command."""
    result = python_without(('tqdm', 'matplotlib', 'rosbags', 'mcap'), """
import ctc_chattering.nodes.plant, ctc_chattering.nodes.controller
import ctc_chattering.nodes.reference
from ctc_chattering.cli import bringup, ctc
assert bringup.main([]) == 2
assert ctc.main(['map', 'gains']) == 2
""")
    assert result.stderr.splitlines() == [
        f'{command}: the Python package tqdm is missing; install it (docs/install.md)'
        for command in ('bringup', 'ctc map')]


def test_an_error_of_ours_is_not_taken_for_a_missing_package(
        capsys: pytest.CaptureFixture[str]) -> None:
    def command() -> int:
        raise ModuleNotFoundError('no', name='ctc_chattering.nowhere')

    assert guarded('x', command) == 1
    said = capsys.readouterr().err
    assert 'docs/install.md' not in said and 'defect of ctc_chattering' in said
    assert ros_arguments.parse([])[0] == []

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

"""From a URDF to a run without a refusal."""

from __future__ import annotations

from pathlib import Path
import re
from typing import Any

from ctc_chattering.analysis.result import simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.arm_knowledge import ArmFacts, Source
from ctc_chattering.configuration.new_robot import new_robot, NewRobot
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.runs.recommended import gains_by_rule
from ctc_commands import ctc, refused
import numpy as np
import pytest
from urdfs import FIRST_LIMITS, L1, mobile_manipulator, panda, two_links, write_urdf


@pytest.mark.parametrize('limit', ['effort="-1" velocity="1"', 'effort="10" velocity="-1"',
                                   'lower="1" upper="0" effort="1" velocity="1"',
                                   'lower="1" upper="1" effort="1" velocity="1"'])
def test_limits_that_contradict_themselves_are_refused(limit: str, tmp_path: Path) -> None:
    location = write_urdf(tmp_path / 'odd.urdf', two_links().replace(FIRST_LIMITS, limit))
    with pytest.raises(CtcError, match=r'^URDF: joint a: (effort|velocity|lower) is '):
        new_robot(location)


def test_friction_of_the_urdf_is_taken_where_it_fits_the_bodies(tmp_path: Path) -> None:
    """The plant has it, and ka has room for it; placeholders and what is missing are assumed."""
    def arm(*dynamics: str) -> str:
        text = two_links()
        for (name, more) in zip('ab', dynamics):
            text = text.replace(f'<joint name="{name}" type="revolute">',
                                f'<joint name="{name}" type="revolute">{more}')
        return text

    taken = new_robot(write_urdf(tmp_path / 'a.urdf', arm(
        '<dynamics friction="3" damping="1.5"/>', '<dynamics damping="0.2"/>')))
    assert taken.values['plant']['viscous_friction'] == [1.5, 0.2]
    assert taken.values['plant']['coulomb_friction'][0] == 3.0
    assert taken.values['controller']['ka'][0] > 3.0 + 1.5 * 0.5 * np.pi
    assert taken.friction.coulomb_described == ('a',)
    assert taken.friction.viscous_described == ('a', 'b')
    assert taken.friction.implausible == ()
    bare = new_robot(write_urdf(tmp_path / 'b.urdf', arm()))
    assert bare.values['plant']['viscous_friction'] == [0.0, 0.0]
    assert bare.values['plant']['coulomb_friction'][1] == (
        taken.values['plant']['coulomb_friction'][1])
    for too_much in ('friction="15"', 'damping="40"'):  # Of 40 N*m, and of 0.1 kg*m^2.
        found = new_robot(write_urdf(tmp_path / 'c.urdf', arm(
            f'<dynamics {too_much}/>', '<dynamics friction="0.5" damping="30"/>')))
        assert found.friction.implausible == ('a', 'b')
        assert found.values == {
            **bare.values, '/**': {**bare.values['/**'], 'description': f'{tmp_path}/c.urdf'}}


def test_a_robot_with_the_damping_of_a_simulator_follows_its_motion(tmp_path: Path) -> None:
    """1 N*m and 1 N*m*s/rad on a wrist of 3e-4 kg*m^2: the simulated motion would diverge."""
    wrist = two_links().replace('type="revolute">', 'type="revolute"><dynamics friction="1" '
                                'damping="1"/>').replace('mass value="1.5"', 'mass value="0.05"')
    light = wrist.replace('ixx="0.05" iyy="0.05" izz="0.01"', 'ixx="3e-4" iyy="3e-4" izz="1e-4"'
                          ).replace('xyz="0 0 -0.25"', 'xyz="0 0 -0.01"')
    assert light != wrist
    found = new_robot(write_urdf(tmp_path / 'light.urdf', light))
    assert found.friction.implausible == ('b',)
    result = simulate(parameter_file.load(None, {
        **found.values, 'plant': {**found.values['plant'], 'duration': 3.0}}))
    assert np.abs(result.e[result.t >= 2.5]).max() < 0.01


def test_the_command_writes_a_file_that_runs(tmp_path: Path) -> None:
    (tmp_path / 'arm.urdf').write_text(two_links())
    done = ctc('new-robot', '--urdf', 'arm.urdf', '--out', 'mine/arm.yaml', cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1].startswith('wrote mine/arm.yaml; next: ctc compile mine')
    text = (tmp_path / 'mine' / 'arm.yaml').read_text()
    assert text.startswith('# Written by `ctc new-robot` from ')
    assert [word for word in ('&', '*id') if word in text.replace('/**', '')] == []
    assert ctc('simulate', tmp_path / 'mine' / 'arm.yaml', '--duration', '0.1').returncode == 0
    again = ('new-robot', '--urdf', 'arm.urdf', '--out', 'mine/arm.yaml')
    refused(ctc(*again, cwd=tmp_path), 'mine/arm.yaml: exists already')
    assert ctc(*again, '--overwrite', cwd=tmp_path).returncode == 0


def test_the_command_says_what_it_took(tmp_path: Path) -> None:
    """On the screen, and as comments of the file."""
    text = mobile_manipulator().replace('</robot>', '<xacro:sensors/></robot>').replace(
        '<joint name="wrist" type="revolute">',
        '<joint name="wrist" type="revolute"><dynamics damping="9"/>').replace(
        'effort="300"', 'effort="0"')
    (tmp_path / 'robot.urdf').write_text(text)
    arguments = ('new-robot', '--urdf', 'robot.urdf', '--overwrite')
    done = ctc(*arguments, cwd=tmp_path)
    assert done.stdout.splitlines()[:-1] == [
        'joints: lift, shoulder, elbow, wrist',
        'left out, and held at 0 unless the parameter `locked` gives another position: drive_1, '
        'drive_2, pan, tilt, open_1, open_2',
        'ignored: xacro:sensors; xacro did not know these macros, so their links and joints are '
        'missing',
        'no usable effort limit (0, inf or missing) for shoulder; set effort_limit of the '
        'controller',
        'center of the motion: 0.2, 0.25, 0.25, 0.25, the middle of the limits; collisions are '
        'not checked',
        'Coulomb friction assumed, 10% of the torque that the model needs: all joints',
        'friction in <dynamics> ignored as implausible, because it exceeds the torque that the '
        'model needs or 33% of the effort limit, or stops the bodies within 10 ms: wrist',
        'joint     rotor [kg*m^2]  torque rate [N*m/s]  turns',
        'lift      not known       not known            between limits',
        'shoulder  not known       not known            between limits',
        'elbow     0.12 (assumed)  not known            between limits',
        'wrist     0.12 (assumed)  not known            between limits',
        'lowest resonance: not known', 'unknown payload: at most 3.55 kg (assumed)',
        'the URDF has no rotor inertia for elbow, wrist, and 0.002 kg*m^2 per N*m of effort limit '
        'is assumed; set --rotor-inertia from a data sheet or from `ctc identify`, because no '
        'other error of the model degrades the control as much',
        'the sampled loop is stable with 0.27 to 5.5 times these rotors',
        'the sampled loop is stable with 0.29 to 5.4 times these masses']
    assert '# joints: lift, shoulder, elbow, wrist\n' in (tmp_path / 'robot.yaml').read_text()
    done = ctc(*arguments, '--tip', 'head', '--center', '0.2,0.1,0.3', cwd=tmp_path)
    assert done.stdout.startswith('joints: lift, pan, tilt\n')
    assert 'center of the motion: 0.2, 0.1, 0.3, as given; ' in done.stdout
    (tmp_path / 'panda.urdf').write_text(panda())
    done = ctc('new-robot', '--urdf', 'panda.urdf', '--out', 'panda.yaml', cwd=tmp_path)
    assert 'other joints mimic them: panda_finger_joint1 (panda_finger_joint2)\n' in done.stdout


def told(tmp_path: Path, robot_name: str = 'arm', **values: Any) -> NewRobot:
    """Return the two-link arm, whose URDF has no rotors, with what is told of it."""
    text = re.sub('<robot name="[^"]*"', f'<robot name="{robot_name}"', two_links()).replace(
        'effort="0" velocity="1.5"', 'effort="20" velocity="1.5"')
    return new_robot(write_urdf(tmp_path / 'arm.urdf', text), facts=ArmFacts(**values))


def test_rotors_are_assumed_where_nobody_gives_them(tmp_path: Path) -> None:
    """0.002 of the effort limits, for both nodes; then the observer has no slope."""
    effort = np.array([40.0, 20.0])
    assumed, given = told(tmp_path), told(tmp_path, rotor_inertia=[0.7, 0.0])
    assert assumed.values['/**']['rotor_inertia'] == pytest.approx(0.002 * effort)
    assert given.values['/**']['rotor_inertia'] == pytest.approx([0.7, 0.002 * effort[1]])
    assert assumed.values['controller']['estimator_slope'] is False
    assert 'estimator_slope' not in told(
        tmp_path, rotor_inertia=[0.7, 0.1]).values['controller']
    sources = [rotor.source for rotor in given.knowledge.rotors]
    assert sources == [Source.USER, Source.ASSUMED]
    setup = parameter_file.load(None, given.values)
    model = model_of(setup.controller, setup.descriptions['controller'])
    bare = model_of(setup.controller.changed({'rotor_inertia': [0.0, 0.0]}),
                    setup.descriptions['controller'])
    more = np.subtract(model.mass_matrix([0.3, 0.4]), bare.mass_matrix([0.3, 0.4]))
    assert more == pytest.approx(np.diag([0.7, 0.002 * effort[1]]))


def test_the_rate_of_a_known_arm_and_of_a_told_one(tmp_path: Path) -> None:
    known, unknown = told(tmp_path, 'panda'), told(tmp_path)
    assert known.values['controller']['effort_rate_limit'] == [1000.0] * 2
    assert known.values['controller']['torque_rate_limit'] == [1000.0] * 2
    assert known.knowledge.torque_rates[0].source == Source.ARM
    assert 'effort_rate_limit' not in unknown.values['controller']
    own = told(tmp_path, 'panda', torque_rate=[500.0, 400.0])
    assert own.values['controller']['effort_rate_limit'] == [500.0, 400.0]


@pytest.mark.parametrize('values', [{}, {'rotor_inertia': [0.1, 0.1]}, {'resonance': 20.0}])
def test_the_file_has_the_gains_that_compare_and_tune_recommend(
        values: dict[str, Any], tmp_path: Path) -> None:
    setup = parameter_file.load(None, told(tmp_path, **values).values)
    expected, config = gains_by_rule(setup, 'observer_feedback'), setup.controller
    assert (config.law, config.kp, config.kv, config.estimator_bandwidth) == (
        'observer_feedback', expected['kp'], expected['kv'], expected['estimator_bandwidth'])


def test_a_resonance_lowers_the_pole(tmp_path: Path) -> None:
    """To a fifth of it."""
    gains = told(tmp_path, resonance=20.0).values['controller']
    assert gains['kp'] == pytest.approx([(0.2 * 2.0 * np.pi * 20.0) ** 2] * 2)
    assert gains['resonance'] == 20.0


def test_a_payload_is_in_ka(tmp_path: Path) -> None:
    """Its weight at the end of the stretched arm; by default it is what the drives can carry."""
    none, some, default = told(tmp_path, payload=0.0), told(tmp_path, payload=2.0), told(tmp_path)
    more = np.subtract(some.values['controller']['ka'], none.values['controller']['ka'])
    assert more[0] == pytest.approx(2.0 * 9.81 * L1, rel=0.1)
    assert default.knowledge.payload.source == Source.ASSUMED
    assert default.knowledge.payload.value > 0.0


def test_a_name_does_not_end_the_comment_that_it_stands_in(tmp_path: Path) -> None:
    """Names come from outside; YAML takes these characters for the end of a line."""
    name = ''.join(f'wheel{end}plant: {{ros__parameters: {{gravity: 0.0}}}}'
                   for end in ('\u2028', '\x85', '&#10;'))
    (tmp_path / 'robot.urdf').write_text(
        mobile_manipulator().replace('"drive_1"', f'"{name}"'), encoding='utf-8')
    done = ctc('new-robot', '--urdf', 'robot.urdf', cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert parameter_file.load(tmp_path / 'robot.yaml').plant.gravity == 9.81
    assert all('gravity' not in line or line.startswith('left out')
               for line in done.stdout.splitlines())


def test_what_has_no_motion_is_refused(tmp_path: Path) -> None:
    """A robot without joints or masses, and one that its drives cannot hold."""
    weak, fixed, weightless = (tmp_path / f'{name}.urdf' for name in ('weak', 'fixed', 'empty'))
    weak.write_text(two_links().replace('effort="', 'effort="0.0001" was="'))
    fixed.write_text('<robot name="r"><link name="base"/></robot>')
    weightless.write_text(two_links().replace('<mass value="3.0"/>', '<mass value="0"/>').replace(
        '<mass value="1.5"/>', '<mass value="0"/>'))
    out = ('--out', tmp_path / 'a.yaml')
    refused(ctc('new-robot', '--urdf', weak, *out), 'the lightest motion', 'of 0.0001 N·m',
            'for the weight', '--center')
    refused(ctc('new-robot', '--urdf', fixed, *out), 'it has no joint that moves')
    refused(ctc('new-robot', '--urdf', weightless, *out), 'no joint moves a link with a mass')
    refused(ctc('new-robot', '--urdf', weak, '--joints', 'a,elbow', *out), 'elbow')
    for wrong in (('--tip', 'elbow'), ('--center', '1'), ('--tip', 'lower', '--joints', 'a')):
        done = ctc('new-robot', '--urdf', weak, *wrong, *out)
        refused(done, wrong[0].lstrip('-'))
        assert done.returncode == 2
    refused(ctc('new-robot'), '--urdf')
    assert not (tmp_path / 'a.yaml').exists()

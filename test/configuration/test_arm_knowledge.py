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

"""Rotors and torque rates of an arm, and their origin."""

from __future__ import annotations

from math import inf
from pathlib import Path

from ctc_chattering.configuration.arm_knowledge import (
    find_rotors,
    find_torque_rates,
    Known,
    Source,
)
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import ParameterError
from ctc_commands import ctc
import pytest
from urdfs import two_links

#: An arm whose first joint has a rotor in its URDF, and whose second has an effort limit.
URDF = two_links().replace('<joint name="a" type="revolute">', (
    '<joint name="a" type="revolute"><dynamics rotor_inertia="0.3"/>')).replace(
    'effort="0" velocity="1.5"', 'effort="20" velocity="1.5"')


def test_a_rotor_is_given_or_described_or_assumed() -> None:
    tree = Tree(URDF)
    described, assumed = Known(0.3, Source.URDF), Known(0.04, Source.ASSUMED)
    assert find_rotors(tree, ['a', 'b']) == (described, assumed)
    assert find_rotors(tree, ['a', 'b'], [0.5, 0.0]) == (Known(0.5, Source.USER), assumed)
    with pytest.raises(ParameterError, match='2 numbers'):
        find_rotors(tree, ['a', 'b'], [0.5])


@pytest.mark.parametrize('effort', ['0', '1e300'])
def test_nothing_is_assumed_without_an_effort_limit(effort: str) -> None:
    tree = Tree(URDF.replace('effort="20"', f'effort="{effort}"'))
    assert find_rotors(tree, ['b']) == (Known(0.0, Source.NOT_KNOWN),)


def test_the_torque_rate_is_given_or_that_of_a_known_arm() -> None:
    assert find_torque_rates('fr3', ['a']) == (Known(1000.0, Source.ARM),)
    assert find_torque_rates('panda', ['a'], [300.0]) == (Known(300.0, Source.USER),)
    assert find_torque_rates('arm', ['a', 'b'], [300.0]) == (Known(300.0, Source.USER),) * 2
    with pytest.raises(ParameterError, match='1 or 3 numbers'):
        find_torque_rates('arm', ['a', 'b', 'c'], [300.0, 200.0])
    assert find_torque_rates('arm', ['a']) == (Known(inf, Source.NOT_KNOWN),)


def test_check_model_says_which_joints_have_no_rotor(tmp_path: Path) -> None:
    (tmp_path / 'arm.urdf').write_text(URDF)
    done = ctc('check-model', '--urdf', 'arm.urdf', cwd=tmp_path)
    assert done.returncode == 0
    assert [line.split() for line in done.stdout.splitlines() if line.lstrip().startswith(
        ('a ', 'b '))] == [
            ['a', '0.3', '(URDF)', 'not', 'known', 'between', 'limits'],
            ['b', '0.04', '(assumed)', 'not', 'known', 'between', 'limits']]
    assert 'the URDF has no rotor inertia for b, and 0.002 kg*m^2 per N*m of effort limit' in (
        done.stdout)

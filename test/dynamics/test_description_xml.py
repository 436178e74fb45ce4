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

"""The XML of descriptions: what is tolerated as by urdfdom, and what is refused."""

from __future__ import annotations

from ctc_chattering.dynamics.description_xml import parse_description
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError
import pytest
from urdfs import two_links


def test_tags_of_other_programs_are_left_alone() -> None:
    """As urdfdom does, with a prefix that nothing declares, and with macros left over."""
    robot = two_links().replace('</robot>', (
        '<gazebo><sensor:camera name="rgb"><imageSize>1</imageSize></sensor:camera></gazebo>'
        '<xacro:grey/><xacro:grey/><xacro:pelvis_sensors port="1"/></robot>'))
    assert Tree(robot).movable == ('a', 'b')
    assert Tree(robot).unexpanded == ('xacro:grey', 'xacro:pelvis_sensors')
    declared = robot.replace('<robot', '<robot xmlns:xacro="http://ros.org/wiki/xacro"')
    assert Tree(declared).unexpanded == Tree(robot).unexpanded
    assert Tree(two_links()).unexpanded == ()
    drake = two_links().replace('<robot', '<robot xmlns="http://drake.mit.edu"')
    assert Tree(drake).movable == ('a', 'b')


@pytest.mark.parametrize('command', [
    'include filename="x"/', 'macro name="x"/', 'property name="x" value="1"/', 'arg name="x"/',
    'if value="1"/', 'unless value="0"/', 'insert_block name="x"/'])
def test_what_xacro_has_not_run_on_is_refused_with_the_line(command: str) -> None:
    text = two_links().replace('</robot>', f'\n<xacro:{command}>\n</robot>')
    name = command.split()[0].rstrip('/')
    with pytest.raises(CtcError, match=f'line 2: <xacro:{name}>.* run xacro on it first'):
        Tree(text)


@pytest.mark.parametrize(('text', 'words'), [
    ('\n<robot>\n<link', 'line 3'), ('', 'no element found'), ('<robot>\0</robot>', 'not XML'),
    ('<!DOCTYPE r [<!ENTITY a "b">]><robot/>', 'XML entities'),
    ('<robot>' + 501 * '<link/>' + '</robot>', '501 bodies, of 500 at most'),
    (4_000_001 * ' ', '4000001 characters')])
def test_texts_that_are_refused(text: str, words: str) -> None:
    with pytest.raises(CtcError, match=words):
        parse_description(text)


def test_comments_are_kept_on_demand() -> None:
    text = '<robot><!-- by hand --><link name="a"/></robot>'
    assert len(parse_description(text)) == 1
    assert len(parse_description(text, comments=True)) == 2

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

"""Layouts of other tools name topics, fields and joints that there are."""

from __future__ import annotations

from collections.abc import Callable
import json
from pathlib import Path
import re
from typing import Any
import xml.etree.ElementTree as ET

from ctc_chattering.ros.messages import message_type
from ctc_chattering.ros.topics import TOPICS
from layouts import foxglove, plotjuggler
import pytest

CONFIG = Path(__file__).resolve().parents[2] / 'config'
PAPER, THREE = ('joint1', 'joint2'), ('a', 'b', 'c')
#: Names in the messages of the controller, in the order of `nodes.controller`.
NAMES: dict[str, Callable[[tuple[str, ...]], list[str]]] = {
    '/controller/tracking': lambda n: [f'{j}/{x}' for x in ('desired', 'error') for j in n],
    '/controller/filter': list, '/joint_states': list,
    '/controller/torques': lambda n: [
        *(f'{j}/{x}' for x in ('nominal', 'compensation', 'robust') for j in n), 'V']}


def panels(tree: Any) -> list[str]:
    if isinstance(tree, str):
        return [tree]
    return panels(tree['first']) + panels(tree['second'])


@pytest.mark.parametrize('joints', [PAPER, THREE])
def test_foxglove(joints: tuple[str, ...]) -> None:
    layout = json.loads(foxglove(joints))
    assert sorted(panels(layout['layout'])) == sorted(layout['configById'])
    found = []
    for panel in layout['configById'].values():
        for line in panel.get('paths', ()):
            topic, field, index = re.findall(r'^(\S+)\.(\w+)\[(\d+)]$', line['value'])[0]
            assert field in message_type(TOPICS[topic[1:]].kind).get_fields_and_field_types()
            found.append((line['label'], f'{topic}/{NAMES[topic](joints)[int(index)]}'))
    for joint in joints:
        assert {(joint, f'/controller/tracking/{joint}/error'),
                (joint, f'/controller/filter/{joint}'),
                *((x, f'/controller/torques/{joint}/{x}')
                  for x in ('nominal', 'compensation', 'robust'))} <= set(found)
    assert ('V', '/controller/torques/V') in found


@pytest.mark.parametrize('joints', [PAPER, THREE])
def test_plotjuggler(joints: tuple[str, ...]) -> None:
    curves = [x.get('name', '') for x in ET.fromstring(plotjuggler(joints)).iter('curve')]
    known = {f'{topic}/{name}' for topic, names in NAMES.items() for name in names(joints)}
    assert len(set(curves)) == len(curves) == 6 * len(joints) + 1
    for curve in curves:
        name, _, field = curve.rpartition('/')
        assert name in known
        assert field in ('position', 'velocity', 'effort')


def test_the_files_of_the_package_are_the_generated_ones() -> None:
    for name, make in (('foxglove-layout.json', foxglove),
                       ('plotjuggler-layout.xml', plotjuggler)):
        assert (CONFIG / name).read_text(encoding='utf-8') == make(PAPER)

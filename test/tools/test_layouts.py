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

"""Layouts of other tools name topics, fields and names that there are."""

from __future__ import annotations

import json
from pathlib import Path
import re
import xml.etree.ElementTree as ET

from ctc_chattering.configuration.topics import TOPICS
from ctc_chattering.ros.messages import message_type

CONFIG = Path(__file__).resolve().parents[2] / 'config'
JOINTS = ('joint1', 'joint2')
#: Names in the messages of the controller, in the order of `nodes.controller`.
NAMES = {
    '/controller/tracking': [f'{j}/{x}' for x in ('desired', 'error') for j in JOINTS],
    '/controller/filter': [*JOINTS], '/joint_states': [*JOINTS],
    '/controller/torques': [
        *(f'{j}/{x}' for x in ('nominal', 'compensation', 'robust') for j in JOINTS), 'V']}


def test_layouts_of_foxglove_and_plotjuggler() -> None:
    layout = json.loads((CONFIG / 'foxglove-layout.json').read_text(encoding='utf-8'))
    lines = [line for x in layout['configById'].values() for line in x.get('paths', ())]
    for line in lines:
        topic, field, index = re.findall(r'^(\S+)\.(\w+)\[(\d+)]$', line['value'])[0]
        assert field in message_type(TOPICS[topic[1:]].kind).get_fields_and_field_types()
        assert line['label'] in NAMES[topic][int(index)] or line['label'] == 'applied'
    tree = ET.parse(CONFIG / 'plotjuggler-layout.xml')
    curves = [x.get('name', '').rpartition('/') for x in tree.iter('curve')]
    assert {name for name, _, _ in curves} <= {
        f'{topic}/{name}' for topic, names in NAMES.items() for name in names}
    assert {field for _, _, field in curves} == {'position', 'velocity', 'effort'}
    assert len(lines) >= len(curves) == 13

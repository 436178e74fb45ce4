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

"""
Layouts of Foxglove and PlotJuggler for the topics of the graph.

Those of the paper's arm are in `config/`; for other joints::

    python tools/layouts.py foxglove panda_joint1 panda_joint2 > panda.json
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import json
import sys
from typing import Any
import xml.etree.ElementTree as ET

from ctc_chattering.analysis.result import PARTS
from ctc_chattering.ros.topics import FILTER, ROBOT_DESCRIPTION, TORQUES, TRACKING


def foxglove(joints: Sequence[str]) -> str:
    """Return a layout of Foxglove, as JSON: arm, errors, v, V, torques, diagnostics."""
    n = len(joints)
    panels: dict[str, Any] = {
        '3D!arm': {
            'followTf': 'base', 'scene': {}, 'topics': {}, 'transforms': {}, 'publish': {},
            'layers': {'arm': {
                'layerId': 'foxglove.Urdf', 'label': 'arm', 'visible': True,
                'sourceType': 'topic', 'topic': f'/{ROBOT_DESCRIPTION}', 'instanceId': 'arm'}}},
        'Plot!error': _plot('position error [rad]', {
            joint: f'/controller/{TRACKING}.position[{n + i}]' for i, joint in enumerate(joints)}),
        'Plot!v': _plot('v [rad/s]', {
            joint: f'/controller/{FILTER}.velocity[{i}]' for i, joint in enumerate(joints)}),
        'Plot!V': _plot('V [J]', {'V': f'/controller/{TORQUES}.effort[{len(PARTS) * n}]'}),
        **{f'Plot!torque{i}': _plot(f'torque of {joint} [N·m]', {
            'applied': f'/joint_states.effort[{i}]',
            **{part: f'/controller/{TORQUES}.effort[{k * n + i}]'
               for k, part in enumerate(PARTS)}}) for i, joint in enumerate(joints)},
        'DiagnosticSummary!nodes': {
            'minLevel': 0, 'pinnedIds': [], 'hardwareIdFilter': '',
            'topicToRender': '/diagnostics'}}
    plots = [name for name in panels if name.startswith('Plot')]
    found = {
        'configById': panels, 'globalVariables': {}, 'userNodes': {},
        'playbackConfig': {'speed': 1}, 'layout': {
            'direction': 'row', 'splitPercentage': 40, 'second': _stack(plots),
            'first': {'direction': 'column', 'splitPercentage': 70,
                      'first': '3D!arm', 'second': 'DiagnosticSummary!nodes'}}}
    return json.dumps(found, indent=1, ensure_ascii=False) + '\n'


def _plot(title: str, paths: Mapping[str, str]) -> dict[str, Any]:
    return {
        'title': title, 'isSynced': True, 'xAxisVal': 'timestamp', 'showLegend': True,
        'legendDisplay': 'floating', 'showXAxisLabels': True, 'showYAxisLabels': True,
        'showPlotValuesInLegend': False, 'sidebarDimension': 240, 'followingViewWidth': 10,
        'paths': [{'value': path, 'label': label, 'enabled': True, 'color': colour,
                   'timestampMethod': 'headerStamp'}
                  for (label, path), colour in zip(paths.items(), _colours())]}


def _stack(names: Sequence[str]) -> Any:
    """Return panels one above the other, all of the same height."""
    if len(names) == 1:
        return names[0]
    return {'direction': 'column', 'splitPercentage': 100 / len(names), 'first': names[0],
            'second': _stack(names[1:])}


def plotjuggler(joints: Sequence[str]) -> str:
    """Return a layout of PlotJuggler, as XML: errors, v, V and torques."""
    root = ET.Element('root')
    window = ET.SubElement(root, 'tabbed_widget', {'parent': 'main_window', 'name': 'Main Window'})
    torques = {f'torque of {joint} [N·m]': [
        f'/joint_states/{joint}/effort',
        *(f'/controller/{TORQUES}/{joint}/{part}/effort' for part in PARTS)] for joint in joints}
    for title, plots in (
            ('error', {
                'position error [rad]': [
                    f'/controller/{TRACKING}/{joint}/error/position' for joint in joints],
                'v [rad/s]': [f'/controller/{FILTER}/{joint}/velocity' for joint in joints],
                'V [J]': [f'/controller/{TORQUES}/V/effort']}),
            ('torques', torques)):
        tab = ET.SubElement(window, 'Tab', tab_name=title, containers='1')
        splitter = ET.SubElement(
            ET.SubElement(tab, 'Container'), 'DockSplitter', orientation='-',
            count=str(len(plots)), sizes=';'.join([f'{1 / len(plots):.6f}'] * len(plots)))
        for name, curves in plots.items():
            plot = ET.SubElement(ET.SubElement(splitter, 'DockArea', name=name), 'plot',
                                 mode='TimeSeries', style='Lines', flip_x='false', flip_y='false')
            ET.SubElement(plot, 'limitY')
            for curve, colour in zip(curves, _colours()):
                ET.SubElement(plot, 'curve', name=curve, color=colour)
    ET.SubElement(window, 'currentTabIndex', index='0')
    ET.indent(root, ' ')
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{ET.tostring(root, encoding='unicode')}\n"


def _colours() -> list[str]:
    return ['#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9', '#808080'] * 100


LAYOUTS: dict[str, Callable[[Sequence[str]], str]] = {
    'foxglove': foxglove, 'plotjuggler': plotjuggler}

if __name__ == '__main__':
    if len(sys.argv) < 3 or sys.argv[1] not in LAYOUTS:
        sys.exit(f'usage: python {sys.argv[0]} {{{" | ".join(LAYOUTS)}}} JOINT ...')
    sys.stdout.write(LAYOUTS[sys.argv[1]](sys.argv[2:]))

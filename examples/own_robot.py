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
A robot of your own from its URDF: check the model, then compare two laws on it.

``python own_robot.py [robot.urdf [joint1,joint2,...]]`` prints the checks and the errors; without
an argument it takes the paper's arm as a URDF. It needs Pinocchio: ``pip install pin``.
"""

from __future__ import annotations

from pathlib import Path
import sys

from ctc_chattering import check_dynamics, load_parameters, simulate, UrdfModel

path = Path(sys.argv[1] if len(sys.argv) > 1
            else Path(__file__).parents[1] / 'config' / 'two_link.urdf').resolve()
joints = sys.argv[2].split(',') if len(sys.argv) > 2 else ['joint1', 'joint2']

# The tests that a model must pass: M, C and G as the laws need them.
for check in check_dynamics(UrdfModel(path.read_text(encoding='utf-8'), joints, 9.81)):
    print('ok    ' if check.passed else 'FAILED', check.name)

# Friction of 5 N·m in every joint, of which the controller knows nothing.
for law in ('pd_gravity', 'observer_feedback'):
    result = simulate(load_parameters('friction', {
        '/**': {'joint_names': joints, 'model': 'urdf', 'description': str(path)},
        'plant': {'duration': 4.0, 'coulomb_friction': [5.0] * len(joints)},
        'controller': {'law': law, 'ka': [12.0] * len(joints)},
        'reference': {'start_duration': 1.0}}))
    worst = abs(result.e[result.t >= 2.0]).max(axis=0)
    print(f'{law:18}', ', '.join(f'{name} {x:.1e} rad' for name, x in zip(joints, worst)))

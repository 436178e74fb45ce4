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
From a recording to friction, and from friction to gains that hold on the robot.

``python bag_to_gains.py BAG [MODEL]`` takes a bag of any recorder with joint states, torques and
the robot's description, or a model, such as two_link. Without an argument it excites the paper's
arm in simulation, and identifies that; ROS is not needed. It prints what ``ctc identify`` prints,
and writes ``gains/identified.yaml``.
"""

from __future__ import annotations

import sys

from ctc_chattering import (
    excite,
    identify,
    load_parameters,
    read_motion,
    RecordedMotion,
    Recording,
    Setup,
    simulate,
    write_excitation,
    write_identified,
)


def recorded(robot: Setup) -> RecordedMotion:
    """Return a motion of a simulated robot that shows its friction, as a recorder would."""
    found = excite(robot, {'duration': 30.0, 'poses': 1})
    write_excitation(found, robot, 'motion')
    run = simulate(load_parameters('motion/run.yaml'))
    return RecordedMotion(Recording('simulation', run.joint_names, run.t, run.q, run.dq,
                                    command=run.tau).checked())


if len(sys.argv) > 1:
    identified = identify([read_motion(sys.argv[1])], model=''.join(sys.argv[2:]))
else:
    robot = load_parameters('friction', {'plant': {'coulomb_friction': [6.0, 3.0]}})
    identified = identify([recorded(robot)], model='two_link')

# No trial runs, for speed: without trials=0, the gains are tried on robots within the intervals.
identified = write_identified(identified, 'gains', trials=0)
print(identified.results.text())
for friction in identified.results.found.friction:
    print('Coulomb friction', friction.coulomb)

# The gains, on the robot that was identified.
result = simulate(load_parameters('gains/identified.yaml', {'plant': {'duration': 10.0}}))
print(result.law, [f'{x:.1e} rad' for x in result.metrics()['rms_error_rad']])

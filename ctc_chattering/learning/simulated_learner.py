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
The learner of a simulated loop.

`analysis.result.simulate` makes one for a setup with ``learning``. It is that of the reference
node, told what that node is told.
"""

from __future__ import annotations

from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError
from ctc_chattering.learning.design import filter_for
from ctc_chattering.learning.learner import Learner
from ctc_chattering.learning.learning_filter import LearningFilter
from ctc_chattering.learning.motion import motion_of, RepeatedMotion
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.trajectory.joint_limits import read_limits
from ctc_chattering.trajectory.reference import make_motion


def make_learner(setup: Setup, robot: Plant, model: Model) -> Learner:
    """
    Return a learner at the start of a run.

    Parameters
    ----------
    setup : Setup
        The loop.
    robot : Plant
        Plant in its initial state.
    model : Model
        Model of the controller.

    Raises
    ------
    CtcError
        If the motion is not repeated, learning need not converge, or the controller's parameters
        change during the run.

    """
    if any(event.node == 'controller' for event in setup.events):
        raise CtcError('learning: events of the controller are not simulated')
    reference = setup.reference
    start = dict(zip(setup.plant.joint_names, zip(*map(tuple, robot.measured))))
    motion = make_motion(reference, setup.route, start, continuous=setup.continuous)
    repeated = motion_of(reference, setup.route, motion)
    designed = filter_for(repeated, reference, setup.controller, model)

    def filter_of(_: RepeatedMotion) -> LearningFilter:
        return designed

    description = setup.descriptions.get('reference', '')
    limits = read_limits(description, reference.joint_names) if description else None
    learner = Learner(
        len(reference.joint_names), reference.learning_bound, robot.period_ns, filter_of, limits)
    learner.follow(repeated, repeated.start)
    return learner

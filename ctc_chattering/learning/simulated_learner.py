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
Learners of simulated and recorded loops.

`analysis.result.simulate` makes one for a setup with ``learning``, and `ctc learn` one for a bag.
It is the `Learner` of the reference node, and takes the same errors and parameters.
"""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.learning.design import filter_for
from ctc_chattering.learning.learned_file import read_correction
from ctc_chattering.learning.learner import Learner
from ctc_chattering.learning.learning_filter import LearningFilter
from ctc_chattering.learning.motion import motion_of, moving_frequencies, RepeatedMotion
from ctc_chattering.numerics.time_grid import period_ns
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.trajectory.joint_limits import continuous_joints, read_limits
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig, RobotState
from ctc_chattering.trajectory.waypoints import Route


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
        As `learner_of`, and if the controller's parameters change during the run.

    """
    if any(event.node == 'controller' for event in setup.events):
        raise CtcError('learning: events of the controller are not simulated')
    start = dict(zip(setup.plant.joint_names, zip(*map(tuple, robot.measured))))
    return learner_of(setup.reference, setup.controller, setup.route, start, model,
                      setup.descriptions.get('controller', ''))


def check_learning(setup: Setup) -> None:
    """
    Raise `CtcError` for ``learning`` that is impossible.

    Setups without ``learning`` pass. So does a reference at rest, which waits for waypoints or
    goals that may be learned.
    """
    is_moving = setup.route is not None or moving_frequencies(setup.reference)
    if setup.reference.learning and is_moving:
        description = setup.descriptions.get('controller', '')
        plant = setup.plant
        states = zip(plant.initial_position, plant.initial_velocity)
        learner_of(setup.reference, setup.controller, setup.route,
                   dict(zip(plant.joint_names, states)),
                   model_of(setup.controller, description), description)


def learner_of(reference: ReferenceConfig, controller: ControllerConfig, route: Route | None,
               start: RobotState, model: Model, description: str) -> Learner:
    """
    Return a learner at the start of a motion.

    Parameters
    ----------
    reference, controller, model
        As of `filter_for`.
    route : Route or None
        Waypoints in place of the profile.
    start : mapping
        State of the robot at the start.
    description : str
        Description of the robot, '' for none.

    Raises
    ------
    CtcError
        If the motion is not repeated, learning need not converge, or the learned file is wrong.

    """
    limits = read_limits(description, reference.joint_names) if description else None
    continuous = continuous_joints(reference, limits)
    motion = make_motion(reference, route, start, continuous=continuous)
    repeated = motion_of(reference, route, motion)
    designed = filter_for(repeated, reference, controller, model)

    def filter_of(_: RepeatedMotion) -> LearningFilter:
        return designed

    learner = Learner(
        len(reference.joint_names), reference.learning_bound,
        period_ns(controller.control_period), filter_of, limits)
    rows = None
    if reference.learning_file:
        path = Path(reference.learning_file)
        rows = read_correction(path, repeated, reference, controller, description)
    learner.follow(repeated, repeated.start, rows)
    return learner

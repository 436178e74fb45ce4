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
Learning from the passes in a bag, for `ctc learn`.

The `Learner` of the nodes takes the errors that the controller published. A pass is left out if
the controller did not follow the motion of the recorded parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from ctc_chattering.bags.reader import read_configs, read_run_signals, TRACKING_TOPIC
from ctc_chattering.bags.recorded_reference import read_reference
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.configuration.topics import DESIRED, JOINT_STATES
from ctc_chattering.configuration.trajectory_file import read_trajectory
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import as_ctc_error, CtcError
from ctc_chattering.learning.learner import Learner
from ctc_chattering.learning.simulated_learner import learner_of
from ctc_chattering.numerics.time_grid import seconds
from ctc_chattering.trajectory.path_clock import PathClock
from ctc_chattering.trajectory.reference import ReferenceConfig
import numpy as np


class RecordedPasses(NamedTuple):
    """Learner of a bag's passes, and its setup."""

    learner: Learner
    reference: ReferenceConfig
    controller: ControllerConfig
    description: str
    #: Reasons why passes were left out, each with the path time at which it was noticed [s].
    left_out: list[tuple[float, str]]


def learn_from_bag(path: Path, classes: Mapping[str, object]) -> RecordedPasses:
    """
    Return a learner of all passes in a bag.

    Parameters
    ----------
    path : Path
        Directory of a bag of this package.
    classes : mapping
        Classes of your own, as those of `reader.read_bag`.

    Raises
    ------
    CtcError
        If it is no such bag, parameters are missing or change, or the motion is not repeated.

    """
    with closing(open_bag(path)) as bag, as_ctc_error(f'{path}: damaged'):
        controllers = read_configs(bag, classes)
        references = bag.parameters('reference', ReferenceConfig, classes)
        if len(controllers) != 1 or len(references) != 1:
            raise CtcError(f'{path}: parameters of the reference are missing, or parameters '
                           'change; record passes with the same parameters from start to end')
        (_, controller), (start, reference) = controllers[0], references[0]
        description = bag.description()
        signals = read_run_signals(bag, controller.joint_names)
        followed = read_reference(bag, controller.joint_names)
        desired = read_reference(bag, controller.joint_names, DESIRED)
    states, tracking = signals[JOINT_STATES], signals[TRACKING_TOPIC]
    states = states.select(states.stamps >= start)
    tracking = tracking.select(tracking.stamps >= max(start, followed.start))
    if not len(states.stamps) or not len(tracking.stamps):
        raise CtcError(f'{path}: there is no error of the reference on {TRACKING_TOPIC}')
    file = reference.trajectory_file
    route = read_trajectory(Path(file), reference.joint_names) if file else None
    names = controller.joint_names
    at_start = dict(zip(names, zip(*(x[0].tolist() for x in states.values))))
    reference = reference.changed({'learning_file': ''})
    learner = learner_of(
        reference, controller, route, at_start, model_of(controller, description), description)

    clock = PathClock.steady(reference.speed_scaling)
    instants = [clock.at(t - start).instant for t in tracking.stamps.tolist()]
    columns = [names.index(name) for name in reference.joint_names]
    q_d, e = (x[:, columns] for x in np.hsplit(tracking.values[0], 2))
    learned = followed.correction_at(tracking.stamps, desired)
    correction = np.zeros((len(e), 3, len(columns))) if learned is None else learned[..., columns]
    left_out = []
    for s, *sample in zip(instants, q_d, e, correction):
        learner.add(s, *sample)
        if learner.problem:
            left_out.append((seconds(s), learner.problem))
            learner.problem = ''
    if learner.is_measuring:
        left_out.append((seconds(instants[-1]), 'the recording ends in the pass'))
    return RecordedPasses(learner, reference, controller, description, left_out)

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

"""The learning filter for the law of a configuration, and its model."""

from __future__ import annotations

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.controller import Controller
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.learning.design import design_filter, filter_for
from ctc_chattering.learning.learning_filter import LearningFilter
from ctc_chattering.learning.motion import motion_of
from ctc_chattering.trajectory.reference import make_motion
import numpy as np
from processes import CONFIG
import pytest


def setup_of(robot: str, **controller: object) -> Setup:
    return parameter_file.load(CONFIG / f'{robot}.yaml', {'controller': controller})


def filter_of(setup: Setup) -> LearningFilter:
    reference = setup.reference.changed({'start_duration': 0.0})
    motion = motion_of(reference, None, make_motion(reference))
    model = model_of(setup.controller, setup.descriptions.get('controller', ''))
    return filter_for(motion, reference, setup.controller, model)


def test_the_payload_of_the_controller_is_part_of_its_model() -> None:
    """The same as for the masses of the loaded arm, and of a law that knows nothing of it."""
    setup = setup_of('panda', law='pd_gravity', payload_mass=2.0)
    config = setup.controller
    loaded = Controller(config, model_of(config, setup.descriptions['controller'])).model
    reference = setup.reference.changed({'start_duration': 0.0})
    positions = motion_of(reference, None, make_motion(reference)).positions()
    masses = [np.array(loaded.mass_matrix(q)) for q in positions]
    expected = design_filter(config.changed({'payload_mass': 0.0}), masses, 0.7, 0.0)
    np.testing.assert_array_equal(filter_of(setup).gain, expected.gain)
    assert (filter_of(setup_of('panda', law='pd_gravity')).gain != expected.gain).any()


def test_errors_that_come_too_rarely_are_refused() -> None:
    assert filter_of(setup_of('friction', state_decimation=100)).contraction < 1.0
    with pytest.raises(CtcError, match='with state_decimation 101, errors come too rarely'):
        filter_of(setup_of('friction', state_decimation=101))

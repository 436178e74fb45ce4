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

"""The check of a setup that learns, before nodes start."""

from __future__ import annotations

from ctc_chattering.configuration import parameter_file
from ctc_chattering.errors import CtcError
from ctc_chattering.learning.simulated_learner import check_learning
import pytest


def test_a_reference_at_rest_that_waits_for_goals_may_learn() -> None:
    """The page on MoveIt has the arm begin at rest."""
    check_learning(parameter_file.load_parameters('friction', {
        'controller': {'law': 'compensation'},
        'reference': {'learning': True, 'amplitude': [0.0, 0.0]}}))


def test_a_motion_without_a_common_period_is_refused() -> None:
    setup = parameter_file.load_parameters('friction', {
        'controller': {'law': 'compensation'},
        'reference': {'learning': True, 'frequency': [0.1, 0.133]}})
    with pytest.raises(CtcError, match=r'0\.133\] Hz have no common period of up to 60 s; round'):
        check_learning(setup)

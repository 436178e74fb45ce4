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

"""Figures of a joint that is not usable have no fit and no ka."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

from ctc_chattering.identification import figures
from ctc_chattering.identification.findings import Severity
from ctc_chattering.identification.perturbation import MeasuredPerturbation
from ctc_chattering.identification.results import Validation
from ctc_chattering.identification.verdict import Verdict
from figure_layout import overlaps
import numpy as np
import pytest


def test_a_joint_that_is_not_usable_has_no_ka_and_says_so() -> None:
    ones = np.ones((5, 2))
    run = cast(MeasuredPerturbation, SimpleNamespace(
        t=np.arange(5.0), measured=ones, envelope=2.0 * ones))
    verdicts = [Verdict('a', Severity.CARE, ()), Verdict('b', Severity.REFUSED, ())]
    _, figure, caption = figures._perturbation(run, np.array([3.0, 4.0]), verdicts)
    good, bad = figure.axes
    assert [len(good.lines), len(bad.lines)] == [5, 1]
    assert bad.get_title(loc='left') == 'b: not usable' and good.get_title(loc='left') == 'a'
    assert 'not usable' in caption


@pytest.mark.parametrize('n', [2, 7])
def test_nothing_is_over_a_legend_or_a_label(n: int) -> None:
    """Check joints and a bag of long names."""
    ones = np.ones((50, n))
    run = cast(MeasuredPerturbation, SimpleNamespace(
        t=0.1 * np.arange(50.0), measured=ones, envelope=2.0 * ones, rest=ones, predicted=ones))
    verdicts = [Verdict(f'a_joint_of_the_left_arm_of_a_robot_{k}', (
        Severity.CARE, Severity.REFUSED)[k % 2], ()) for k in range(n)]
    validation = Validation('a_bag_of_a_long_name_' * 9, run, 2.0 * ones, ones)
    for _, figure, _ in (
            figures._perturbation(run, np.ones(n), verdicts),
            figures._residual(run, verdicts),
            figures._validation(validation, verdicts)):
        assert not overlaps(figure)

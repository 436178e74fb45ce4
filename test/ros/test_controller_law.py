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

"""The learning filters that the reference node has computed."""

from __future__ import annotations

from threading import Event

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.learning.design import filter_for
from ctc_chattering.learning.learner import MAX_MOTIONS
from ctc_chattering.learning.motion import motion_of
from ctc_chattering.ros import controller_law
from ctc_chattering.ros.controller_law import ControllerLaw
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig
from processes import probe
import pytest

pytestmark = pytest.mark.ros


def test_a_filter_of_a_law_that_has_gone_is_not_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A slider of a gain sets one after the other, and each takes up to a second."""
    config = ReferenceConfig(learning=True)
    motion = motion_of(config, None, make_motion(config))
    may_begin, computed = Event(), []

    def slow(*arguments: object) -> object:
        may_begin.wait()
        computed.append(arguments)
        return filter_for(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(controller_law, 'filter_for', slow)
    with probe() as it:
        law = ControllerLaw(it.node, config, lambda: True, lambda: None)
        for kp in range(100, 120):
            values = ControllerConfig.from_mapping({'law': 'pd_gravity', 'kp': [float(kp), 100.0]})
            law._update(values.as_mapping(), '')
            assert law.refusal(motion) == ''
        may_begin.set()
        assert law.filter_of(motion) is not None
    assert len(computed) <= 2  # The first was being computed.


def test_filters_of_motions_that_are_not_sent_again_are_forgotten() -> None:
    configs = [ReferenceConfig(learning=True, amplitude=(0.1 + 0.01 * k, 0.2))
               for k in range(MAX_MOTIONS + 5)]
    with probe() as it:
        law = ControllerLaw(it.node, configs[0], lambda: True, lambda: None)
        law._update(ControllerConfig.from_mapping({'law': 'pd_gravity'}).as_mapping(), '')
        for config in configs:
            law.refusal(motion_of(config, None, make_motion(config)))
        assert len(law._filters) == MAX_MOTIONS

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

"""What is reported is what is predicted with, as an outsider with other software finds."""

from __future__ import annotations

from ctc_chattering.identification.identified_robot import identify
from ctc_chattering.identification.recording import RecordedMotion
from faults_of_arms import case, recorded
import numpy as np
from real_recordings import outsider
from robots import arm


def test_reported_numbers_give_the_torque_of_the_drives() -> None:
    """Rotors that the URDF lacks are in the corrected one; no scale is made up."""
    one = case('two_link_urdf', 'rotor', 3, 10.0)
    seen, recording = recorded(one, 3, 10.0)
    robot = identify([RecordedMotion(recording.checked(), arm('two_link_urdf').urdf)])
    states = (seen.position, seen.velocity, seen.acceleration, seen.drive)
    slides = np.abs(seen.velocity) > 0.1
    predicted = outsider(robot, recording.joints, states)
    prediction = robot.results.found.prediction
    for joint, name in enumerate(recording.joints):
        error = (predicted[name] - seen.drive[:, joint])[slides[:, joint]]
        rms = float(np.sqrt(np.square(error).mean()))
        assert rms < 0.01 * prediction.recording_rms[joint]
        assert prediction.model_rms[joint] > 10.0 * rms
    assert robot.results.found.constant == []
    assert 'per unit of the signal' not in robot.results.text()

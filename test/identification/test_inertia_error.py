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

"""Gains are refused where the model lacks more inertia than it has."""

from __future__ import annotations

from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.identification.findings import Severity
from ctc_chattering.identification.gains import inertia_findings
from ctc_chattering.identification.identify import identify
from ctc_chattering.identification.model_errors import candidates
from faults_of_arms import case, recorded
from identified_robots import arm
import numpy as np
import pytest


def test_a_rotor_that_the_model_lacks_is_compared_with_its_inertia() -> None:
    one = case('two_link_urdf', 'rotor', 1100, 8.0)
    recording = recorded(one, 1100, 8.0)[1].checked()
    urdf = arm('two_link_urdf').urdf
    model = UrdfModel(urdf, one.robot.joints)
    found = identify([recording], model, candidates(model, urdf, {}))
    every = np.median([np.diagonal(model.mass_matrix(q.tolist()))
                       for q in recording.q[::200]], axis=0)
    true = 1.0 + one.robot.physics.rotor / every
    assert true[0] < 1.9 and true[1] > 2.1
    (finding,) = inertia_findings(found, model, recording.q)
    assert (finding.severity, finding.joint) == (Severity.REFUSED, 1)
    assert float(finding.reason.split()[5]) == pytest.approx(true[1], rel=0.02)

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

"""The prediction of unseen torque decides; each reason has a number and a cure."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from types import SimpleNamespace
from typing import Any, cast

from ctc_chattering.identification.findings import Estimate, Finding, Reason, Severity
from ctc_chattering.identification.friction import CoupledFriction, JointFriction
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.verdict import verdicts
import numpy as np
import pytest

NONE = Estimate.none()
GOOD = JointFriction(
    coulomb=Estimate(5.0, 0.01, 'N*m'), forwards=Estimate(5.0, 0.01, 'N*m'),
    backwards=Estimate(5.0, 0.01, 'N*m'), viscous=Estimate(1.0, 0.01), stribeck=NONE,
    stribeck_velocity=NONE, load=NONE, dead_band=NONE)
#: RMS of unseen torque of a joint of which only noise is unexplained [N·m].
PREDICTED = {'recording_rms': 20.0, 'model_rms': 6.0, 'identified_rms': 0.1, 'typical_rms': 0.1,
             'systematic_rms': 0.0}


def made(second: JointFriction = GOOD, findings: tuple[Finding, ...] = (), *,
         moves: bool = True, predicted: Mapping[str, float] = {}) -> Identification:
    """Return what `verdicts` reads of two joints; fields of the second one's prediction differ."""
    prediction = {name: np.array([value, predicted.get(name, value)])
                  for name, value in PREDICTED.items()}
    data = SimpleNamespace(moving=np.array([True, moves]), used=np.ones((9, 2), bool))
    fit = SimpleNamespace(data=data, torque=lambda *_: np.full(9, 5.0))
    return cast(Identification, SimpleNamespace(
        joints=('a', 'b'), friction=[GOOD, second], findings=findings, fit=fit,
        prediction=SimpleNamespace(**prediction)))


def test_a_joint_of_which_only_noise_is_unexplained_is_usable() -> None:
    assert [(x.word, x.findings) for x in verdicts(made())] == [('usable', ())] * 2


@pytest.mark.parametrize(('predicted', 'severity', 'reason'), [
    ({'identified_rms': 5.9, 'typical_rms': 5.9, 'systematic_rms': 4.0}, Severity.REFUSED,
     Reason.NOT_PREDICTED),
    ({'identified_rms': 5.0, 'typical_rms': 5.0, 'systematic_rms': 0.1}, Severity.CARE,
     Reason.UNEXPLAINED),
    ({'systematic_rms': 0.09}, Severity.CARE, Reason.UNEXPLAINED),
    # An exact model leaves nothing to predict better.
    ({'model_rms': 1e-5, 'identified_rms': 1e-5, 'typical_rms': 1e-5}, Severity.NOTE, None),
    # Outliers alone are no doubt.
    ({'identified_rms': 3.0}, Severity.NOTE, None)])
def test_the_prediction_of_unseen_torque_decides(
        predicted: dict[str, float], severity: Severity, reason: Reason | None) -> None:
    first, second = verdicts(made(predicted=predicted))
    assert first.severity == Severity.NOTE and second.severity == severity
    assert [x.reason for x in second.findings] == [reason] * (reason is not None)
    assert second.usable == (severity < Severity.REFUSED)


@pytest.mark.parametrize(('change', 'reason', 'value'), [
    ({'coulomb': Estimate(5.0, 2.0, 'N*m')}, Reason.UNCERTAIN,
     {'Coulomb': Estimate(5.0, 2.0, 'N*m')}),
    ({'stribeck': Estimate(2.0, 2.0, 'N*m')}, Reason.UNCERTAIN,
     {'Stribeck': Estimate(2.0, 2.0, 'N*m')}),
    # A dead zero within a narrow interval is no doubt: friction is little beside the torque.
    ({'coulomb': Estimate(0.0, 0.1, 'N*m')}, None, None),
    ({'viscous': Estimate(-8e-7, 3e-6)}, None, None),
    ({'coulomb': Estimate(0.0, 0.5, 'N*m')}, Reason.UNCERTAIN,
     {'Coulomb': Estimate(0.0, 0.5, 'N*m')}),
    ({'coupled': (CoupledFriction(0, Estimate(1.0), Estimate(0.1)),)}, Reason.COUPLED, 'a')])
def test_numbers_that_need_care(change: dict[str, Any], reason: Reason | None, value: Any
                                ) -> None:
    first, second = verdicts(made(dataclasses.replace(GOOD, **change)))
    assert first.severity == Severity.NOTE
    assert [x.reason for x in second.findings] == [reason] * (reason is not None)
    assert [x for finding in second.findings for x in finding.values.values()] == (
        [value] * (reason is not None))


def test_a_joint_that_hardly_moves_is_refused_and_needs_a_motion() -> None:
    first, second = verdicts(made(moves=False))
    assert (second.severity, second.findings[0].reason) == (Severity.REFUSED, Reason.NOT_EXCITED)
    assert (first.needs_motion, second.needs_motion) == (False, True)


def test_only_doubts_that_motion_settles_ask_for_motion() -> None:
    coupled = CoupledFriction(0, Estimate(1.0), Estimate(0.1))
    cases: list[tuple[dict[str, Any], bool]] = [
        ({'coulomb': Estimate(5.0, 2.0)}, True), ({'coupled': (coupled,)}, False)]
    for change, asks in cases:
        _, second = verdicts(made(dataclasses.replace(GOOD, **change)))
        assert second.needs_motion == asks


def test_the_worst_finding_decides() -> None:
    findings = (Finding(Reason.STAMPS, Severity.CARE), Finding(Reason.UNITS, Severity.REFUSED, 1),
                Finding(Reason.ROTOR, Severity.NOTE, 0))
    later = [Finding(Reason.NO_GAINS, Severity.REFUSED, 1)]
    first, second = verdicts(made(findings=findings), later)
    assert first.word == 'usable with care' and second.word == 'not usable'
    assert [x.reason for x in second.findings] == [
        Reason.UNITS, Reason.NO_GAINS, Reason.STAMPS]
    # Those of all joints, and notes, are no doubts about this joint.
    assert [x.reason for x in second.doubts] == [Reason.UNITS, Reason.NO_GAINS]
    assert first.doubts == ()

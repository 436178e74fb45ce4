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

"""A joint whose numbers cannot be right is refused with its reason; others stay usable."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any, cast

from ctc_chattering.identification.findings import ALL_JOINTS, Estimate, Finding, Kind, Severity
from ctc_chattering.identification.friction import JointFriction
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.verdict import next_step, verdicts
import numpy as np
import pytest

NONE = Estimate.none('none shows')
GOOD = JointFriction(Estimate(5.0, 0.01, 'N*m'), Estimate(5.0, 0.01), Estimate(5.0, 0.01),
                     Estimate(0.0, 0.01), Estimate(1.0, 0.01), NONE, NONE, NONE)


def made(second: JointFriction = GOOD, lag: float = 0.0, source: str = 'command',
         findings: tuple[Finding, ...] = (), attributed: bool = True) -> Identification:
    """Return what `verdicts` reads of an identification of two joints."""
    timing = SimpleNamespace(drive=(1.0, np.array([0.0, lag]), np.zeros(2)), source=source)
    return cast(Identification, SimpleNamespace(
        joints=('a', 'b'), friction=[GOOD, second], timing=timing, findings=findings,
        selected=SimpleNamespace(attributed=attributed), unexplained=(), data=SimpleNamespace(
            torque=np.zeros((1, 2)), way=np.zeros((1, 2)))))


def test_a_joint_without_findings_is_usable() -> None:
    assert [str(x) for x in verdicts(made())] == ['usable'] * 2


@pytest.mark.parametrize('change, lag, source, severity, reason', [
    ({'coulomb': Estimate(-0.05, 0.1, 'N*m')}, 0.0, 'command', Severity.CARE, 'no friction'),
    ({'coulomb': Estimate(np.nan, 0.1)}, 0.0, 'command', Severity.REFUSED, 'nan'),
    ({'coulomb': Estimate(5.0, np.inf)}, 0.0, 'command', Severity.REFUSED, 'inf'),
    ({'coulomb': Estimate(5.0, 2.0)}, 0.0, 'command', Severity.CARE, 'longer motion'),
    ({'coulomb': Estimate(0.0, 0.003, 'N*m')}, 0.0, 'effort', Severity.REFUSED, 'gear'),
    ({'coulomb': Estimate.none('b hardly moves')}, 0.0, 'command', Severity.REFUSED, 'excite'),
    ({'offset': Estimate(4.0, 0.1)}, 0.0, 'command', Severity.CARE, 'directions'),
    ({'stribeck_velocity': Estimate(0.005, 0.1)}, 0.0, 'command', Severity.CARE, 'Stribeck'),
    ({}, 0.012, 'command', Severity.CARE, 'elastic')])
def test_numbers_beyond_physical_bounds(change: dict[str, Any], lag: float, source: str,
                                        severity: Severity, reason: str) -> None:
    first, second = verdicts(made(dataclasses.replace(GOOD, **change), lag, source))
    assert first.severity == Severity.NOTE
    assert second.severity == severity
    assert reason in str(second)
    assert second.usable == (severity < Severity.REFUSED)


def test_where_the_model_has_errors_a_longer_motion_is_no_cure() -> None:
    wide = dataclasses.replace(GOOD, coulomb=Estimate(5.0, 2.0))
    for attributed in (True, False):
        found = verdicts(made(wide, attributed=attributed))
        assert ('longer motion' in str(found[1])) == attributed
        assert ('ctc excite --for b' in next_step(found)) == attributed
        assert ('other reasons' in str(found[1])) != attributed
    # Where directions differ, no motion is missing.
    uneven = verdicts(made(dataclasses.replace(GOOD, offset=Estimate(4.0, 0.1))))
    assert uneven[1].findings[0].kind is Kind.UNEVEN and 'excite' not in next_step(uneven)


@pytest.mark.parametrize(('offset', 'half', 'uneven'), [
    (4.0, 0.1, True), (4.0, 1.4, True), (4.0, 1.6, False), (4.0, 3.9, False), (-4.0, 1.6, False),
    (-4.0, 1.4, True)])
def test_directions_differ_where_all_of_the_interval_says_so(
        offset: float, half: float, uneven: bool) -> None:
    """Check the end of the offset's interval that is nearer to 0: above half of the friction."""
    found = verdicts(made(dataclasses.replace(GOOD, offset=Estimate(offset, half))))
    kinds = [x.kind for x in found[1].findings]
    assert (Kind.UNEVEN in kinds) == uneven


def test_the_worst_finding_decides_and_only_its_like_are_reasons() -> None:
    findings = (Finding(Kind.DOUBT, ALL_JOINTS, 'jitter', 'use stamps'),
                Finding(Kind.NO_NUMBER, 1, 'backlash'), Finding(Kind.NOTE, 0, 'a note'))
    first, second = verdicts(made(findings=findings), [Finding(Kind.NO_NUMBER, 1, 'second')])
    assert str(first) == 'usable with care: jitter; use stamps'
    assert str(second) == 'not usable: backlash; second'
    assert [x.severity for x in second.findings] == [2, 2, 1]

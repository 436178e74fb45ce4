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
Verdict on the numbers of each joint: usable, usable with care, or not usable.

The prediction of unseen torque decides. A joint is usable if the identified model leaves only
noise of it, and its friction has a narrow interval. It is usable with care if it is predicted
better than by the given model. Else it is not usable. `results` shows the verdicts. The gains of a
joint that is not usable are left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
from typing import NamedTuple

from ctc_chattering.identification.findings import ALL_JOINTS, Finding, Reason, Severity
from ctc_chattering.identification.friction_terms import TermKind
from ctc_chattering.identification.identify import Identification
import numpy as np


@dataclasses.dataclass(frozen=True)
class JudgeLimits:
    """Limits between the verdicts, for RMS values of unseen torque."""

    #: RMS of the identified model over that of the given one. Above it, it is no better.
    max_rms_ratio: float = 0.97
    #: Lasting part of the unexplained torque of a usable joint.
    max_lasting: float = 0.3
    #: Unexplained torque of a usable joint, as a part of its friction.
    max_unexplained: float = 0.08
    #: Lasting torque that never matters, as a part of the friction.
    negligible: float = 2e-3
    #: Half an interval of friction of a usable joint, as a part of the Coulomb friction.
    max_half_interval: float = 0.2
    #: Smallest friction that an interval is compared with, as a part of the torque.
    min_friction: float = 0.05


LIMITS = JudgeLimits()
#: Reasons that another motion of the joint would settle.
SETTLED_BY_MOTION = (Reason.NOT_EXCITED, Reason.UNCERTAIN, Reason.BREAK_AWAY)


class Verdict(NamedTuple):
    """
    Verdict on the numbers of one joint.

    Attributes
    ----------
    joint : str
        Name.
    severity : Severity
        The worst of its findings.
    findings : tuple of Finding
        The worst first. Those of all joints are among them.

    """

    joint: str
    severity: Severity
    findings: tuple[Finding, ...]

    @property
    def usable(self) -> bool:
        """Usability of the joint's numbers."""
        return self.severity < Severity.REFUSED

    @property
    def word(self) -> str:
        """Verdict without its reasons."""
        return self.severity.label

    @property
    def doubts(self) -> tuple[Finding, ...]:
        """Return the findings on this joint alone, without notes."""
        return tuple(
            finding
            for finding in self.findings
            if finding.joint != ALL_JOINTS and finding.severity > Severity.NOTE
        )

    @property
    def needs_motion(self) -> bool:
        """Use of another motion, which would settle a doubt."""
        return any(finding.reason in SETTLED_BY_MOTION for finding in self.doubts)


def verdicts(identified: Identification, later: Sequence[Finding] = ()) -> list[Verdict]:
    """
    Return the verdict of each joint.

    Parameters
    ----------
    identified : Identification
        With its findings.
    later : sequence of Finding
        Findings on gains.

    """
    # A joint that is refused for another reason is not predicted either.
    refused = {
        finding.joint for finding in identified.findings if finding.severity == Severity.REFUSED
    }
    judged = [
        finding
        for joint in range(len(identified.joints))
        if joint not in refused
        for finding in _judge(identified, joint)
    ]
    findings = sorted(
        (*identified.findings, *judged, *later), key=lambda finding: -finding.severity
    )
    result = []
    for joint, name in enumerate(identified.joints):
        of_joint = tuple(finding for finding in findings if finding.joint in (joint, ALL_JOINTS))
        worst = max((finding.severity for finding in of_joint), default=Severity.NOTE)
        result.append(Verdict(name, worst, of_joint))
    return result


def _judge(identified: Identification, joint: int) -> Iterator[Finding]:
    """Yield the findings from the prediction of a joint's torque."""
    if not identified.fit.data.moving[joint]:
        yield Finding(Reason.NOT_EXCITED, Severity.REFUSED, joint)
        return
    prediction = identified.prediction
    values = {
        name: float(getattr(prediction, name)[joint])
        for name in (
            'recording_rms',
            'model_rms',
            'identified_rms',
            'typical_rms',
            'systematic_rms',
        )
    }
    lasting, typical = values['systematic_rms'], values['typical_rms']
    friction = _friction_rms(identified, joint)
    negligible = LIMITS.negligible * friction
    no_better = LIMITS.max_rms_ratio * min(values['model_rms'], values['recording_rms'])
    if values['identified_rms'] > no_better and lasting > negligible:
        yield Finding(Reason.NOT_PREDICTED, Severity.REFUSED, joint, values)
        return
    if (
        lasting > max(LIMITS.max_lasting * typical, negligible)
        or typical > LIMITS.max_unexplained * friction
    ):
        yield Finding(Reason.UNEXPLAINED, Severity.CARE, joint, values)
    yield from _find_wide_intervals(identified, joint)
    for coupled in identified.friction[joint].coupled:
        yield Finding(
            Reason.COUPLED,
            Severity.CARE,
            joint,
            {'coupled_joint': identified.joints[coupled.joint]},
        )


def _find_wide_intervals(identified: Identification, joint: int) -> Iterator[Finding]:
    """Yield a finding if friction has a wide interval."""
    friction = identified.friction[joint]
    smallest = LIMITS.min_friction * float(identified.prediction.recording_rms[joint])
    widest = LIMITS.max_half_interval * max(abs(friction.coulomb.number()), smallest)
    wide = {
        name: estimate
        for name, estimate in (('Coulomb', friction.coulomb), ('Stribeck', friction.stribeck))
        if estimate.half > widest
    }
    if wide:
        yield Finding(Reason.UNCERTAIN, Severity.CARE, joint, {'estimates': wide})


def _friction_rms(identified: Identification, joint: int) -> float:
    """Return the RMS of a joint's friction in motion [N·m]."""
    torque = identified.fit.torque(joint, tuple(TermKind))
    used = identified.fit.data.used[:, joint]
    return float(np.sqrt(np.square(torque[used]).mean())) if used.any() else 0.0

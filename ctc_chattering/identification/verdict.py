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

The prediction of unseen torque decides. A joint is usable if the identified model leaves no more
of it than noise and its friction has a narrow interval; usable with care if it predicts better
than the given model; and not usable if it does not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from ctc_chattering.identification.findings import (
    ALL_JOINTS,
    Finding,
    Reason,
    SETTLED_BY_MOTION,
    Severity,
)
from ctc_chattering.identification.friction_terms import TermKind
from ctc_chattering.identification.identify import Identification
import numpy as np

#: Words of a verdict.
WORDS = {Severity.NOTE: 'usable', Severity.CARE: 'usable with care',
         Severity.REFUSED: 'not usable'}
#: RMS of unseen torque of the identified over that of the given model, above which it is no
#: better.
NO_BETTER = 0.97
#: Part of the unexplained torque that may last longer than noise in a usable joint.
MOST_LASTING = 0.3
#: Part of the friction that may be unexplained in a usable joint.
MOST_UNEXPLAINED = 0.08
#: Part of the friction that never matters.
NEGLIGIBLE = 2e-3
#: Half an interval of friction of a usable joint, as a part of the Coulomb friction.
NARROW = 0.2
#: Part of the torque below which friction is little: intervals are then parts of this.
LITTLE_FRICTION = 0.05
EXCITE = 'record a motion of `ctc excite --for {}` and identify both bags together'


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
        The worst first; also those of all joints.

    """

    joint: str
    severity: Severity
    findings: tuple[Finding, ...]

    @property
    def usable(self) -> bool:
        """Whether its numbers are to be used."""
        return self.severity < Severity.REFUSED

    @property
    def word(self) -> str:
        """Verdict without its reasons."""
        return WORDS[self.severity]

    def __str__(self) -> str:
        """Return the verdict with its reasons and their cures."""
        reasons = ' '.join(finding.sentences for finding in self.findings
                           if finding.severity == self.severity > Severity.NOTE)
        return f'{self.word}: {reasons}' if reasons else self.word

    def as_mapping(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        return {'joint': self.joint, 'verdict': self.word, 'findings': [
            {'severity': WORDS[x.severity], 'about': x.reason.value, 'reason': x.text,
             'cure': x.cure} for x in self.findings]}

    def of_joint(self) -> tuple[Finding, ...]:
        """Return the findings on this joint alone, without notes."""
        return tuple(finding for finding in self.findings
                     if finding.joint != ALL_JOINTS and finding.severity > Severity.NOTE)


def of_all_joints(verdicts: Sequence[Verdict], severity: Severity) -> list[str]:
    """Return the findings on all joints together that have this severity."""
    findings = dict.fromkeys(finding for verdict in verdicts for finding in verdict.findings
                             if finding.joint == ALL_JOINTS and finding.severity == severity)
    return [finding.sentences for finding in findings]


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
    # What is refused for another reason is not predicted either.
    refused = {finding.joint for finding in identified.findings
               if finding.severity == Severity.REFUSED}
    judged = [finding for joint in range(len(identified.joints)) if joint not in refused
              for finding in _judged(identified, joint)]
    findings = sorted(dict.fromkeys((*identified.findings, *judged, *later)),
                      key=lambda finding: -finding.severity)
    result = []
    for joint, name in enumerate(identified.joints):
        of_joint = tuple(finding for finding in findings if finding.joint in (joint, ALL_JOINTS))
        worst = max((finding.severity for finding in of_joint), default=Severity.NOTE)
        result.append(Verdict(name, worst, of_joint))
    return result


def _judged(identified: Identification, joint: int) -> Iterator[Finding]:
    """Yield what the prediction of unseen torque says of a joint."""
    name = identified.joints[joint]
    if not identified.fit.data.moving[joint]:
        yield Finding(Reason.NOT_EXCITED, Severity.REFUSED, joint,
                      f'The joint {name} hardly moves',
                      f'Raise its kp where friction holds it, or {EXCITE.format(name)}')
        return
    prediction = identified.prediction
    recording, given, unseen, typical, lasting = (float(x[joint]) for x in (
        prediction.recording_rms, prediction.model_rms, prediction.identified_rms,
        prediction.typical_rms, prediction.systematic_rms))
    friction = _friction_rms(identified, joint)
    negligible = NEGLIGIBLE * friction
    if unseen > NO_BETTER * min(given, recording) and lasting > negligible:
        yield Finding(
            Reason.NOT_PREDICTED, Severity.REFUSED, joint,
            f'Unseen torque of {name} is not predicted: the identified model leaves {unseen:.3g} '
            f'of {recording:.3g} N*m RMS, and the given model {given:.3g} N*m',
            f'Look at the figure of its torque, and {EXCITE.format(name)}')
        return
    if lasting > max(MOST_LASTING * typical, negligible) or typical > MOST_UNEXPLAINED * friction:
        yield Finding(
            Reason.UNEXPLAINED, Severity.CARE, joint,
            f'{unseen:.3g} of {recording:.3g} N*m RMS of unseen torque is not explained'
            + f', {lasting:.2g} N*m of it lasts longer than noise' * (lasting > negligible),
            'Look at the figure of its torque; ka contains it')
    yield from _uncertain(identified, joint)
    yield from _coupled(identified, joint)


def _uncertain(identified: Identification, joint: int) -> Iterator[Finding]:
    """Yield that friction of a joint has a wide interval."""
    friction, name = identified.friction[joint], identified.joints[joint]
    little = LITTLE_FRICTION * float(identified.prediction.recording_rms[joint])
    widest = NARROW * max(abs(friction.coulomb.number()), little)
    numbers = {'Coulomb': friction.coulomb, 'Stribeck': friction.stribeck}
    wide = [f'{kind} friction is {estimate}' for kind, estimate in numbers.items()
            if estimate.half > widest]
    if wide:
        yield Finding(Reason.UNCERTAIN, Severity.CARE, joint,
                      f'Intervals are wide: {", ".join(wide)}', f'R{EXCITE.format(name)[1:]}')


def _friction_rms(identified: Identification, joint: int) -> float:
    """Return the RMS of the friction of a joint in its motion [N·m]."""
    torque = identified.fit.torque(joint, tuple(TermKind))
    used = identified.fit.data.used[:, joint]
    return float(np.sqrt(np.square(torque[used]).mean())) if used.any() else 0.0


def _coupled(identified: Identification, joint: int) -> Iterator[Finding]:
    """Yield that the torque of a joint has friction of another one."""
    for coupled in identified.friction[joint].coupled:
        yield Finding(
            Reason.COUPLED, Severity.CARE, joint,
            f'The torque of {identified.joints[joint]} has friction of '
            f'{identified.joints[coupled.joint]}: their gears are coupled, or the torques are '
            'those of the motors. Laws do not compensate it, and ka contains it',
            'Give torques at the joints: the transposed coupling matrix of the gears times those '
            'of the motors')


def next_step(verdicts: Sequence[Verdict]) -> str:
    """Return which joints are usable, and what to do next."""
    groups = {severity: [x.joint for x in verdicts if x.severity == severity]
              for severity in Severity}
    words = [f'{WORDS[severity]}: '
             f'{", ".join(names) if len(names) < len(verdicts) else "all joints"}'
             for severity, names in groups.items() if names]
    if groups[Severity.REFUSED]:
        step = 'do what the reasons ask for'
    else:
        step = 'run with identified.yaml'
    again = [verdict.joint for verdict in verdicts if any(
        finding.reason in SETTLED_BY_MOTION and finding.severity > Severity.NOTE
        for finding in verdict.findings)]
    if again:
        names = ','.join(again)
        step += f'; `ctc excite --for {names}` makes a motion that shows more of these joints'
    return f'{"; ".join(words)}. Next: {step}.'

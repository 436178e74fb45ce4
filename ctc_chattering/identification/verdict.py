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
What the numbers of each joint are good for: usable, usable with care, or not usable.

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

#: What is said of a joint before its reasons.
WORDS = {Severity.NOTE: 'usable', Severity.CARE: 'usable with care',
         Severity.REFUSED: 'not usable'}
#: RMS of unseen torque of the identified over that of the given model, above which it is no
#: better.
NO_BETTER = 0.97
#: Part of what is left of unseen torque that may last longer than noise in a usable joint.
MOST_LASTING = 0.3
#: Part of the friction that may be left of unseen torque in a usable joint,
MOST_UNEXPLAINED = 0.08
#: and that never matters.
NEGLIGIBLE = 2e-3
#: Half an interval of Coulomb friction of a usable joint, as a part of the larger of it and of
#: this part of the torque.
NARROW, LITTLE_FRICTION = 0.2, 0.05
EXCITE = 'record a motion of `ctc excite --for {}` and give both bags'


class Verdict(NamedTuple):
    """
    What the numbers of one joint are good for.

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
        """Whether there are numbers to be used."""
        return self.severity < Severity.REFUSED

    @property
    def word(self) -> str:
        """The verdict without its reasons."""
        return WORDS[self.severity]

    def __str__(self) -> str:
        """Return the verdict with its reasons, and what to record or to give."""
        reasons = '; '.join(finding.sentence for finding in self.findings
                            if finding.severity == self.severity > Severity.NOTE)
        return f'{self.word}: {reasons}' if reasons else self.word

    def as_mapping(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        return {'joint': self.joint, 'verdict': self.word, 'findings': [
            {'severity': WORDS[x.severity], 'about': x.reason.value, 'reason': x.text,
             'cure': x.cure} for x in self.findings]}

    def own(self) -> tuple[Finding, ...]:
        """Return what was noticed of this joint, without notes."""
        return tuple(finding for finding in self.findings
                     if finding.joint != ALL_JOINTS and finding.severity > Severity.NOTE)


def of_all_joints(verdicts: Sequence[Verdict], severity: Severity) -> list[str]:
    """Return what was noticed for all joints, with this severity."""
    findings = dict.fromkeys(finding for verdict in verdicts for finding in verdict.findings
                             if finding.joint == ALL_JOINTS and finding.severity == severity)
    return [finding.sentence for finding in findings]


def verdicts(identified: Identification, later: Sequence[Finding] = ()) -> list[Verdict]:
    """
    Return the verdict of each joint.

    Parameters
    ----------
    identified : Identification
        With what was noticed on the way.
    later : sequence of Finding
        What was noticed of gains.

    """
    judged = [finding for joint in range(len(identified.joints))
              for finding in _judged(identified, joint)]
    findings = sorted(dict.fromkeys((*identified.findings, *judged, *later)),
                      key=lambda finding: -finding.severity)
    result = []
    for joint, name in enumerate(identified.joints):
        own = tuple(finding for finding in findings if finding.joint in (joint, ALL_JOINTS))
        result.append(Verdict(name, own[0].severity if own else Severity.NOTE, own))
    return result


def _judged(identified: Identification, joint: int) -> Iterator[Finding]:
    """Yield what the prediction of unseen torque says of a joint."""
    name, prediction = identified.joints[joint], identified.prediction
    friction = identified.friction[joint]
    if not identified.fit.data.moving[joint]:
        yield Finding(Reason.NOT_EXCITED, Severity.REFUSED, joint, f'{name} hardly moves',
                      f'raise its kp where friction holds it, or {EXCITE.format(name)}')
        return
    recording, model, unseen, lasting = (float(x[joint]) for x in (
        prediction.recording_rms, prediction.model_rms, prediction.identified_rms,
        prediction.systematic_rms))
    level = _friction_rms(identified, joint)
    typical = float(prediction.typical_rms[joint])
    bar = max(MOST_LASTING * typical, NEGLIGIBLE * level)
    share = f'{unseen:.3g} N*m RMS, {unseen / max(recording, 1e-300):.1%} of the torque'
    if unseen > NO_BETTER * min(model, recording) and lasting > NEGLIGIBLE * level:
        yield Finding(
            Reason.NOT_PREDICTED, Severity.REFUSED, joint, f'the torque of {name} is not '
            f'predicted: {share}, is left of unseen torque, and {model:.3g} N*m by the model as '
            f'it was given', f'look at its torque in the figure; {EXCITE.format(name)}')
        return
    if lasting > bar or typical > MOST_UNEXPLAINED * level:
        yield Finding(
            Reason.UNEXPLAINED, Severity.CARE, joint, f'{share}, is not explained in unseen '
            f'torque; usually it is {typical:.2g} N*m, {typical / max(level, 1e-300):.0%} of the '
            f'friction, of which {lasting:.2g} N*m lasts longer than noise', 'look at the figure of its '
            'torque, and keep that much in reserve')
    coulomb = friction.coulomb
    wide = coulomb.half / max(abs(coulomb.number()), LITTLE_FRICTION * recording, 1e-300)
    if wide > NARROW:
        yield Finding(Reason.UNCERTAIN, Severity.CARE, joint, f'Coulomb friction of {name} is '
                      f'known to {coulomb} only', EXCITE.format(name))
    stribeck = friction.stribeck
    if stribeck.value is not None and stribeck.half > NARROW * abs(stribeck.value):
        yield Finding(Reason.UNCERTAIN, Severity.CARE, joint, f'Stribeck friction of {name} is '
                      f'known to {stribeck} only', EXCITE.format(name))
    yield from _coupled(identified, joint)


def _friction_rms(identified: Identification, joint: int) -> float:
    """Return the RMS of the friction of a joint in its motion [N·m]."""
    torque = identified.fit.torque(joint, tuple(TermKind))
    used = identified.fit.data.used[:, joint]
    return float(np.sqrt(np.square(torque[used]).mean())) if used.any() else 0.0


def _coupled(identified: Identification, joint: int) -> Iterator[Finding]:
    """Yield that the torque of a joint has friction of another one."""
    unknowns = identified.fit.unknowns
    index = unknowns.index(joint, TermKind.COUPLED_COULOMB)
    if index is None:
        return
    other = identified.joints[int(unknowns.term(index).which)]
    name = identified.joints[joint]
    yield Finding(
        Reason.COUPLED, Severity.CARE, joint, f'the torque of {name} has friction of {other}: '
        'their gears are coupled, or the torques are those of the motors; laws do not compensate '
        'it, and ka contains it',
        'give torques at the joints: the transposed coupling matrix of the gears times those of '
        'the motors')


def next_step(verdicts: Sequence[Verdict]) -> str:
    """Return in one sentence which joints are usable, and what to do next."""
    names = {severity: [x.joint for x in verdicts if x.severity == severity]
             for severity in Severity}
    parts = [f'{WORDS[severity]}: {", ".join(own) if len(own) < len(verdicts) else "all joints"}'
             for severity, own in names.items() if own]
    again = [verdict.joint for verdict in verdicts if any(
        finding.reason in SETTLED_BY_MOTION and finding.severity > Severity.NOTE
        for finding in verdict.findings)]
    refused = names[Severity.REFUSED]
    step = 'do what the reasons ask for' if refused else 'run with identified.yaml'
    if again:
        step += (f'; `ctc excite --for {",".join(again)}` makes a motion that shows more of these '
                 'joints')
    return f'{"; ".join(parts)}. Next: {step}.'

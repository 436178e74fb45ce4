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

"""What the numbers of each joint are good for: usable, usable with care, or not usable."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf, isfinite
from typing import Any, NamedTuple

from ctc_chattering.identification.drives import EFFORT
from ctc_chattering.identification.findings import ALL_JOINTS, Finding, Kind, SETTLED, Severity
from ctc_chattering.identification.friction import JointFriction
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.residual_tests import Unexplained
from ctc_chattering.identification.windows import STRIBECK
import numpy as np

#: What is said of a joint before its reasons.
WORDS = {Severity.NOTE: 'usable', Severity.CARE: 'usable with care',
         Severity.REFUSED: 'not usable'}
#: Mean of the sign of a torque from which on it has one sign.
_SIGN = 0.9
#: Part of the range of Stribeck velocities that counts as its end.
_END = 0.97
_EXCITE = 'record a motion of `ctc excite`'
_SETTLE = 'first do what the other reasons ask for, also of other joints: they make it uncertain'


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
        """Return whether there are numbers to be used."""
        return self.severity < Severity.REFUSED

    @property
    def word(self) -> str:
        """Return the verdict without its reasons."""
        return WORDS[self.severity]

    def __str__(self) -> str:
        """Return the verdict with its reasons, and what to record or to give."""
        reasons = '; '.join(x.text for x in self.findings
                            if x.severity == self.severity > Severity.NOTE)
        return f'{self.word}: {reasons}' if reasons else self.word

    def as_mapping(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        return {'joint': self.joint, 'verdict': self.word, 'findings': [
            {'severity': WORDS[x.severity], 'reason': x.reason, 'cure': x.cure}
            for x in self.findings]}

    def own(self) -> tuple[Finding, ...]:
        """Return what was noticed of this joint, without notes."""
        return tuple(x for x in self.findings
                     if x.joint != ALL_JOINTS and x.severity > Severity.NOTE)


def of_all_joints(verdicts: Sequence[Verdict], severity: Severity) -> list[str]:
    """Return what was noticed for all joints, with this severity."""
    found = dict.fromkeys(x for verdict in verdicts for x in verdict.findings
                          if x.joint == ALL_JOINTS and x.severity == severity)
    return [x.text for x in found]


def verdicts(found: Identification, more: Sequence[Finding] = ()) -> list[Verdict]:
    """
    Return the verdict of each joint.

    Parameters
    ----------
    found : Identification
        With what it has noticed itself; physical bounds are added here.
    more : sequence of Finding
        What was noticed later, as on a second bag.

    """
    known = sorted(dict.fromkeys((*found.findings, *_bounds(found), *more)),
                   key=lambda x: -x.severity)
    known = [x for x in known if x.severity > Severity.NOTE or x.kind.care == inf
             or x.kind == Kind.DELAYS]
    verdicts = []
    for i, name in enumerate(found.joints):
        mine = tuple(x for x in known if x.joint in (i, ALL_JOINTS))
        verdicts.append(Verdict(name, mine[0].severity if mine else Severity.NOTE, mine))
    return verdicts


def _bounds(found: Identification) -> Iterator[Finding]:
    """Yield what is beyond a physical bound, or at the end of what was looked for."""
    for i, (friction, lag) in enumerate(zip(found.friction, found.timing.drive[1])):
        left = found.unexplained[i] if found.unexplained else None
        held = ('friction holds it: raise its kp, or play a motion of `ctc excite --for '
                f'{found.joints[i]}` with a position controller, and give both bags')
        if lag > Kind.LAG.care and not any(
                x.joint == i and x.severity == Severity.REFUSED for x in found.findings):
            yield Finding(
                Kind.LAG, i, f'the lag of the drive is {lag:.3g} s, more than drives of arms '
                'have: an elastic joint, backlash or a delay of this joint looks like that',
                'measure the position behind the gear, or confirm that the drive is that slow',
                lag)
        if friction.coulomb.value is None:
            yield Finding(Kind.NO_MOTION, i, friction.coulomb.reason, held)
            continue
        if found.unexplained and left is None:
            yield Finding(Kind.MOTION, i, 'it slides for too short a time to test what its '
                          'friction depends on', held)
        yield from _directions(found, i, friction)
        yield from _how_well(found, i, left)
        speed = friction.stribeck_velocity.value
        if speed is not None and not STRIBECK[0] / _END < speed < STRIBECK[-1] * _END:
            yield Finding(Kind.DOUBT, i, f'the Stribeck velocity is {speed:.3g} rad/s, at the end '
                          f'of {STRIBECK[0]:g} to {STRIBECK[-1]:.3g} rad/s', _EXCITE)


def _directions(found: Identification, i: int, friction: JointFriction) -> Iterator[Finding]:
    """Yield that both directions of a joint differ, which may have another cause."""
    coulomb, offset = friction.coulomb, friction.offset
    if offset.value is None or not (coulomb.value or 0.0) > 0.0:
        return
    part = abs(offset.value) / coulomb.number()
    clear = part - offset.half / coulomb.number()
    torque = found.data.torque[found.data.way[:, i] != 0.0, i]
    if clear > Kind.UNEVEN.care:
        yield Finding(Kind.UNEVEN, i, f'both directions differ by twice {offset}, Coulomb '
                      f'friction is {coulomb}: more likely a constant torque that the model '
                      'lacks', 'check the model and the offset of the torque sensor', clear)
    elif clear > 0.0 and len(torque) and abs(float(np.sign(torque).mean())) > _SIGN:
        yield Finding(Kind.ONE_SIDED, i, f'forwards and backwards differ by twice {offset}, '
                      'and the torque has one sign: a dead band of the drive, a zero of the '
                      'torque or a constant torque that the model lacks looks the same; then '
                      'each direction is wrong by that, and their mean is right',
                      'record poses in which the load has the other sign', part)


def _how_well(found: Identification, i: int, left: Unexplained | None) -> Iterator[Finding]:
    """Yield that the Coulomb friction of a joint is not known well."""
    coulomb, attributed = found.friction[i].coulomb, found.selected.attributed
    measured, unexplained = found.timing.source == EFFORT, left is not None and left.off > 0.0
    part = coulomb.half / max(abs(coulomb.number()), 1e-300)
    if not part < 1.0:
        none = measured or unexplained or not isfinite(part)
        yield Finding(Kind.NO_NUMBER if none else Kind.DOUBT, i,
                      f'no friction shows: Coulomb friction is {coulomb}', f'{_EXCITE}, and say '
                      'where the torque is measured: behind the gear friction is not in it'
                      if measured or (attributed and not unexplained) else _SETTLE)
    elif not unexplained:
        kind, cure = (Kind.COULOMB_INTERVAL, 'record a longer motion') if attributed else (
            Kind.COULOMB_IN_DOUBT, _SETTLE)
        yield Finding(kind, i, f'Coulomb friction is known to {coulomb} only', cure, part)


def next_step(verdicts: Sequence[Verdict]) -> str:
    """Return in one sentence which joints are usable, and what to do next."""
    names = [[x.joint for x in verdicts if x.severity == severity] for severity in Severity]
    said = [f'{WORDS[severity]}: {", ".join(mine) if len(mine) < len(verdicts) else "all joints"}'
            for severity, mine in zip(Severity, names) if mine]
    again = [x.joint for x in verdicts if any(
        y.kind in SETTLED and y.severity > Severity.NOTE for y in x.findings)]
    if again:
        do = (f'`ctc excite --for {",".join(again)}` makes a motion that shows what is missing; '
              'then `ctc identify` with all bags')
    elif not names[Severity.REFUSED]:
        do = 'run with identified.yaml' + (
            ', or do first what the reasons ask for' if names[Severity.CARE] else '')
    else:
        do = 'do what the reasons ask for'
    return f'{"; ".join(said)}. Next: {do}.'

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
from math import isfinite
from typing import Any, NamedTuple

from ctc_chattering.identification.regression.estimate import Estimate
from ctc_chattering.identification.regression.finding import ALL_JOINTS, Finding, Severity
from ctc_chattering.identification.regression.identify import Identification
from ctc_chattering.identification.regression.joint_friction import JointFriction
from ctc_chattering.identification.regression.rows import STRIBECK
from ctc_chattering.identification.regression.torque import EFFORT
import numpy as np

#: What is said of a joint before its reasons.
WORDS = {Severity.NOTE: 'usable', Severity.CARE: 'usable with care',
         Severity.REFUSED: 'not usable'}
#: Part of the Coulomb friction by which both directions may differ before care is due.
_UNEVEN = 0.5
#: Part by which they may differ where the torque has one sign, and mean of its sign.
_ONE_SIDED, _SIGN = 0.05, 0.9
#: Half an interval of Coulomb friction as a part of it, above which care is due.
_WIDE = 0.2
#: Part of the range of Stribeck velocities that counts as its end.
_END = 0.97
#: Torque per torque unit of a signal, and part of a mass that may lack, at most.
_SCALES, _LIGHTEST = (0.4, 2.5), 0.9
#: A lag of a drive that is rare [s].
_LONG_LAG = 0.008
_EXCITE = 'record a motion of `ctc excite`'


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

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return the reasons for the verdict, with what to record or to give."""
        return tuple(x.text for x in self.findings
                     if x.severity == self.severity and x.severity > Severity.NOTE)

    def __str__(self) -> str:
        """Return the verdict with its reasons."""
        return ': '.join([self.word, *(['; '.join(self.reasons)] if self.reasons else [])])

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
    everything = [*found.findings, *_bounds(found), *more]
    verdicts = []
    for i, name in enumerate(found.joints):
        # The name stands before the verdict.
        mine = sorted(dict.fromkeys(x._replace(reason=x.reason.removeprefix(f'{name}: '))
                                    for x in everything if x.joint in (i, ALL_JOINTS)),
                      key=lambda x: -x.severity)
        verdicts.append(Verdict(name, max((x.severity for x in mine), default=Severity.NOTE),
                                tuple(mine)))
    return verdicts


def _bounds(found: Identification) -> Iterator[Finding]:
    """Yield what is beyond a physical bound, or at the end of what was looked for."""
    yield from _model_bounds(found)
    for i, (friction, lag) in enumerate(zip(found.friction, found.timing.drive[1])):
        left = found.unexplained[i] if found.unexplained else None
        if found.unexplained and left is None and friction.coulomb.value is not None:
            yield Finding(Severity.CARE, i, 'it slides for too short a time to test what its '
                          'friction depends on', _EXCITE)
        yield from _friction_bounds(i, friction, _one_sided(found, i))
        yield from _how_well(i, friction.coulomb, found.timing.source == EFFORT,
                             left is not None and left.off > 0.0)
        if lag >= _LONG_LAG and not any(x.joint == i and x.severity == Severity.REFUSED
                                        for x in found.findings):
            yield Finding(
                Severity.CARE, i, f'the lag of the drive is {lag:.3g} s, more than drives of arms '
                'have: an elastic joint or backlash looks like that',
                'measure the position behind the gear, or confirm that the drive is that slow')


def _one_sided(found: Identification, i: int) -> bool:
    """Return whether the torque of a joint has one sign nearly always while it slides."""
    torque = found.data.torque[found.data.way[:, i] != 0.0, i]
    return bool(len(torque)) and abs(float(np.sign(torque).mean())) > _SIGN


def _model_bounds(found: Identification) -> Iterator[Finding]:
    """Yield scales of a torque and masses that no robot has."""
    low, high = _SCALES
    for i, scale in enumerate(found.scale):
        if scale.value is not None and not low < scale.value < high:
            yield Finding(Severity.REFUSED, i, f'its torque would be {scale.value:.3g} times the '
                          f'signal, allowed: {low:g} to {high:g}; the model has other errors',
                          f'correct the model, or {_EXCITE}')
    for error, number in found.errors:
        if number.value is not None and not error.unit and number.value < -max(
                _LIGHTEST, number.half):
            yield Finding(Severity.REFUSED, ALL_JOINTS, f'{error.name} would have '
                          f'{1.0 + number.value:.2g} times its mass: the model has other errors',
                          f'correct the model, or {_EXCITE}')


def _directions(i: int, friction: JointFriction, one_sided: bool) -> Iterator[Finding]:
    """Yield that friction of each direction is not known where the torque has one sign."""
    offset, coulomb = friction.offset, friction.coulomb
    if one_sided and offset.value is not None and coulomb.value is not None and (
            _UNEVEN * coulomb.value >= abs(offset.value) > max(
                offset.half, _ONE_SIDED * coulomb.value)):
        yield Finding(Severity.CARE, i, f'forwards and backwards differ by twice {offset}, and '
                      'the torque has one sign: a dead band of the drive, a zero of the torque or '
                      'a constant torque that the model lacks looks the same; then each direction '
                      'is wrong by that, and their mean is right', 'record poses in which the '
                      'load has the other sign')


def _friction_bounds(i: int, friction: JointFriction, one_sided: bool) -> Iterator[Finding]:
    """Yield which numbers of the friction of a joint cannot be."""
    coulomb, offset = friction.coulomb, friction.offset
    if coulomb.value is None:
        yield Finding(Severity.REFUSED, i, coulomb.reason, _EXCITE)
        return
    if not isfinite(coulomb.value + coulomb.half):
        yield Finding(Severity.REFUSED, i, f'Coulomb friction is {coulomb}: no finite number',
                      _EXCITE)
    if offset.value is not None and abs(offset.value) - offset.half > _UNEVEN * coulomb.value:
        yield Finding(Severity.CARE, i, f'both directions differ by twice {offset}, Coulomb '
                      f'friction is {coulomb}: more likely a constant torque that the model '
                      'lacks', 'check the model and the offset of the torque sensor')
    yield from _directions(i, friction, one_sided)
    speed = friction.stribeck_velocity.value
    if speed is not None and not STRIBECK[0] / _END < speed < STRIBECK[-1] * _END:
        yield Finding(Severity.CARE, i, f'the Stribeck velocity is {speed:.3g} rad/s, at the end '
                      f'of {STRIBECK[0]:g} to {STRIBECK[-1]:.3g} rad/s', _EXCITE)


def _how_well(i: int, coulomb: Estimate, measured: bool, unexplained: bool) -> Iterator[Finding]:
    """Yield that the Coulomb friction of a joint is not known well."""
    if coulomb.value is None:
        return
    if abs(coulomb.value) <= coulomb.half and unexplained:
        yield Finding(Severity.REFUSED, i, f'Coulomb friction is not known: {coulomb} with what '
                      'is not explained', _EXCITE)
    elif abs(coulomb.value) <= coulomb.half:
        yield Finding(Severity.REFUSED if measured else Severity.CARE, i, 'no friction shows: '
                      f'Coulomb friction is {coulomb}', 'say where the torque is measured; behind '
                      'the gear friction is not in it')
    elif coulomb.half > _WIDE * abs(coulomb.value) and not unexplained:
        yield Finding(Severity.CARE, i, f'Coulomb friction is known to {coulomb} only',
                      'record a longer motion')

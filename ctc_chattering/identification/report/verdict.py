"""What the numbers of each joint are good for: usable, usable with care, or not usable."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from ctc_chattering.identification.regression.finding import ALL_JOINTS, Finding, Severity
from ctc_chattering.identification.regression.identify import Identification, JointFriction
from ctc_chattering.identification.regression.rows import STRIBECK
from ctc_chattering.identification.regression.torque import EFFORT

#: What is said of a joint before its reasons.
WORDS = {Severity.NOTE: 'usable', Severity.CARE: 'usable with care',
         Severity.REFUSED: 'not usable'}
#: Part of the Coulomb friction by which both directions may differ before care is due.
_UNEVEN = 0.5
#: Half an interval of Coulomb friction as a part of it, above which care is due.
_WIDE = 0.2
#: Friction as a part of the load that gears do not have, and that no gear has.
_MUCH_LOAD, _TOO_MUCH_LOAD = 0.25, 0.5
#: Part of the range of Stribeck velocities that counts as its end.
_END = 0.97
#: A longer lag is none of a drive that takes torques; the scan goes on to 39 ms [s].
_LONGEST_LAG = 0.025
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
        return tuple(f'{x.reason}; {x.cure}' if x.cure else x.reason for x in self.findings
                     if x.severity == self.severity and x.severity > Severity.NOTE)

    def __str__(self) -> str:
        """Return the verdict with its reasons."""
        return ': '.join([self.word, *(['; '.join(self.reasons)] if self.reasons else [])])

    def own(self) -> tuple[Finding, ...]:
        """Return what was noticed of this joint, without notes."""
        return tuple(x for x in self.findings
                     if x.joint != ALL_JOINTS and x.severity > Severity.NOTE)

    def apart(self) -> str:
        """Return the verdict, without the reasons that hold for all joints."""
        return str(self._replace(findings=self.own()))


def of_all_joints(verdicts: Sequence[Verdict], severity: Severity) -> list[str]:
    """Return what was noticed for all joints, with this severity."""
    found = dict.fromkeys(x for verdict in verdicts for x in verdict.findings
                          if x.joint == ALL_JOINTS and x.severity == severity)
    return [f'{x.reason}; {x.cure}' if x.cure else x.reason for x in found]


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
        mine = sorted(dict.fromkeys(x for x in everything if x.joint in (i, ALL_JOINTS)),
                      key=lambda x: -x.severity)
        verdicts.append(Verdict(name, max((x.severity for x in mine), default=Severity.NOTE),
                                tuple(mine)))
    return verdicts


def _bounds(found: Identification) -> Iterator[Finding]:
    """Yield what is beyond a physical bound, or at the end of what was looked for."""
    for i, (friction, lag) in enumerate(zip(found.friction, found.timing.drive[1])):
        yield from _friction_bounds(i, friction, found.timing.source)
        if lag >= _LONGEST_LAG:
            yield Finding(
                Severity.REFUSED, i, f'the lag of the drive would be {lag:.3g} s; drives have at '
                f'most {_LONGEST_LAG:g} s: an inertia that the model lacks looks like that',
                'correct inertia and rotor inertia of the model')


def _friction_bounds(i: int, friction: JointFriction, source: str) -> Iterator[Finding]:
    """Yield which numbers of the friction of a joint cannot be."""
    coulomb, offset, load = friction.coulomb, friction.offset, friction.load
    if coulomb.value is None:
        yield Finding(Severity.REFUSED, i, coulomb.reason, _EXCITE)
        return
    for name, number in (('Coulomb', coulomb), ('viscous', friction.viscous),
                         ('Stribeck', friction.stribeck)):
        if number.value is not None and number.value + number.half < 0.0:
            yield Finding(Severity.REFUSED, i, f'{name} friction is {number}; it cannot be below '
                          '0, so the model or the torque is wrong', 'check URDF and torque')
    if load.value is not None and load.value > _MUCH_LOAD:
        yield Finding(Severity.REFUSED if load.value > _TOO_MUCH_LOAD else Severity.CARE, i,
                      f'friction would be {load.value:.0%} of the load: with so little weight and '
                      'inertia, friction and load look the same', 'record it with a payload')
    if abs(coulomb.value) <= coulomb.half:
        severity = Severity.REFUSED if source == EFFORT else Severity.CARE
        yield Finding(severity, i, f'no friction shows: Coulomb friction is {coulomb}',
                      'say where the torque is measured; behind the gear friction is not in it')
    elif coulomb.half > _WIDE * abs(coulomb.value):
        yield Finding(Severity.CARE, i, f'Coulomb friction is known to {coulomb} only',
                      'record a longer motion')
    elif offset.value is not None and abs(offset.value) - offset.half > _UNEVEN * coulomb.value:
        yield Finding(Severity.CARE, i, f'both directions differ by twice {offset}, Coulomb '
                      f'friction is {coulomb}: more likely a constant torque that the model '
                      'lacks', 'check the model and the offset of the torque sensor')
    speed = friction.stribeck_velocity.value
    if speed is not None and not STRIBECK[0] / _END < speed < STRIBECK[-1] * _END:
        yield Finding(Severity.CARE, i, f'the Stribeck velocity is {speed:.3g} rad/s, at the end '
                      f'of {STRIBECK[0]:g} to {STRIBECK[-1]:.3g} rad/s', _EXCITE)

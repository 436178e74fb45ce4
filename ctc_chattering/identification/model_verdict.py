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

"""What the errors of a model are, in numbers with intervals and in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses
from math import inf

from ctc_chattering.identification.attribution import Projected
from ctc_chattering.identification.bodies import body_estimate, BodyEstimate
from ctc_chattering.identification.findings import ALL_JOINTS, Estimate, Finding, Kind, NONE
from ctc_chattering.identification.friction import drive_terms, JointFriction, Selected
from ctc_chattering.identification.least_squares import Term, TermKind
from ctc_chattering.identification.model_errors import (
    ALL,
    BODIES,
    Cause,
    CauseKind,
    DRIVE,
    ErrorColumns,
    ModelError,
)
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Least turn of gravity for which columns are made anew [rad].
_TURN = 3e-3
#: Part across the plane of an arm from which on a direction is one that no motion shows.
_PART = 1e-6
#: Least half of an interval of a torque scale.
_TRUSTED = 1e-4
#: Part of a shift of a centre by which its distance changes where the joint's zero may be off.
_TURNED = 0.1
#: Part of the Coulomb friction below which another friction is nothing (viscous: at 1 rad/s).
_NOTHING = 1e-4
_RECORD = 'record a motion with more speed and larger accelerations of all joints'
_CORRECT = 'correct the description'


def tilted(selected: Selected, columns: ErrorColumns | None) -> Array | None:
    """Return the gravity that causes name, shape (3,) [m/s²]; None where it is the model's."""
    if columns is None or selected.explanation is None:
        return None
    for cause, value in zip(selected.explanation.causes, selected.explanation.values):
        if cause.kind == CauseKind.GRAVITY and np.abs(value).max() > _TURN:
            return (columns.prior + cause.errors(columns, value))[-3:]
    return None


class ModelVerdict:
    """
    Causes of a model's errors.

    Parameters
    ----------
    selected : Selected
        The regression.
    columns : ErrorColumns or None
        Its columns; None for a model that has none.
    candidates : sequence of ModelError
        Errors of masses that were looked for.
    joints : sequence of str, length n
        Names.

    """

    def __init__(self, selected: Selected, columns: ErrorColumns | None,
                 candidates: Sequence[ModelError], joints: Sequence[str]) -> None:
        self._selected, self._columns, self._joints = selected, columns, joints
        self._candidates = candidates
        self._found: list[tuple[Cause, list[Estimate]]] = []
        if selected.explanation is not None and selected.attributed:
            self._found = list(self._estimates(selected.explanation.causes))

    def _estimates(self, found: Sequence[Cause]) -> Iterator[tuple[Cause, list[Estimate]]]:
        """Yield causes with their numbers."""
        place = 0
        for cause in found:
            if cause.kind in DRIVE:
                terms = drive_terms([cause])
            else:
                terms = [Term(TermKind.MODEL, -1, place + k) for k in range(len(cause.size))]
                place += len(terms)
            yield cause, [Estimate(*self._selected.interval(term)) for term in terms]

    def errors(self) -> list[tuple[ModelError, Estimate]]:
        """Return the masses that are off."""
        return [(self._candidates[cause.which],
                 Estimate(number.value, number.half, self._candidates[cause.which].unit))
                for cause, (number, *_) in self._found if cause.kind == CauseKind.LINK]

    def _none(self) -> Estimate:
        """Return why a number that is not among the causes is none."""
        if self._columns is None:
            return Estimate.none('the model has no regressor')
        if not self._selected.attributed:
            return Estimate.none("the model's errors cannot be attributed")
        return Estimate.none(NONE)

    def rotor(self) -> list[Estimate]:
        """Return the inertia of rotors that the model lacks, length n [kg·m²]."""
        found = [self._none() for _ in self._joints]
        if any(cause.kind in BODIES for cause, _ in self._found):
            found = [Estimate.none('beside another error of a body no motion tells it from that'
                                   )] * len(found)
        for cause, numbers in self._found:
            if cause.kind == CauseKind.ROTOR and found[0].shows_none:
                which = range(len(found)) if cause.which == ALL else [cause.which]
                for i, number in zip(which, numbers):
                    found[i] = dataclasses.replace(number, unit='kg*m^2')
        return found

    def scale(self) -> list[Estimate]:
        """Return the torque at each joint per torque of the signal, length n."""
        found = [self._none() for _ in self._joints]
        selected = self._selected
        if selected.projected is not None and selected.explanation is not None:
            for i in selected.projected.joints:
                half = max(_TRUSTED, 2.0 * selected.projected.deviation(
                    selected.explanation, Cause(CauseKind.SCALE, i, np.full(1, 0.1))))
                if selected.attributed:
                    found[i] = Estimate(1.0, half)
        for cause, (number, *_) in self._found:
            if cause.kind == CauseKind.SCALE:
                for i in range(len(found)) if cause.which == ALL else [cause.which]:
                    found[i] = Estimate(1.0 + (number.value or 0.0), number.half)
        return found

    def gravity(self) -> tuple[Estimate, ...]:
        """Return gravity in the frame of the base, length 3 [m/s²]; empty without columns."""
        if self._columns is None:
            return ()
        after, across = self._columns.prior[-3:], self._columns.across()
        halves = np.zeros(3)
        for cause, numbers in self._found:
            if cause.kind == CauseKind.GRAVITY:
                value = np.array([(x.value or 0.0) for x in numbers])
                after = after + cause.errors(self._columns, value)[-3:]
                steps = [cause.errors(self._columns, value + step)[-3:] - cause.errors(
                    self._columns, value - step)[-3:] for step in np.diag([_TURN, _TURN])]
                half = np.array([x.half for x in numbers])
                halves = np.linalg.norm(half[:, None] * steps, axis=0) / (2.0 * _TURN)
        unseen = np.abs(across) > _PART if len(across) else np.zeros(3, bool)
        return tuple(Estimate.none('no motion shows gravity across the plane of the arm') if bad
                     else Estimate(float(x), float(half), 'm/s^2')
                     for x, half, bad in zip(after, halves, unseen))

    def bodies(self, projected: Projected | None) -> BodyEstimate | None:
        """Return the inertial parameters of all bodies; None for a model without these."""
        if projected is None:
            return None
        return body_estimate(projected, self._selected.scales, self._bodies())

    def _bodies(self) -> list[str]:
        """Return a name for the body of each joint."""
        links = [x.name for x in self._candidates if not x.unit]
        return links if len(links) == len(self._joints) else [
            f'body of {name}' for name in self._joints]

    def findings(self) -> Iterator[Finding]:
        """Yield what makes numbers doubtful."""
        selected, joints = self._selected, self._joints
        if self._columns is None:
            yield Finding(Kind.DOUBT, ALL_JOINTS, (
                'the model is no URDF and offers no regressor: its errors are not looked for, and '
                'are in the friction'), 'give the robot as a URDF')
            return
        if selected.explanation is None:
            return
        for cause, numbers in self._found:
            joint = cause.which if cause.kind in (*DRIVE, CauseKind.ROTOR) else ALL_JOINTS
            yield Finding(Kind.DOUBT, joint, self._words(cause, numbers), _cure(cause))
        if not selected.attributed:
            likely = ', '.join(self._name(cause) for cause in selected.explanation.causes)
            yield Finding(Kind.DOUBT, ALL_JOINTS, (
                'the model has errors that no single cause explains'
                + (f' (the most likely: {likely})' if likely else '')
                + '; friction is identified beside all of them'),
                f'{_CORRECT}: masses, centres of mass, rotor inertias, mounting')
        for other in selected.alike[:3]:
            yield Finding(Kind.DOUBT, ALL_JOINTS, (
                'the torque is explained as well by: '
                + ', '.join(self._name(cause) for cause in other.causes)
                + '; intervals of friction contain both'), _RECORD)
        for i, scale in enumerate(self.scale()):
            if scale.value is not None and scale.half > Kind.SCALE_INTERVAL.care:
                yield Finding(Kind.SCALE_INTERVAL, i, (
                    f'{joints[i]}: the motion shows the scale of its torque to '
                    f'±{scale.half:.0%} only: friction is as wrong as the torque constant'), (
                    f'{_RECORD}, or with a known payload'), scale.half)

    def _name(self, cause: Cause) -> str:
        """Return a cause in words."""
        kind, i = cause.kind, cause.which
        if kind in (*DRIVE, CauseKind.ROTOR):
            return f'{kind.value} of {"all joints" if i == ALL else self._joints[i]}'
        if kind == CauseKind.LINK:
            return f'mass of {self._candidates[i].name}'
        if kind in (CauseKind.BODY, CauseKind.CENTRE):
            return f'{kind.value} of {self._bodies()[i]}'
        return str(kind.value)

    def _centre(self, i: int) -> Array:
        """Return the centre of mass of a body in the model, shape (3,) [m]."""
        assert self._columns is not None
        m, *moments = self._columns.prior[10 * i:10 * i + 4]
        return np.array(moments) / (m or np.inf)

    def _words(self, cause: Cause, numbers: Sequence[Estimate]) -> str:
        """Return what a cause does, with its numbers."""
        first, name = numbers[0], self._name(cause)
        size = first.value or 0.0
        if cause.kind == CauseKind.SCALE:
            return (f'{name}: the torque is {1.0 + size:.4g} ± {first.half:.1g} times '
                    'the signal, a wrong torque constant or gear ratio')
        if cause.kind in DRIVE:
            dead = cause.kind == CauseKind.DEAD_BAND
            part = ('N*m: the drive takes it from each command' if dead else
                    '1/(N*m): by this times the torque its torque constant is lower')
            return f'{name}: {_listed(numbers)} {part}'
        if cause.kind == CauseKind.ROTOR:
            if all(x.half > abs(x.value or 0.0) for x in numbers):
                return f'{name}: the motion does not show how much the model lacks'
            return f'{name}: {_listed(numbers)} kg*m^2 at the joint are missing in the model'
        if cause.kind == CauseKind.GRAVITY and len(cause.direction):
            turn = np.degrees((size, first.half))
            left = 1.0 - (numbers[1].value or 0.0)
            return (f'{name}: the base is turned by {turn[0]:.2f} ± {turn[1]:.1g} degrees in the '
                    f'plane of the arm, where gravity is {left:.4f} ± {numbers[1].half:.1g} times '
                    'that of the model; how it leans across the plane no motion shows')
        if cause.kind == CauseKind.GRAVITY:
            turn = np.degrees([((x.value or 0.0), x.half) for x in numbers])
            return (f'{name}: the base is turned by {turn[0, 0]:.2f} ± {turn[0, 1]:.1g} degrees '
                    f'about x and {turn[1, 0]:.2f} ± {turn[1, 1]:.1g} about y')
        if cause.kind == CauseKind.CENTRE:
            shift = ', '.join(f'{(x.value or 0.0):.4g} ± {x.half:.1g}' for x in numbers)
            return (f'{name}: off by {shift} m in x, y, z of its joint'
                    + zero_in_words(self._centre(cause.which), [x.value or 0.0 for x in numbers]))
        if cause.kind == CauseKind.BODY:
            return f'{name}: not as in the model; a payload or a tool is fixed to it'
        unit = self._candidates[cause.which].unit if cause.kind == CauseKind.LINK else ''
        return (f'{name}: {size:+.4g} ± {first.half:.1g} kg' if unit else
                f'{name}: {size:+.2%} ± {first.half:.2%}')


def zero_in_words(centre: Array, shift: Sequence[float]) -> str:
    """Return which zero of the joint looks like a shift of a centre [m]; empty if none does."""
    far, size = float(np.linalg.norm(centre)), float(np.linalg.norm(shift))
    change = float(np.linalg.norm(centre + shift)) - far
    if not 0.0 < size < far or abs(change) > _TURNED * size:
        return ''
    return (f'; a zero of this joint that is off by {np.degrees(size / far):.2g} degrees or more '
            'looks like that')


def _listed(numbers: Sequence[Estimate]) -> str:
    """Return numbers with their intervals."""
    return ', '.join(str(dataclasses.replace(x, unit='')) for x in numbers)


def _cure(cause: Cause) -> str:
    """Return what to do about a cause."""
    return {CauseKind.SCALE: 'correct the torque constant of the drive, or give --effort',
            CauseKind.DEAD_BAND: 'compensate the dead band in the drive',
            CauseKind.FADING: 'linearise the torque in the drive, or record smaller torques',
            CauseKind.GRAVITY: 'level the base, or turn the root of the description',
            }.get(cause.kind, _CORRECT)


def physical(friction: Sequence[JointFriction], joints: Sequence[str]) -> Iterator[Finding]:
    """Yield numbers of friction that no joint can have."""
    for i, one in enumerate(friction):
        for what, number in (('Coulomb friction', one.coulomb), ('viscous friction', one.viscous)):
            least = _NOTHING * abs(one.coulomb.value or 0.0)
            if number.value is not None and number.value < -least:
                yield Finding(Kind.NEGATIVE_FRICTION, i, (
                    f'{joints[i]}: {what} of {number}, allowed: at least 0; the model, the '
                    'torque signal or its side of the gear is wrong'), (
                    'check the description and what the effort is (--effort)'),
                    -number.value / max(number.half, 1e-300))
        load = one.load.value
        if load is not None and not 0.0 <= load < Kind.LOAD.refused:
            yield Finding(Kind.LOAD, i, (
                f'{joints[i]}: friction of {load:.2f} times the load, allowed: 0 to '
                f'{Kind.LOAD.refused:g}'),
                'check the description and what the effort is (--effort)', inf)

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

from ctc_chattering.identification.attribution import (
    ALL,
    BODIES,
    body_names,
    Cause,
    CauseKind,
    Projected,
)
from ctc_chattering.identification.bodies import body_estimate, BodyEstimate
from ctc_chattering.identification.findings import (
    ALL_JOINTS,
    Estimate,
    Finding,
    Kind,
    NONE,
    NONE_ABOVE,
)
from ctc_chattering.identification.friction import Selected, TOLD
from ctc_chattering.identification.least_squares import Data, Term, TermKind
from ctc_chattering.identification.model_errors import ErrorColumns, ModelError
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Least change of gravity for which columns are made anew, as a part of it.
_TURN = 3e-3
#: Part of a direction that lies among others from which on it is one of them.
_PART = 1e-6
#: Least half of an interval of a torque scale, and the part of a number's size that is rounding.
_TRUSTED, _ROUNDING = 1e-4, 1e-8
#: Mean of the sign of a torque, or of that times the direction, from which on it has that sign.
_ALONG = 0.9
_RECORD = 'record a motion with more speed and larger accelerations of all joints'
_CORRECT = 'correct the description'
#: What the numbers of a cause are, and what to do about it.
_WORDS = {
    CauseKind.SCALE: ('times the signal is the torque, by a wrong torque constant or gear ratio',
                      'correct the torque constant of the drive, or give --effort'),
    CauseKind.DEAD_BAND: ('N*m are taken by the drive from each command',
                          'compensate the dead band in the drive'),
    CauseKind.FADING: ('1/(N*m) times the torque is lost of the torque constant',
                       'linearise the torque in the drive, or record smaller torques'),
    CauseKind.GRAVITY: ('', 'level the base, or turn the root of the description'),
    CauseKind.ROTOR: ('kg*m^2 at the joint are missing in the model', _CORRECT),
    CauseKind.LINK: ('as a part of that of the model', _CORRECT),
    CauseKind.PAYLOAD: ('kg at the tip, against the model', _CORRECT),
    CauseKind.MASSES: ('as a part of those of the model', _CORRECT),
    CauseKind.CENTRE: ('m in x, y, z of its joint against the model; a wrong zero of the joint '
                       'looks like that', _CORRECT),
    CauseKind.BODY: ('not as in the model; a payload or a tool is fixed to it', _CORRECT)}


def turned_gravity(selected: Selected, columns: ErrorColumns | None) -> Array | None:
    """Return the gravity that causes name, shape (3,) [m/s²]; None where it is the model's."""
    found = selected.explanation
    for cause, value in zip(found.causes, found.values) if found and columns else ():
        assert columns is not None
        down = columns.prior[-3:]
        if cause.kind == CauseKind.GRAVITY and (
                np.linalg.norm(value) > _TURN * np.linalg.norm(down)):
            return np.asarray(down + columns.directions @ value)
    return None


def lean(before: Array, after: Array) -> float:
    """Return the angle between two vectors of gravity [degrees]."""
    one, other = (x / np.linalg.norm(x) for x in (before, after))
    return float(np.degrees(
        2.0 * np.arctan2(np.linalg.norm(one - other), np.linalg.norm(one + other))))


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
        self._candidates, index = candidates, 0
        self._found: list[tuple[Cause, list[Estimate]]] = []
        for cause in selected.believed.causes if selected.believed else ():
            # Of what no window shows, as dead bands of commands that chatter, there is rounding.
            self._found.append((cause, [
                Estimate(*x) if max(map(abs, x)) > _ROUNDING * size else Estimate(0.0)
                for k, size in enumerate(cause.size)
                for x in [selected.combined({Term(TermKind.MODEL, -1, index + k): 1.0})]]))
            index += len(cause.size)

    def errors(self) -> list[tuple[ModelError, Estimate]]:
        """Return the masses that are off."""
        return [(self._candidates[cause.which], dataclasses.replace(
            number, unit=self._candidates[cause.which].unit))
            for cause, (number, *_) in self._found
            if cause.kind in (CauseKind.LINK, CauseKind.PAYLOAD)]

    def _none(self) -> list[Estimate]:
        """Return why numbers that are not among the causes are none, length n."""
        reason = NONE if self._selected.attributed else "the model's errors cannot be attributed"
        return [Estimate.none(reason if self._columns else 'the model has no regressor')
                for _ in self._joints]

    def _of(self, kind: CauseKind) -> Iterator[tuple[int, Estimate]]:
        """Yield the joints of causes of a kind, each with its number."""
        for cause, numbers in self._found:
            if cause.kind == kind:
                which = range(len(self._joints)) if cause.which == ALL else [cause.which]
                yield from zip(which, numbers * (len(which) // len(numbers)))

    def rotor(self) -> list[Estimate]:
        """Return the inertia of rotors that the model lacks, length n [kg·m²]."""
        found = self._none()
        if any(cause.kind in BODIES for cause, _ in self._found):
            return [Estimate.none('beside another error of a body no motion tells it from that')
                    ] * len(found)
        for i, number in self._of(CauseKind.ROTOR):
            found[i] = dataclasses.replace(number, unit='kg*m^2')
        return found

    def scale(self) -> list[Estimate]:
        """Return the torque at each joint per torque of the signal, length n."""
        found, known, projected = self._none(), self._selected.believed, self._selected.projected
        if known is not None and projected is not None:
            for i in projected.joints:
                found[i] = Estimate(1.0, max(_TRUSTED, 2.0 * projected.deviation(known, i)))
        for i, number in self._of(CauseKind.SCALE):
            found[i] = dataclasses.replace(number, value=1.0 + number.number())
        return found

    def dead_band(self, data: Data, levels: Sequence[float]) -> list[Estimate]:
        """
        Return what each drive takes of its command, length n [N·m].

        Where the motion does not tell it from friction, the reason says in which number it is.
        """
        found, known, projected = self._none(), self._selected.believed, self._selected.projected
        if known is not None and projected is not None:
            for i in projected.joints:
                half = 2.0 * projected.deviation(known, i, kind=CauseKind.DEAD_BAND)
                sign = np.sign(data.torque[:, i]) * np.abs(data.way[:, i])
                least = _ALONG * float(np.square(sign).sum())
                found[i] = Estimate.none(
                    f'{NONE_ABOVE}{half:.2g} N*m' if half < TOLD * levels[i] else
                    'in Coulomb friction (no torque is against the motion)'
                    if sign @ data.way[:, i] > least else
                    'in forwards, backwards (the torque has one sign)'
                    if abs(sign.sum()) > least else 'the sign of the torque does not show it')
        for i, number in self._of(CauseKind.DEAD_BAND):
            if number.half:
                found[i] = dataclasses.replace(number, unit='N*m')
        return found

    def gravity(self) -> tuple[Estimate, ...]:
        """Return gravity in the frame of the base, length 3 [m/s²]; empty without columns."""
        if self._columns is None:
            return ()
        shown, after, half = self._columns.directions, self._columns.prior[-3:], np.zeros(3)
        for cause, numbers in self._found:
            if cause.kind == CauseKind.GRAVITY:
                after = after + shown @ [x.number() for x in numbers]
                half = np.sqrt(np.square(shown) @ np.square([x.half for x in numbers]))
        # Of all directions, or of those of a planar arm.
        unseen = np.linalg.norm(shown, axis=1) < 1.0 - _PART
        return tuple(Estimate.none('no motion shows gravity across the plane of the arm') if bad
                     else Estimate(float(x), float(y), 'm/s^2')
                     for x, y, bad in zip(after, half, unseen))

    def bodies(self, projected: Projected | None) -> BodyEstimate | None:
        """Return the inertial parameters of all bodies; None for a model without these."""
        return None if projected is None else body_estimate(
            projected, self._selected.believed, body_names(self._candidates, self._joints))

    def findings(self) -> Iterator[Finding]:
        """Yield what makes numbers doubtful."""
        selected = self._selected
        if self._columns is None:
            yield Finding(Kind.DOUBT, ALL_JOINTS, (
                'the model is no URDF and offers no regressor: its errors are not looked for, and '
                'are in the friction'), 'give the robot as a URDF')
        if selected.explanation is None:
            return
        for cause, numbers in self._found:
            # What may be none needs no care.
            kind = Kind.DOUBT if any(abs(x.number()) > x.half for x in numbers) else Kind.NOTE
            yield Finding(kind, cause.joint, self._words(cause, numbers), _WORDS[cause.kind][1])
        if not selected.attributed:
            likely = ', '.join(cause.name for cause in selected.explanation.causes)
            yield Finding(Kind.DOUBT, ALL_JOINTS, (
                'the model has errors that no single cause explains'
                + (f' (the most likely: {likely})' if likely else '')
                + '; friction is identified beside all of them'),
                f'{_CORRECT}: masses, centres of mass, rotor inertias, mounting')
        for other in selected.alike[:3]:
            yield Finding(Kind.DOUBT, ALL_JOINTS, (
                'the torque is explained as well by: '
                + ', '.join(cause.name for cause in other.causes)
                + '; intervals of friction contain both'), _RECORD)
        for i, scale in enumerate(self.scale()):
            if scale.value is not None and scale.half > Kind.SCALE_INTERVAL.care:
                yield Finding(Kind.SCALE_INTERVAL, i, 'the motion shows the scale of its torque '
                              f'to ±{scale.half:.0%} only: friction is as wrong as the torque '
                              'constant', f'{_RECORD}, or with a known payload', scale.half)

    def _words(self, cause: Cause, numbers: Sequence[Estimate]) -> str:
        """Return what a cause does, with its numbers."""
        what, shown = _WORDS[cause.kind][0], ', '.join(str(x) if x.half else '-' for x in numbers)
        if cause.kind == CauseKind.BODY:
            return f'{cause.name}: {what}'
        if cause.kind == CauseKind.GRAVITY:
            assert self._columns is not None
            before = self._columns.directions.T @ self._columns.prior[-3:]
            after = before + [x.number() for x in numbers]
            return f'{cause.name}: the base is turned by {lean(before, after):.2f} degrees'
        if cause.which == ALL and len(numbers) == len(self._joints) > 1:
            shown = ', '.join(f'{name} {x}' for name, x in zip(self._joints, numbers) if x.value)
        if cause.kind == CauseKind.SCALE:
            shown = str(dataclasses.replace(numbers[0], value=1.0 + numbers[0].number()))
        return f'{cause.name}: {shown} {what}'

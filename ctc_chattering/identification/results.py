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

"""Whether what was identified predicts a run that was not used for the fit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import dataclasses
from functools import cached_property
from math import isfinite
from pathlib import Path
from typing import Any

from ctc_chattering.analysis import page
from ctc_chattering.analysis.drawing import FigureFile
from ctc_chattering.analysis.markup import fragment
from ctc_chattering.analysis.tables import fitted, paragraph, shown, Table
from ctc_chattering.bags.recording import Recording, stretches
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.drives import has
from ctc_chattering.identification.findings import (
    ALL_JOINTS,
    Estimate,
    Finding,
    Kind,
    NONE,
    NONE_ABOVE,
    Severity,
)
from ctc_chattering.identification.gains import Recommendation
from ctc_chattering.identification.identify import check_alike, Identification
from ctc_chattering.identification.perturbation import MeasuredPerturbation, perturbation
from ctc_chattering.identification.timing import lag_in_words
from ctc_chattering.identification.verdict import (
    next_step,
    of_all_joints,
    Verdict,
    verdicts,
    WORDS,
)
import numpy as np


@dataclasses.dataclass(frozen=True)
class Validation:
    """
    Another run, predicted.

    Attributes
    ----------
    name : str
        Of its bag.
    run : MeasuredPerturbation
        P, measured and predicted.

    """

    name: str
    run: MeasuredPerturbation

    def findings(self, ka: Sequence[float | None]) -> Iterator[Finding]:
        """
        Yield what this run says of the numbers of each joint.

        Parameters
        ----------
        ka : sequence of float or None, shape (n,)
            Recommended [N·m]; None for a joint that is not usable.

        """
        moved = np.isfinite(self.run.predicted).sum(axis=0) > 0
        for i, (whole, rest, peak, most) in enumerate(zip(*self.run.misfit(), self.run.peak, ka)):
            if not moved[i]:
                yield Finding(Kind.NOTE, i, f'it hardly moves in {self.name}')
                continue
            part = rest / max(whole, 1e-12)
            if part > Kind.NOT_PREDICTED.care:
                yield Finding(
                    Kind.NOT_PREDICTED, i,
                    f'{part:.0%} of P, {rest:.3g} N*m RMS, are not predicted in {self.name}',
                    'record a motion like that one too, and give both bags', part)
            if most is not None and peak > most:
                yield Finding(
                    Kind.BEYOND_KA, i, f'|P| reaches {peak:.3g} N*m in {self.name}, beyond '
                    f'ka = {most:.3g} N*m', 'record a motion like that one too', peak / most)


def validate(found: Identification, recording: Recording, model: Model) -> Validation:
    """
    Return how another run is predicted.

    Parameters
    ----------
    found : Identification
        Of other recordings.
    recording : Recording
        Checked.
    model : Model
        As `identify` has it.

    Raises
    ------
    CtcError
        If the run has other joints, another period, or no torque of the same source.

    """
    period = found.clock.period
    check_alike(recording, found.joints, period, 'the identified run')
    parts = [part for part in stretches(recording, period)
             if len(part.q) * period > 1.0 and has(part, found.timing.source) is not None]
    if not parts:
        raise CtcError(f'{recording.name}: no second without a gap that has a torque of the '
                       f'source {found.timing.source}')
    return Validation(recording.name, perturbation(found, found.windows(parts, model)))


#: In place of a number that there is none of; why is in the verdict, or in the JSON file.
NO_NUMBER = '-'
#: With it begins the reason why there is a bound in place of a number.
_AT_LEAST = 'at least '
#: Friction in the order of the table: field and heading.
FRICTION = (('coulomb', 'Coulomb [N*m]'), ('forwards', 'forwards'), ('backwards', 'backwards'),
            ('viscous', 'viscous [N*m*s/rad]'), ('stribeck', 'Stribeck [N*m]'),
            ('stribeck_velocity', 'its velocity [rad/s]'), ('load', 'of the load'))
#: Further quantities of a joint: field of the identification and heading.
_MORE = (('scale', 'torque per torque unit'), ('rotor', 'rotor inertia [kg*m^2]'),
         ('rate', 'rate of the drive [N*m/s]'))
Rows = list[list[str]]


def _perturbed(run: MeasuredPerturbation, ka: Sequence[float | None]
               ) -> list[list[str]]:
    """Return headings and columns of P in a run, beside ka."""
    whole, rest = run.misfit()
    return [['largest |P| [N*m]', 'ka [N*m]', 'RMS P [N*m]', 'unexplained [N*m]'],
            [f'{x:.4g}' for x in run.peak],
            [NO_NUMBER if x is None else f'{x:.4g}' for x in ka],
            [f'{x:.3g}' for x in whole], [f'{x:.2g}' for x in rest]]


def cell(number: Estimate) -> str:
    """Return a number with its interval or bound, `none` where it would show, else `NO_NUMBER`."""
    if number.value is None and number.reason.startswith((_AT_LEAST, NONE_ABOVE)):
        return ' '.join(number.reason.split()[:3])
    if number.value is None:
        return 'none' if number.reason == NONE else NO_NUMBER
    return str(dataclasses.replace(number, unit=''))


_LEAD = ('Intervals are those of 95 %. P is the torque that the model lacks: friction and its own '
         'errors; ka holds it. σ is the deviation of the velocity.')
#: Reasons of a joint on a terminal, at most.
_REASONS = 3


@dataclasses.dataclass(frozen=True)
class IdentificationResults:
    """
    All results of a command.

    Attributes
    ----------
    source : str
        Names of the bags.
    found, run, recommended
        What was identified, P, and what follows.
    validation : Validation or None
        On another bag.

    """

    source: str
    found: Identification
    run: MeasuredPerturbation
    recommended: Recommendation
    validation: Validation | None

    @cached_property
    def verdicts(self) -> list[Verdict]:
        """Return what the numbers of each joint are good for."""
        more = self.validation.findings(self.recommended.ka) if self.validation else ()
        return verdicts(self.found, (*self.recommended.findings, *more))

    def tables(self) -> Iterator[tuple[str, Rows]]:
        """Yield headings and tables, the first row of each having the names of the columns."""
        found, joints = self.found, self.found.joints

        def rows(heads: Sequence[str], *columns: Sequence[str]) -> Rows:
            return [['joint', *heads], *(
                [joint, *(cells if verdict.usable else [NO_NUMBER] * len(cells))]
                for joint, verdict, *cells in zip(joints, self.verdicts, *columns))]
        yield 'Friction', rows([name for _, name in FRICTION], *(
            [cell(getattr(x, key)) for x in found.friction] for key, _ in FRICTION))
        # What sensors show needs no friction: of all joints.
        yield 'Sensors', [
            ['joint', 'encoder step [rad]', 'velocity noise [rad/s]'],
            *([joint, *map(cell, numbers)] for joint, *numbers in zip(
                joints, found.encoder, found.noise))]
        more = [(name, getattr(found, key)) for key, name in _MORE if getattr(found, key)]
        yield 'Motors and drives', rows(
            ['lag, or delay of this joint', *(name for name, _ in more)],
            [lag_in_words(found.timing, i) for i in range(len(joints))],
            *([cell(x) for x in values] for _, values in more))
        yield 'Perturbation', rows(*_perturbed(self.run, self.recommended.ka))
        if self.validation:
            yield f'Validation on {self.validation.name}', rows(
                *_perturbed(self.validation.run, self.recommended.ka))

    def verdict_lines(self) -> Iterator[str]:
        """Yield lines of the verdicts, and before them the reasons that all joints share."""
        for severity in (Severity.REFUSED, Severity.CARE):
            for reason in of_all_joints(self.verdicts, severity):
                yield from paragraph(f'all joints: {WORDS[severity]}: {reason}')
        for verdict in self.verdicts:
            first, *others = verdict.own() or (None,)
            yield from paragraph(f'{verdict.joint}: {verdict.word}'
                                 + (f': {first.text}' if first else ''))
            for other in others[:_REASONS - 1]:
                yield from paragraph(f'- {other.text}', 4)
            if len(others) >= _REASONS:
                more = '; '.join(x.reason.split(':')[0] for x in others[_REASONS - 1:])
                yield from paragraph(f'- on the page: {more}', 4)

    def sentences(self) -> Iterator[tuple[str, list[str]]]:
        """Yield headings and sentences."""
        notes = [*of_all_joints(self.verdicts, Severity.NOTE), *(
            f'{x.joint}: {note.reason}' for x in self.verdicts for note in x.findings
            if note.severity == Severity.NOTE and note.joint != ALL_JOINTS)]
        if notes:
            yield 'Notes', notes
        yield 'Time', list(self._time())
        yield 'Model', list(self._model())
        yield 'Gains', [f'{name} = {shown(self._usable(value))}: {why}'
                        for name, (value, why) in self.recommended.values.items()]
        yield 'Trial runs', list(self.recommended.trials) or ['not tried']

    def _usable(self, value: object) -> object:
        """Return a parameter with None for the joints that are not usable."""
        if not isinstance(value, list) or len(value) != len(self.verdicts):
            return value
        return [x if verdict.usable else None for x, verdict in zip(value, self.verdicts)]

    def _time(self) -> Iterator[str]:
        """Yield what the stamps say, and the delay."""
        clock, timing = self.found.clock, self.found.timing
        yield (f'sample period {clock.period:.6g} s, jitter {clock.jitter:.2g} s, longest step '
               f'{clock.longest:.4g} s, {clock.missing} samples missing; '
               f'{self.found.duration:.4g} s used')
        for begin, length in clock.pauses:
            yield f'a pause of {length:.3g} s at {begin:.4g} s is left out'
        known = ' or '.join(map(str, timing.delays)) if isfinite(timing.drive[0]) else ''
        yield (f'delay of the torque: {known} samples' if known else
               'delay not identifiable: no commanded torque in the bag')
        yield f'torques are taken from the {timing.source}'

    def _model(self) -> Iterator[str]:
        """Yield errors of the model."""
        for error, number in self.found.errors:
            if number.value is None:
                yield f'mass of {error.name}: {number}'
            elif error.unit:
                yield (f'{error.name}: {number.value:+.4g} ± {number.half:.1g} kg at the tip '
                       'against the model')
            else:
                yield (f'mass and inertia of {error.name}: {number.value:+.2%} ± '
                       f'{number.half:.2%} against the model')
        if any(x.half for x in self.found.tilt):
            yield 'gravity in the frame of the base: ' + ', '.join(map(str, self.found.tilt))

    def text(self) -> str:
        """Return it for a terminal, in lines of at most `WIDTH` characters."""
        lines = ['Verdict', *paragraph(next_step(self.verdicts)), *self.verdict_lines(), '']
        for title, rows in self.tables():
            lines += [*paragraph(title, 0), *fitted(rows), '']
        for title, texts in self.sentences():
            lines += [*paragraph(title, 0),
                      *(line for text in texts for line in paragraph(text)), '']
        return '\n'.join(lines).rstrip()

    def as_mapping(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        found, recommended = self.found, self.recommended
        return {
            'bags': self.source, 'joint_names': list(found.joints),
            'clock': dataclasses.asdict(found.clock), **self._drives(),
            'verdicts': [x.as_mapping() for x in self.verdicts],
            'friction': [_of_joint(vars(friction), verdict)
                         for friction, verdict in zip(found.friction, self.verdicts)],
            **{key: [x.as_mapping() for x in getattr(found, name)] for key, name in (
                ('encoder_step_rad', 'encoder'), ('velocity_noise_rad_per_s', 'noise'))},
            **{key: [_of_joint({'x': x}, verdict)['x'] for x, verdict in zip(
                getattr(found, name), self.verdicts)] for key, name in (
                ('torque_scale', 'scale'), ('rotor_inertia_kgm2', 'rotor'),
                ('torque_rate_nm_per_s', 'rate'))},
            'gravity_mps2': [x.as_mapping() for x in found.tilt],
            'model_errors': [{'name': error.name, 'unit': error.unit, **number.as_mapping()}
                             for error, number in found.errors],
            'peak_perturbation_nm': self._usable(self.run.peak.tolist()),
            'noise_torque_nm': self._usable(recommended.noise_torque.tolist()),
            'recommended': {name: {'value': self._usable(value), 'reason': why}
                            for name, (value, why) in recommended.values.items()},
            'trial_runs': list(self.recommended.trials),
            'validation': self.validation and self.validation.name}

    def _drives(self) -> dict[str, Any]:
        """Return delay and lags as JSON has them."""
        timing = self.found.timing
        delay, lag, error = timing.drive
        known = isfinite(delay) and len(timing.delays) == 1
        return {
            'torque_from': timing.source, 'effort_side': self.found.side,
            'delay_samples': int(delay) if known else None,
            'delays_possible': [
                {'delay_samples': delay, 'actuator_lag_s': self._usable(lags[1].tolist()),
                 'actuator_lag_interval_95_s': self._usable(lags[[0, 2]].T.tolist())}
                for delay, lags in timing.delays.items()],
            'actuator_lag_s': self._usable(lag.tolist()),
            'actuator_lag_error_s': self._usable(error.tolist())}


def write_page(report: IdentificationResults, figures: Sequence[FigureFile], path: Path,
               files: Mapping[str, str], command: str = '') -> None:
    """
    Write the page.

    Parameters
    ----------
    report : IdentificationResults
        All results.
    figures : sequence of FigureFile
        Linked relative to the page.
    path : Path
        The page.
    files : mapping of str to str
        Names of files beside the page, and what they are.
    command : str
        What was run.

    """
    numbers = [Table(title, head, rows, 1) for title, (head, *rows) in report.tables()]
    shared = [page.Note(f'All joints are {WORDS[x]}: {reason}')
              for x in (Severity.REFUSED, Severity.CARE)
              for reason in of_all_joints(report.verdicts, x)]
    sections = [
        page.Section('Verdicts', [*shared, page.Cards([page.Card(
            verdict.joint, verdict.word, (), [fragment(
                '{{ x.reason }}{% if x.cure %}<br><i>{{ x.cure }}</i>{% endif %}', x=x)
                for x in verdict.own()], int(verdict.severity)) for verdict in report.verdicts])]),
        page.Section('Numbers', [
            *numbers, *figures, *(page.Listing(*x) for x in report.sentences())])]
    page.write_page(path, f'Friction and gains from {report.source}',
                    f'{next_step(report.verdicts)} {_LEAD}', sections,
                    [(name, f'{name} ({what})') for name, what in files.items()], command)


def _of_joint(numbers: Mapping[str, Estimate], verdict: Verdict) -> dict[str, Any]:
    """Return numbers as JSON has them; under `refused` those of a joint that is not usable."""
    values = {name: x.as_mapping() for name, x in numbers.items()}
    if verdict.usable:
        return values
    return {**{name: {'value': None, 'reason': verdict.word} for name in values},
            'refused': values}

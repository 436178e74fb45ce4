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

"""What was identified as text, JSON and page."""

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
from ctc_chattering.analysis.number_format import shown
from ctc_chattering.analysis.tables import fitted, paragraph, Table
from ctc_chattering.identification.regression.base_parameters import base_parameters, BaseParameter
from ctc_chattering.identification.regression.estimate import Estimate
from ctc_chattering.identification.regression.finding import ALL_JOINTS, Severity
from ctc_chattering.identification.regression.identify import Identification
from ctc_chattering.identification.regression.model_errors import ModelError
from ctc_chattering.identification.report.perturbation import MeasuredPerturbation
from ctc_chattering.identification.report.recommendation import Recommendation
from ctc_chattering.identification.report.result_tables import cell, missing, tables
from ctc_chattering.identification.report.validation import Validation
from ctc_chattering.identification.report.verdict import of_all_joints, Verdict, verdicts, WORDS
import numpy as np

_LEAD = ('Friction, delays and errors of the model from a recorded run, with intervals of 95 %, '
         'and the gains that follow.')
#: Reasons of a joint on a terminal, at most.
_REASONS = 3
#: Offset that is named, as a part of the Coulomb friction.
_OFFSET = 0.02


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
    rate : tuple of float
        Allowed rate of the torque of each joint [N·m/s]; empty where it is not known.

    """

    source: str
    found: Identification
    run: MeasuredPerturbation
    recommended: Recommendation
    validation: Validation | None
    rate: tuple[float, ...] = ()

    @cached_property
    def base(self) -> list[BaseParameter]:
        """Return the base parameters; none without a URDF."""
        found = self.found
        return [] if found.bodies is None or found.columns is None else base_parameters(
            found.bodies, found.columns.model, found.joints)

    @cached_property
    def verdicts(self) -> list[Verdict]:
        """Return what the numbers of each joint are good for."""
        more = self.validation.findings(self.recommended.ka) if self.validation else ()
        return verdicts(self.found, (*self.recommended.findings, *more))

    def tables(self) -> Iterator[tuple[str, list[list[str]]]]:
        """Yield headings and tables, the first row of each having the names of the columns."""
        return tables(self.found, self.verdicts, self.run, self.recommended, self.rate)

    def base_table(self) -> Table | None:
        """Return the table of the base parameters, which are many; None without a URDF."""
        return Table('Inertial parameters that have a torque', [
            'body', 'combination', 'of the model', 'identified'], [
                [x.body, str(x), f'{x.known:.4g}', _together(cell(x.found))]
                for x in self.base], 2) if self.base else None

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
                yield f'    - {len(others) - _REASONS + 1} more on the page'

    def sentences(self) -> Iterator[tuple[str, list[str]]]:
        """Yield headings and sentences."""
        notes = [*of_all_joints(self.verdicts, Severity.NOTE), *(
            f'{x.joint}: {note.reason}' for x in self.verdicts for note in x.findings
            if note.severity == Severity.NOTE and note.joint != ALL_JOINTS),
            *missing(self.found, self.verdicts)]
        if notes:
            yield 'Notes', notes
        yield 'Time', list(self._time())
        yield 'Model', list(self._model())
        yield 'Chattering term', [text for text, x in zip(
            self.recommended.verdicts, self.verdicts) if x.usable]
        yield 'Gains', [f'{name} = {shown(self._usable(value))}: {why}'
                        for name, (value, why) in self.recommended.values.items()]
        yield 'Trial runs', list(self.recommended.trials) or ['not tried']
        if self.validation:
            yield f'Validation on {self.validation.name}', [
                ('holds: ' if good else 'FAILS: ') + text
                for (good, text), x in zip(self._validated(), self.verdicts)
                if x.usable or not good]

    def _usable(self, value: object) -> object:
        """Return a parameter with None for the joints that are not usable."""
        if not isinstance(value, list) or len(value) != len(self.verdicts):
            return value
        return [x if verdict.usable else None for x, verdict in zip(value, self.verdicts)]

    def _validated(self) -> list[tuple[bool, str]]:
        """Return whether each joint is predicted on the other run, and why."""
        assert self.validation is not None
        return self.validation.verdicts(self.found.joints, [
            np.nan if x is None else x for x in self.recommended.ka])

    def _time(self) -> Iterator[str]:
        """Yield what the stamps say, and the delay."""
        clock, timing = self.found.clock, self.found.timing
        yield (f'sample period {clock.period:.6g} s, jitter {clock.jitter:.2g} s, longest step '
               f'{clock.longest:.4g} s, {clock.missing} samples missing; '
               f'{self.found.duration:.4g} s used')
        for begin, length in clock.pauses:
            yield f'a pause of {length:.3g} s at {begin:.4g} s is left out'
        delay = timing.drive[0]
        if not isfinite(delay):
            yield 'delay not identifiable: no commanded torque in the bag'
        elif len(timing.delays) > 1:
            yield f'delay of the torque: one of {", ".join(map(str, timing.delays))} samples'
        else:
            yield f'delay of the torque: {int(delay)} samples'
        side = self.found.side
        yield f'torques are taken from the {timing.source}' + (
            f'; the effort is that of the {side}' if side in ('motor', 'link') else
            '; the effort is a current' if side else '')

    def _model(self) -> Iterator[str]:
        """Yield errors of the model, offsets and what is left."""
        found = self.found
        yield from (error_sentence(*pair) for pair in found.errors)
        if any(x.half for x in found.tilt):
            yield 'gravity in the frame of the base: ' + ', '.join(map(str, found.tilt))
        for joint, friction, verdict in zip(found.joints, found.friction, self.verdicts):
            offset = friction.offset
            if verdict.usable and offset.value is not None and abs(offset.value) > max(
                    offset.half, _OFFSET * abs(friction.coulomb.value or 0.0)):
                yield (f'{joint}: friction differs by direction, or a constant torque of {offset} '
                       'is missing in the model; no motion distinguishes these')
        yield from found.left
        if found.selected.attributed and not any(x.value is not None for _, x in found.errors):
            yield 'no mass error is visible'

    def text(self) -> str:
        """Return it for a terminal, in lines of at most `WIDTH` characters."""
        lines = ['Verdict', *self.verdict_lines(), '']
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
                ('encoder_step_rad', 'encoder'), ('velocity_noise_rad_per_s', 'noise'),
                ('velocity_lag_s', 'velocity_lag'))},
            **{key: [_of_joint({'x': x}, verdict)['x'] for x, verdict in zip(
                getattr(found, name), self.verdicts)] for key, name in (
                ('torque_scale', 'scale'), ('rotor_inertia_kgm2', 'rotor'),
                ('torque_rate_nm_per_s', 'rate'))},
            'gravity_mps2': [x.as_mapping() for x in found.tilt],
            'base_parameters': [x.as_mapping() for x in self.base],
            'model_errors': [{'name': error.name, 'unit': error.unit, **number.as_mapping()}
                             for error, number in found.errors],
            'left': found.left,
            'peak_perturbation_nm': self._usable(self.run.peak.tolist()),
            'noise_torque_nm': self._usable(recommended.noise_torque.tolist()),
            'chattering_term_possible': recommended.allowed,
            'torque_steps_nm': {k: self._usable(v.tolist())
                                for k, v in recommended.steps.items()},
            'recommended': {name: {'value': self._usable(value), 'reason': why}
                            for name, (value, why) in recommended.values.items()},
            'trial_runs': list(self.recommended.trials),
            'validation': self.validation and [
                {'holds': good, 'reason': text} for good, text in self._validated()]}

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


def error_sentence(candidate: ModelError, number: Estimate) -> str:
    """Return what an error of the model is, in words."""
    if number.value is None:
        return f'mass of {candidate.name}: {number}'
    if candidate.unit:
        more = 'more' if number.value > 0.0 else 'less'
        return (f'{candidate.name}: {abs(number.value):.4g} ± {number.half:.1g} kg {more} at the '
                'tip than the model has')
    small = 'small' if number.value > 0.0 else 'large'
    off = number.value / (1.0 + number.value)
    return (f'the mass and inertia of {candidate.name} look {abs(off):.1%} too {small} in the '
            f'model: the robot has {number.value:+.2%} ± {number.half:.2%}')


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
    numbers = [Table(title, head, [[_together(x) for x in row] for row in rows], 1)
               for title, (head, *rows) in report.tables()]
    base = report.base_table()
    page.write_page(path, f'Friction and gains from {report.source}', _LEAD, [
        page.Section('Verdicts', [*(
            page.Note(f'All joints are {WORDS[x]}: {reason}')
            for x in (Severity.REFUSED, Severity.CARE)
            for reason in of_all_joints(report.verdicts, x)),
            page.Cards(list(map(_card, report.verdicts)))]),
        page.Section('Numbers', [
            *numbers, *(page.Listing(*x) for x in report.sentences()), *([page.Folded(
                f'{base.title}: {len(base.rows)}', [base._replace(title='')])] if base else [])]),
        page.Section('Figures', figures)],
        [(name, f'{name} ({what})') for name, what in files.items()], command)


def _card(verdict: Verdict) -> page.Card:
    return page.Card(verdict.joint, verdict.word, (), [
        fragment('{{ x.reason }}{% if x.cure %}<br><i>{{ x.cure }}</i>{% endif %}', x=x)
        for x in verdict.own()], int(verdict.severity))


def _together(text: str) -> str:
    """Return text that is not broken at its interval."""
    return text.replace(' ± ', '\xa0±\xa0')


def _of_joint(numbers: Mapping[str, Estimate], verdict: Verdict) -> dict[str, Any]:
    """Return numbers as JSON has them; under `refused` those of a joint that is not usable."""
    values = {name: x.as_mapping() for name, x in numbers.items()}
    if verdict.usable:
        return values
    return {**{name: {'value': None, 'reason': verdict.word} for name in values},
            'refused': values}

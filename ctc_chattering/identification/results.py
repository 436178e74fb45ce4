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

"""All results of an identification, as text, JSON and page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import dataclasses
from functools import cached_property
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

from ctc_chattering.analysis import page
from ctc_chattering.analysis.markup import fragment
from ctc_chattering.analysis.page import FigureFile
from ctc_chattering.analysis.tables import fitted, paragraph, shown, Table
from ctc_chattering.identification.findings import ALL_JOINTS, Estimate, Severity
from ctc_chattering.identification.friction import NUMBERS
from ctc_chattering.identification.gains import Recommendation
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.perturbation import MeasuredPerturbation
from ctc_chattering.identification.timing import describe_lag
from ctc_chattering.identification.verdict import (
    next_step,
    of_all_joints,
    Verdict,
    verdicts,
    WORDS,
)

#: Cell of a number that there is none of; why is in the verdict, or in the JSON file.
NO_NUMBER = '-'
#: Friction in the order of the table: field and heading.
FRICTION = {'coulomb': 'Coulomb [N*m]', 'forwards': 'forwards', 'backwards': 'backwards',
            'viscous': 'viscous [N*m*s/rad]', 'stribeck': 'Stribeck [N*m]',
            'stribeck_velocity': 'its velocity [rad/s]', 'load': 'of the load',
            'dead_band': 'dead band [N*m]'}
LEAD = ('Unseen torque is that of blocks of time that were not fitted. Intervals are those of '
        '95 %. P is the torque that the model lacks: friction and its own errors; ka holds it.')


class Numbers(NamedTuple):
    """Numbers of all joints, with their key of the JSON file and their heading."""

    key: str
    heading: str
    estimates: list[Estimate]


@dataclasses.dataclass(frozen=True)
class IdentificationResults:
    """
    All results of a command.

    Attributes
    ----------
    source : str
        Names of the bags.
    found : Identification
        As of `identify`.
    run : MeasuredPerturbation
        P.
    recommended : Recommendation
        Gains.

    """

    source: str
    found: Identification
    run: MeasuredPerturbation
    recommended: Recommendation

    @cached_property
    def verdicts(self) -> list[Verdict]:
        """Verdict on each joint."""
        return verdicts(self.found, self.recommended.findings)

    @property
    def sensors(self) -> list[Numbers]:
        """Numbers of the sensors."""
        return [Numbers('encoder_step_rad', 'encoder step [rad]', self.found.encoder),
                Numbers('velocity_noise_rad_per_s', 'velocity noise [rad/s]', self.found.noise)]

    @property
    def drives(self) -> list[Numbers]:
        """Numbers of motors and drives."""
        found = self.found
        numbers = [Numbers('torque_rate_nm_per_s', 'rate of the drive [N*m/s]', found.rate)]
        if found.bodies is not None:
            numbers.insert(0, Numbers(
                'rotor_inertia_kgm2', 'rotor inertia [kg*m^2]', found.bodies.rotors))
        if found.constant:
            numbers.insert(0, Numbers(
                'torque_constant', 'torque per unit of the signal', found.constant))
        return numbers

    def tables(self) -> Iterator[Table]:
        """Yield the tables of terminal and page that have numbers."""
        return (table for table in self._all_tables() if len(table.heads) > 1)

    def _all_tables(self) -> Iterator[Table]:
        """Yield all tables, also without any number."""
        found, prediction = self.found, self.found.prediction
        columns = {
            'recording': prediction.recording_rms, 'model': prediction.model_rms,
            'model, friction': prediction.with_friction_rms,
            'identified': prediction.identified_rms}
        yield self._table('RMS of unseen torque [N*m]: in the recording, and what is left of it', {
            heading: [f'{x:.3g}' for x in values] for heading, values in columns.items()}, True)
        yield self._table('Friction', {
            heading: [getattr(x, key).cell for x in found.friction]
            for key, heading in FRICTION.items()})
        yield self._table('Sensors', {
            x.heading: [estimate.cell for estimate in x.estimates] for x in self.sensors}, True)
        yield self._table('Motors and drives', {
            'lag, or delay of this joint': [
                describe_lag(found.timing, joint) for joint in range(len(found.joints))],
            **{x.heading: [estimate.cell for estimate in x.estimates] for x in self.drives}})
        yield self._table('Perturbation', {
            'largest |P| [N*m]': [f'{x:.4g}' for x in self.run.peak],
            'ka [N*m]': [NO_NUMBER if x is None else f'{x:.4g}' for x in self.recommended.ka]})

    def _table(self, title: str, columns: Mapping[str, Sequence[str]], every: bool = False
               ) -> Table:
        """
        Return a row a joint, without columns in which no joint has a number.

        Numbers of a joint that is not usable are there only if `every` is true.
        """
        columns = {heading: cells for heading, cells in columns.items()
                   if any(cell != NO_NUMBER for cell in cells)}
        return Table(title, ('joint', *columns), [
            [verdict.joint, *(cells if every or verdict.usable else [NO_NUMBER] * len(cells))]
            for verdict, *cells in zip(self.verdicts, *columns.values())])

    def shared(self) -> list[str]:
        """Return the doubts about the numbers of all joints together."""
        return [f'{WORDS[severity]}: {reason}' for severity in (Severity.REFUSED, Severity.CARE)
                for reason in of_all_joints(self.verdicts, severity)]

    def verdict_lines(self) -> Iterator[str]:
        """Yield lines of the verdicts, and before them the reasons that all joints share."""
        for text in self.shared():
            yield from paragraph(f'all joints: {text}')
        for verdict in self.verdicts:
            reasons = [x.sentences for x in verdict.of_joint()]
            yield from paragraph(': '.join((verdict.joint, verdict.word, *reasons[:1])))
            for reason in reasons[1:]:
                yield from paragraph(f'- {reason}', 4)

    def sentences(self) -> Iterator[tuple[str, list[str]]]:
        """Yield headings and sentences."""
        found, timing = self.found, self.found.timing
        yield 'Notes', [*of_all_joints(self.verdicts, Severity.NOTE), *(
            f'{x.joint}: {note.text}' for x in self.verdicts for note in x.findings
            if note.severity == Severity.NOTE and note.joint != ALL_JOINTS)]
        known = ' or '.join(map(str, timing.delays)) if isfinite(timing.drive.delay) else ''
        yield 'Time', [
            f'sample period {found.clock.period:.6g} s, {found.clock.missing} samples missing; '
            f'{found.duration:.4g} s used',
            f'delay of the torque: {known} samples' if known else
            'the delay is not identifiable: no commanded torque in the bag',
            f'torques are taken from the {timing.source}']
        yield 'Gains', [f'{name} = {shown(self._usable(value))}: {why}'
                        for name, (value, why) in self.recommended.values.items()]
        yield 'Trial runs', list(self.recommended.trials) or ['The gains were not tried.']

    def _usable(self, value: object) -> object:
        """Return a parameter with None for the joints that are not usable."""
        if not isinstance(value, list) or len(value) != len(self.verdicts):
            return value
        return [x if verdict.usable else None for x, verdict in zip(value, self.verdicts)]

    def text(self) -> str:
        """Return it for a terminal, in lines of at most `WIDTH` characters."""
        lines = ['Verdict', *paragraph(next_step(self.verdicts)), *self.verdict_lines(), '']
        for table in self.tables():
            lines += [*paragraph(table.title, 0), *fitted([table.heads, *table.rows]), '']
        for title, texts in self.sentences():
            if texts:
                lines += [title, *(line for text in texts for line in paragraph(text)), '']
        return '\n'.join(lines).rstrip()

    def as_mapping(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        found, timing = self.found, self.found.timing

        def number(x: Estimate, verdict: Verdict) -> dict[str, Any]:
            return x.as_mapping() if verdict.usable else {'value': None, 'reason': verdict.word}
        return {
            'bags': self.source, 'joint_names': list(found.joints),
            'clock': dataclasses.asdict(found.clock),
            'torque_from': timing.source,
            'delays_possible': [
                {'delay_samples': delay, 'actuator_lag_s': self._usable(lags[1].tolist()),
                 'actuator_lag_interval_95_s': self._usable(lags[[0, 2]].T.tolist())}
                for delay, lags in timing.delays.items()],
            'verdicts': [x.as_mapping() for x in self.verdicts],
            'friction': [
                friction.as_mapping(found.joints) if verdict.usable else
                {**{name: {'value': None, 'reason': verdict.word} for name in NUMBERS},
                 'coupled': []}
                for friction, verdict in zip(found.friction, self.verdicts)],
            **{x.key: [estimate.as_mapping() for estimate in x.estimates] for x in self.sensors},
            **{x.key: list(map(number, x.estimates, self.verdicts)) for x in self.drives},
            'unseen_torque_rms_nm': {
                'recording': found.prediction.recording_rms.tolist(),
                'model': found.prediction.model_rms.tolist(),
                'model_with_friction': found.prediction.with_friction_rms.tolist(),
                'identified': found.prediction.identified_rms.tolist()},
            **({} if found.bodies is None else {
                'gravity_mps2': found.bodies.gravity.tolist(),
                'bodies': found.bodies.as_mapping(found.joints),
                'bodies_uncertainty': found.bodies.uncertainty}),
            'peak_perturbation_nm': self._usable(self.run.peak.tolist()),
            'recommended': {name: {'value': self._usable(value), 'reason': why}
                            for name, (value, why) in self.recommended.values.items()},
            'trial_runs': list(self.recommended.trials)}


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
        Names of files beside the page, and their content in words.
    command : str
        The command.

    """
    tables = list(report.tables())
    cards = page.Cards([page.Card(verdict.joint, verdict.word, (), [
        fragment('{{ x.text }}.{% if x.cure %}<br><i>{{ x.cure }}.</i>{% endif %}', x=x)
        for x in verdict.of_joint()], int(verdict.severity)) for verdict in report.verdicts])
    sections = [
        page.Section('Prediction of unseen torque', [*figures, tables[0]]),
        page.Section('Verdicts', [
            *(page.Note(f'All joints are {text}') for text in report.shared()), cards]),
        page.Section('Numbers', [
            *tables[1:], *(page.Listing(*x) for x in report.sentences() if x[1])])]
    page.write_page(path, f'Friction and gains from {report.source}',
                    f'{next_step(report.verdicts)} {LEAD}', sections,
                    [(name, f'{name} ({content})') for name, content in files.items()], command)

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
Results of an identification as text, JSON and page.

`ctc identify` prints the text and writes the others. Numbers of a joint that is not usable are
left out of them. The sentences are those of `sentences`.
"""

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
from ctc_chattering.analysis.tables import fitted, paragraph, Table
from ctc_chattering.identification.findings import ALL_JOINTS, Estimate, Severity
from ctc_chattering.identification.friction import NUMBERS
from ctc_chattering.identification.gains import Recommendation
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.perturbation import MeasuredPerturbation
from ctc_chattering.identification.sentences import (
    gain_reasons,
    MESSAGES,
    next_step,
    trial_text,
    words_of,
)
from ctc_chattering.identification.timing import describe_lag
from ctc_chattering.identification.verdict import Verdict, verdicts
from ctc_chattering.number_format import format_numbers, format_value

#: Cell of a missing number. The verdict, or the JSON file, says why it is missing.
NO_NUMBER = '-'
#: Headings of friction in the order of the table, by field.
FRICTION_HEADINGS = {
    'coulomb': 'Coulomb [N*m]',
    'forwards': 'forwards',
    'backwards': 'backwards',
    'viscous': 'viscous [N*m*s/rad]',
    'stribeck': 'Stribeck [N*m]',
    'stribeck_velocity': 'its velocity [rad/s]',
    'load': 'of the load',
    'dead_band': 'dead band [N*m]',
}


class Numbers(NamedTuple):
    """Numbers of all joints, with their JSON key and heading."""

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
        Numbers with their findings.
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
        return [
            Numbers('encoder_step_rad', 'encoder step [rad]', self.found.encoder),
            Numbers('velocity_noise_rad_per_s', 'velocity noise [rad/s]', self.found.noise),
        ]

    @property
    def drives(self) -> list[Numbers]:
        """Numbers of motors and drives."""
        rotors = self.found.bodies.rotors if self.found.bodies else []
        numbers = [
            Numbers('torque_constant', 'torque per unit of the signal', self.found.constant),
            Numbers('rotor_inertia_kgm2', 'rotor inertia [kg*m^2]', rotors),
            Numbers('torque_rate_nm_per_s', 'rate of the drive [N*m/s]', self.found.rate),
        ]
        return [x for x in numbers if x.estimates]

    def tables(self) -> list[Table]:
        """Return the tables of terminal and page that have numbers."""
        timing, prediction = self.found.timing, self.found.prediction
        columns = {
            'recording': prediction.recording_rms,
            'model': prediction.model_rms,
            'model, friction': prediction.with_friction_rms,
            'identified': prediction.identified_rms,
        }
        tables = [
            self._table(
                'RMS of unseen torque [N*m]: in the recording, and what is left of it',
                {heading: [f'{x:.3g}' for x in values] for heading, values in columns.items()},
                every=True,
            ),
            self._table(
                'Friction',
                {
                    heading: [getattr(x, key).cell for x in self.found.friction]
                    for key, heading in FRICTION_HEADINGS.items()
                },
            ),
            self._table('Sensors', _cells(self.sensors), every=True),
            self._table(
                'Motors and drives',
                {
                    'lag, or delay of this joint': [
                        describe_lag(timing, joint) for joint in range(len(self.found.joints))
                    ],
                    **_cells(self.drives),
                },
            ),
            self._table(
                'Perturbation',
                {
                    'largest |P| [N*m]': [f'{x:.4g}' for x in self.run.peak],
                    'ka [N*m]': [
                        NO_NUMBER if x is None else f'{x:.4g}'
                        for x in self.recommended.values['ka']
                    ],
                },
            ),
        ]
        return [table for table in tables if len(table.heads) > 1]

    def _table(
        self, title: str, columns: Mapping[str, Sequence[str]], every: bool = False
    ) -> Table:
        """
        Return a row a joint, without columns of no number.

        Numbers of a joint that is not usable are there only if `every` is true.
        """
        columns = {
            heading: cells
            for heading, cells in columns.items()
            if any(cell != NO_NUMBER for cell in cells)
        }
        return Table(
            title,
            ('joint', *columns),
            [
                [verdict.joint, *(cells if every or verdict.usable else [NO_NUMBER] * len(cells))]
                for verdict, *cells in zip(self.verdicts, *columns.values())
            ],
        )

    def _about_all_joints(self, severity: Severity) -> list[str]:
        """Return the findings on all joints together that have this severity."""
        texts = [
            str(words_of(finding, verdict.joint))
            for verdict in self.verdicts
            for finding in verdict.findings
            if finding.joint == ALL_JOINTS and finding.severity == severity
        ]
        return list(dict.fromkeys(texts))

    def shared(self) -> list[str]:
        """Return the doubts about the numbers of all joints together."""
        return [
            f'{severity.label}: {text}'
            for severity in (Severity.REFUSED, Severity.CARE)
            for text in self._about_all_joints(severity)
        ]

    def verdict_lines(self) -> Iterator[str]:
        """Yield lines of the verdicts, after the reasons for all joints."""
        for text in self.shared():
            yield from paragraph(f'all joints: {text}')
        for verdict in self.verdicts:
            reasons = [str(words_of(x, verdict.joint)) for x in verdict.doubts]
            yield from paragraph(': '.join((verdict.joint, verdict.word, *reasons[:1])))
            for reason in reasons[1:]:
                yield from paragraph(f'- {reason}', 4)

    def listings(self) -> Iterator[tuple[str, list[str]]]:
        """Yield headings and sentences."""
        timing, clock = self.found.timing, self.found.clock
        notes = [
            f'{verdict.joint}: {words_of(x, verdict.joint)}'
            for verdict in self.verdicts
            for x in verdict.findings
            if x.severity == Severity.NOTE and x.joint != ALL_JOINTS
        ]
        yield 'Notes', self._about_all_joints(Severity.NOTE) + notes
        delay = 'The delay is not identifiable: the bag has no commanded torque.'
        if timing.delays and isfinite(timing.drive.delay):
            delay = f'The delay of the torque is {" or ".join(map(str, timing.delays))} samples.'
        yield (
            'Time',
            [
                f'The sample period is {clock.period:.6g} s. {clock.missing} samples are '
                f'missing, and {self.found.duration:.4g} s are used.',
                delay,
                f'Torques are taken from the {timing.source}.',
            ],
        )
        yield (
            'Gains',
            [
                f'{name} = {self._parameter_text(name)}: {reason}'
                for name, reason in self._gain_reasons().items()
            ],
        )
        yield (
            'Trial runs',
            list(map(trial_text, self.recommended.trials)) or ['The gains were not tried.'],
        )

    def _gain_reasons(self) -> dict[str, str]:
        """Return the reason of each recommended parameter."""
        return gain_reasons(self.recommended, [x.usable for x in self.verdicts])

    def _parameter_text(self, name: str) -> str:
        """Return the text of a recommended parameter, with `-` for unusable joints."""
        value: Any = self._usable(self.recommended.values[name])
        if isinstance(value, list):
            return f'[{format_numbers(value, 4, ", ")}]'
        return format_value(value)

    def _usable(self, value: object) -> object:
        """Return a parameter with None for unusable joints."""
        if not isinstance(value, list) or len(value) != len(self.verdicts):
            return value
        return [x if verdict.usable else None for x, verdict in zip(value, self.verdicts)]

    def text(self) -> str:
        """Return it for a terminal of `WIDTH` columns."""
        lines = ['Verdict', *paragraph(next_step(self.verdicts)), *self.verdict_lines(), '']
        for table in self.tables():
            lines += [*paragraph(table.title, 0), *fitted([table.heads, *table.rows]), '']
        for title, texts in self.listings():
            if texts:
                lines += [title, *(line for text in texts for line in paragraph(text)), '']
        return '\n'.join(lines).rstrip()

    def as_mapping(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        numbers = self.found
        timing, prediction = numbers.timing, numbers.prediction
        return {
            'bags': self.source,
            'joint_names': list(numbers.joints),
            'clock': dataclasses.asdict(numbers.clock),
            'torque_from': timing.source,
            'delays_possible': [
                {
                    'delay_samples': delay,
                    'actuator_lag_s': self._usable(lags[1].tolist()),
                    'actuator_lag_interval_95_s': self._usable(lags[[0, 2]].T.tolist()),
                }
                for delay, lags in timing.delays.items()
            ],
            'verdicts': [_verdict_mapping(x) for x in self.verdicts],
            'friction': [
                friction.as_mapping(numbers.joints)
                if verdict.usable
                else {**dict.fromkeys(NUMBERS, _without_number(verdict)), 'coupled': []}
                for friction, verdict in zip(numbers.friction, self.verdicts)
            ],
            **{x.key: [estimate.as_mapping() for estimate in x.estimates] for x in self.sensors},
            **{
                x.key: [
                    estimate.as_mapping() if verdict.usable else _without_number(verdict)
                    for estimate, verdict in zip(x.estimates, self.verdicts)
                ]
                for x in self.drives
            },
            'unseen_torque_rms_nm': {
                'recording': prediction.recording_rms.tolist(),
                'model': prediction.model_rms.tolist(),
                'model_with_friction': prediction.with_friction_rms.tolist(),
                'identified': prediction.identified_rms.tolist(),
            },
            **(numbers.bodies.as_mapping(numbers.joints) if numbers.bodies else {}),
            'peak_perturbation_nm': self._usable(self.run.peak.tolist()),
            'recommended': {
                name: {'value': self._usable(self.recommended.values[name]), 'reason': reason}
                for name, reason in self._gain_reasons().items()
            },
            'trial_runs': list(map(trial_text, self.recommended.trials)),
        }


def _cells(columns: Sequence[Numbers]) -> dict[str, list[str]]:
    """Return the cells of columns of a table, by heading."""
    return {x.heading: [estimate.cell for estimate in x.estimates] for x in columns}


def _without_number(verdict: Verdict) -> dict[str, Any]:
    """Return an estimate of an unusable joint for JSON."""
    return {'value': None, 'reason': verdict.word}


def _verdict_mapping(verdict: Verdict) -> dict[str, Any]:
    """Return a verdict as JSON has it."""
    findings = []
    for finding in verdict.findings:
        words = words_of(finding, verdict.joint)
        findings.append(
            {
                'severity': finding.severity.label,
                'about': MESSAGES[finding.reason].about,
                'reason': words.text,
                'cure': words.cure,
            }
        )
    return {'joint': verdict.joint, 'verdict': verdict.word, 'findings': findings}


def write_page(
    report: IdentificationResults,
    figures: Sequence[FigureFile],
    path: Path,
    files: Mapping[str, str],
    command: str = '',
) -> None:
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
    torque, *numbers = report.tables()
    cards = page.Cards(
        [
            page.Card(
                verdict.joint,
                verdict.word,
                (),
                [
                    fragment(
                        '{{ x.text }}{% if x.cure %}<br><i>{{ x.cure }}</i>{% endif %}',
                        x=words_of(finding, verdict.joint),
                    )
                    for finding in verdict.doubts
                ],
                int(verdict.severity),
            )
            for verdict in report.verdicts
        ]
    )
    sections = [
        page.Section('Prediction of unseen torque', [*figures, torque]),
        page.Section(
            'Verdicts', [*(page.Note(f'All joints are {text}') for text in report.shared()), cards]
        ),
        page.Section(
            'Numbers', [*numbers, *(page.Listing(*x) for x in report.listings() if x[1])]
        ),
    ]
    lead = (
        f'{next_step(report.verdicts)} Unseen torque is that of blocks of time that were not '
        'fitted. Intervals are those of 95 %. P is the torque that the model lacks: friction '
        'and its own errors. ka is large enough for it.'
    )
    page.write_page(
        path,
        f'Friction and gains from {report.source}',
        lead,
        sections,
        [(name, f'{name} ({content})') for name, content in files.items()],
        command,
    )

"""What was identified as text, JSON and page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import dataclasses
from math import isfinite
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.drawing import FigureFile
from ctc_chattering.analysis.number_format import shown
from ctc_chattering.analysis.report import write_sections
from ctc_chattering.analysis.tables import columns, Table
from ctc_chattering.identification.regression.estimate import Estimate
from ctc_chattering.identification.regression.identify import Identification
from ctc_chattering.identification.regression.model_errors import ModelError
from ctc_chattering.identification.regression.timing_findings import (
    drives_in_words,
    lag_in_words,
)
from ctc_chattering.identification.report.perturbation import MeasuredPerturbation
from ctc_chattering.identification.report.recommendation import Recommendation
from ctc_chattering.identification.report.validation import Validation
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Friction in the order of the table: field and heading.
_FRICTION = (('coulomb', 'Coulomb'), ('forwards', 'forwards'), ('backwards', 'backwards'),
             ('viscous', 'viscous'), ('stribeck', 'Stribeck'),
             ('stribeck_velocity', 'Stribeck velocity'), ('load', 'of the load'))
_LEAD = ('Friction, delays and errors of the model from a recorded run, with intervals of 95 %, '
         'and the gains that follow.')
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

    def tables(self) -> Iterator[tuple[str, list[list[str]]]]:
        """Yield headings and tables, the first row of each having the names of the columns."""
        found, joints = self.found, self.found.joints
        yield 'Friction', [
            ['joint', *(name for _, name in _FRICTION)],
            *([joint, *(str(getattr(friction, key)) for key, _ in _FRICTION)]
              for joint, friction in zip(joints, found.friction))]
        yield 'Sensors and drives', [
            ['joint', 'encoder step', 'velocity noise', 'lag of the velocity', 'lag of the drive',
             'rate of the drive'],
            *([joint, str(a), str(b), str(c), lag_in_words(found.timing, i), str(found.rate[i])]
              for i, (joint, a, b, c) in enumerate(zip(
                  joints, found.encoder, found.noise, found.velocity_lag)))]
        whole, rest = self.run.misfit()
        yield 'Perturbation', [
            ['joint', 'largest |P| [N*m]', 'ka [N*m]', 'RMS P [N*m]', 'unexplained [N*m]'],
            *([joint, f'{p:.4g}', f'{k:.4g}', f'{a:.3g}', f'{b:.2g}'] for joint, p, k, a, b in zip(
                joints, self.run.peak, _ka(self.recommended), whole, rest))]
        yield 'Largest torque step per period, at most [N*m]', [
            ['joint', *self.recommended.steps, *(['allowed'] if self.rate else [])],
            *([joint, *(self._step(values, i) for values in self.recommended.steps.values()),
               *([f'{self.rate[i] * found.clock.period:.3g}'] if self.rate else [])]
              for i, joint in enumerate(joints))]

    def _step(self, values: Array, i: int) -> str:
        """Return a step of the torque, marked where the drives do not allow it."""
        beyond = self.rate and values[i] > self.rate[i] * self.found.clock.period
        return f'{values[i]:.3g}' + (' (too fast)' if beyond else '')

    def sentences(self) -> Iterator[tuple[str, list[str]]]:
        """Yield headings and sentences."""
        yield 'Time', list(self._time())
        yield 'Model', list(self._model())
        yield 'Chattering term', list(self.recommended.verdicts)
        yield 'Gains', [f'{name} = {shown(value)}: {why}'
                        for name, (value, why) in self.recommended.values.items()]
        yield 'Trial runs', list(self.recommended.trials) or ['not tried']
        if self.validation:
            yield f'Validation on {self.validation.name}', [
                ('holds: ' if good else 'FAILS: ') + text
                for good, text in self.validation.verdicts(
                    self.found.joints, _ka(self.recommended))]

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
            yield ('delay and lag are not told apart; the motion fits to '
                   + drives_in_words(timing, self.found.joints))
        else:
            yield f'delay of the torque: {int(delay)} samples'
        yield f'torques are taken from the {timing.source}'

    def _model(self) -> Iterator[str]:
        """Yield errors of the model, offsets and what is left."""
        yield from (error_sentence(*pair) for pair in self.found.errors)
        for joint, friction in zip(self.found.joints, self.found.friction):
            offset = friction.offset
            if offset.value is not None and abs(offset.value) > max(
                    offset.half, _OFFSET * abs(friction.coulomb.value or 0.0)):
                yield (f'{joint}: friction differs by direction, or a constant torque of {offset} '
                       'is missing in the model; no motion distinguishes these')
        yield from self.found.left
        whole, rest = self.run.misfit()
        for joint, a, b in zip(self.found.joints, whole, rest):
            if b > 0.05 * a:
                yield (f'{joint}: {b:.3g} N*m RMS, {b / a:.0%} of P, is not explained by friction '
                       'and masses: the intervals above do not contain that')
        if not any(number.value is not None for _, number in self.found.errors):
            yield 'no error of a mass shows'

    def text(self) -> str:
        """Return it for a terminal."""
        lines = []
        for title, rows in self.tables():
            lines += [title, *(f'  {line}' for line in columns(rows)), '']
        for title, texts in self.sentences():
            lines += [title, *(f'  {line}' for line in columns([[x] for x in texts])), '']
        return '\n'.join(lines).rstrip()

    def as_mapping(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        found, recommended = self.found, self.recommended
        timing = found.timing
        delay, lag, error = timing.drive
        return {
            'bags': self.source, 'joint_names': list(found.joints),
            'clock': dataclasses.asdict(found.clock),
            'torque_from': timing.source,
            'delay_samples': int(delay) if isfinite(delay) and len(timing.delays) == 1
            else None,
            'delays_possible': [{'delay_samples': delay, 'actuator_lag_s': lags[1].tolist(),
                                 'actuator_lag_interval_95_s': lags[[0, 2]].T.tolist()}
                                for delay, lags in timing.delays.items()],
            'torque_rate_limit_nm_per_s': [x.as_mapping() for x in found.rate],
            'actuator_lag_s': lag.tolist(), 'actuator_lag_error_s': error.tolist(),
            'friction': [{name: x.as_mapping() for name, x in vars(friction).items()}
                         for friction in found.friction],
            **{key: [x.as_mapping() for x in getattr(found, name)] for key, name in (
                ('encoder_step_rad', 'encoder'), ('velocity_noise_rad_per_s', 'noise'),
                ('velocity_lag_s', 'velocity_lag'))},
            'model_errors': [{'name': error.name, 'unit': error.unit, **number.as_mapping()}
                             for error, number in found.errors],
            'left': found.left, 'peak_perturbation_nm': self.run.peak.tolist(),
            'noise_torque_nm': recommended.noise_torque.tolist(),
            'chattering_term_possible': recommended.allowed,
            'torque_steps_nm': {k: v.tolist() for k, v in recommended.steps.items()},
            'recommended': {name: {'value': value, 'reason': why}
                            for name, (value, why) in recommended.values.items()},
            'trial_runs': list(self.recommended.trials),
            'validation': self.validation and [
                {'holds': good, 'reason': text} for good, text in self.validation.verdicts(
                    found.joints, _ka(recommended))]}


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
               files: Mapping[str, str]) -> None:
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

    """
    write_sections(path, f'Friction and gains from {report.source}', figures,
                   [(name, f'{name} ({what})') for name, what in files.items()], _LEAD,
                   tables=[Table(title, head, rows, len(head))
                           for title, (head, *rows) in report.tables()],
                   lists=report.sentences())


def _ka(recommended: Recommendation) -> list[float]:
    """Return ka of each joint [N·m]."""
    return [float(x) for x in np.asarray(recommended.values['ka'][0], float)]

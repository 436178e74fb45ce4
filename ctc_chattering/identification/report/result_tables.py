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

"""Tables of what was identified; a joint that is not usable has no numbers in them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ctc_chattering.analysis.number_format import with_interval
from ctc_chattering.identification.regression.estimate import Estimate, NONE, NONE_ABOVE
from ctc_chattering.identification.regression.identify import Identification
from ctc_chattering.identification.regression.timing_findings import lag_in_words
from ctc_chattering.identification.report.perturbation import MeasuredPerturbation
from ctc_chattering.identification.report.recommendation import Recommendation
from ctc_chattering.identification.report.verdict import Verdict

#: In place of a number that there is none of; why stands in the verdict or below the table.
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


def tables(found: Identification, verdicts: Sequence[Verdict], run: MeasuredPerturbation,
           recommended: Recommendation, rate: Sequence[float]) -> Iterator[tuple[str, Rows]]:
    """
    Yield headings and tables, the first row of each having the names of the columns.

    Parameters
    ----------
    found, run, recommended
        What was identified, P, and what follows.
    verdicts : sequence of Verdict, length n
        Of the joints.
    rate : sequence of float, shape (n,)
        Allowed rate of the torque of each joint [N·m/s]; empty where it is not known.

    """
    joints, usable = found.joints, [x.usable for x in verdicts]

    def rows(heads: Sequence[str], *columns: Sequence[str]) -> Rows:
        return [['joint', *heads], *(
            [joint, *(cells if good else [NO_NUMBER] * len(cells))]
            for joint, good, *cells in zip(joints, usable, *columns))]
    yield 'Friction', rows([name for _, name in FRICTION], *(
        [cell(getattr(x, key)) for x in found.friction] for key, _ in FRICTION))
    yield 'Sensors', _sensors(found)
    more = [(name, getattr(found, key)) for key, name in _MORE if getattr(found, key)]
    yield 'Motors and drives', rows(
        ['lag, or delay of this joint', *(name for name, _ in more)],
        [lag_in_words(found.timing, i) for i in range(len(joints))],
        *([cell(x) for x in values] for _, values in more))
    whole, rest = run.misfit()
    yield 'Perturbation', rows(
        ['largest |P| [N*m]', 'ka [N*m]', 'RMS P [N*m]', 'unexplained [N*m]'],
        [f'{x:.4g}' for x in run.peak],
        [NO_NUMBER if x is None else f'{x:.4g}' for x in recommended.ka],
        [f'{x:.3g}' for x in whole], [f'{x:.2g}' for x in rest])
    allowed = [x * found.clock.period for x in rate]
    steps = [[f'{x:.3g}' + (' (too fast)' if allowed and x > allowed[i] else '')
              for i, x in enumerate(values)] for values in recommended.steps.values()]
    yield 'Largest torque step per period, at most [N*m]', rows(
        [*recommended.steps, *(['allowed'] if rate else [])], *steps,
        *([[f'{x:.3g}' for x in allowed]] if rate else []))


def _sensors(found: Identification) -> Rows:
    """Return encoders and velocities of all joints: what they show needs no friction."""
    numbers = zip(found.joints, found.encoder, found.noise, found.velocity_lag)
    return [['joint', 'encoder step [rad]', 'velocity noise [rad/s]', 'lag of the velocity [s]'],
            *([joint, *map(cell, values)] for joint, *values in numbers)]


def cell(number: Estimate) -> str:
    """Return a number with its interval or bound, `none` where it would show, else `NO_NUMBER`."""
    if number.value is None and number.reason.startswith((_AT_LEAST, NONE_ABOVE)):
        return ' '.join(number.reason.split()[:3])
    if number.value is None:
        return 'none' if number.reason == NONE else NO_NUMBER
    return with_interval(number.value, number.half)


def missing(found: Identification, verdicts: Sequence[Verdict]) -> Iterator[str]:
    """Yield why joints that are usable lack a number, once for each reason."""
    lacking: dict[tuple[str, str], list[str]] = {}
    for i, (joint, verdict) in enumerate(zip(found.joints, verdicts)):
        if not verdict.usable:
            continue
        named = [(name, getattr(found.friction[i], key)) for key, name in FRICTION]
        named += [('encoder step', found.encoder[i]), ('velocity noise', found.noise[i]),
                  ('lag of the velocity', found.velocity_lag[i])]
        named += [(name, getattr(found, key)[i]) for key, name in _MORE if getattr(found, key)]
        reasons: dict[str, list[str]] = {}
        for name, number in named:
            if number.value is None and cell(number) == NO_NUMBER:
                reasons.setdefault(number.reason.removeprefix(f'{joint} '), []).append(
                    name.split(' [')[0])
        for reason, names in reasons.items():
            lacking.setdefault((', '.join(names), reason), []).append(joint)
    for (what, reason), joints in lacking.items():
        where = 'all joints' if len(joints) == len(found.joints) > 1 else ', '.join(joints)
        yield f'{where}: {what}: not identifiable: {reason}'

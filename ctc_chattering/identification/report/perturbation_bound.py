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

"""The chattering gain ka that holds |P| of the recorded run, and as fast as the limits allow."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import floor, log10
from typing import NamedTuple

from ctc_chattering.analysis.tables import rounded
from ctc_chattering.dynamics.model import Model
from ctc_chattering.identification.regression.estimate import NONE
from ctc_chattering.identification.regression.finding import Finding, Severity
from ctc_chattering.identification.regression.identify import Identification
from ctc_chattering.identification.report.fastest_motion import (
    fastest_perturbation,
    FastestPerturbation,
)
from ctc_chattering.identification.report.perturbation import MeasuredPerturbation
from ctc_chattering.identification.report.verdict import verdicts
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt

#: ka over the largest |P|.
MARGIN = 1.2
#: Ratio of both peaks above which the gain of the recorded motion is named as well.
_FAR = 2.0


class PerturbationBound(NamedTuple):
    """
    ka with its parts; arrays of shape (n,) [N·m].

    Attributes
    ----------
    ka, peak : ndarray
        The gain, and the largest |P| it is for.
    fastest : FastestPerturbation
        As fast as the limits allow.
    reason : str
        The parts.
    findings : tuple of Finding
        Where a drive cannot give as much.

    """

    ka: Array
    peak: Array
    fastest: FastestPerturbation
    reason: str
    findings: tuple[Finding, ...]


def perturbation_bound(found: Identification, run: MeasuredPerturbation, model: Model
                       ) -> PerturbationBound:
    """Return ka for motions within the limits, from what was identified and P of the run."""
    fastest = fastest_perturbation(found, run, model)
    recorded = run.peak
    peak = np.maximum(recorded, fastest.peak)
    effort = fastest.limits.effort
    ka = np.array([_rounded_up(MARGIN * p) for p in peak])
    return PerturbationBound(np.minimum(ka, effort), peak, fastest,
                             _reason(fastest, recorded, peak, [
                                 x.usable for x in verdicts(found)]),
                             (*_beyond(peak, ka, effort), *_unknown(found), *_impacts(run)))


def _reason(fastest: FastestPerturbation, recorded: Array, peak: Array, usable: Sequence[bool]
            ) -> str:
    """Return the parts of ka in words, without numbers of joints that are not usable."""
    def listed(values: Array) -> str:
        return ', '.join(f'{x:.3g}' if good else '-' for x, good in zip(values, usable))

    limits = fastest.limits
    how = 'at the limits of the description' if limits.known.all() else (
        'at the speed of the run, since its limit is not known' if not limits.known.any() else
        'at the limits of the description, or the speed of the run where there is none')
    text = (f'{MARGIN:g} times the largest |P| {how}, {listed(limits.velocity)} rad/s: friction '
            f'{listed(fastest.friction)}, errors of the model {listed(fastest.error)}, '
            f'unexplained {listed(fastest.unexplained)} N*m; in the run |P| is at most '
            f'{listed(recorded)} N*m')
    text += _main_part(fastest, np.array(usable))
    if (peak > _FAR * recorded)[np.array(usable)].any():
        least = np.array([_rounded_up(MARGIN * p) for p in recorded])
        text += f', for which {listed(least)} would do'
    return text


def _main_part(fastest: FastestPerturbation, usable: npt.NDArray[np.bool_]) -> str:
    """Return which part makes ka much larger than friction needs, and what lowers it."""
    far = usable & (np.maximum(fastest.error, fastest.unexplained) > fastest.friction)
    if not far.any():
        return ''
    if (fastest.error >= fastest.unexplained)[far].all():
        return ('; errors of the model make the most of it: with a corrected description (--urdf) '
                'ka is lower')
    return ('; what is not explained makes the most of it: a motion with another load or without '
            'contacts may lower it')


def _beyond(peak: Array, ka: Array, effort: Array) -> Iterator[Finding]:
    """Yield the joints whose drive cannot give ka."""
    for i, (p, k, most) in enumerate(zip(peak, ka, effort)):
        if k > most:
            yield Finding(Severity.CARE, i, f'|P| reaches {p:.3g} N*m as fast as the limits '
                          f'allow; ka = {k:.3g} N*m is cut to its effort limit, {most:.3g} N*m',
                          'correct the model, or move more slowly')


def _impacts(run: MeasuredPerturbation) -> Iterator[Finding]:
    """Yield the joints of which |P| is larger for a short time."""
    for i, (smooth, more) in enumerate(zip(run.smooth_peak, run.impact)):
        if more > 0.0:
            yield Finding(Severity.CARE, i, f'|P| reaches {smooth + more:.3g} N*m for 0.02 s, and '
                          f'{smooth:.3g} N*m over 0.1 s: impacts of backlash, or an elastic joint',
                          'look for play in the gear; ka has them, as far as the run shows them')


def _unknown(found: Identification) -> Iterator[Finding]:
    """Yield the joints of which a part of the friction is not known."""
    for i, one in enumerate(found.friction):
        for severity, number, what in (
                (Severity.CARE, one.viscous, 'ka holds at the speeds of the run only'),
                (Severity.NOTE, one.stribeck, 'ka may be too small at a break-away')):
            if one.coulomb.value is not None and number.value is None and number.reason != NONE:
                yield Finding(severity, i, f'{what}: {number.reason}',
                              'record slow reversals, and different speeds')


def _rounded_up(value: float) -> float:
    """Return a value with three digits, at least as large."""
    if value <= 0.0:
        return 0.0
    unit = 10.0 ** (floor(log10(value)) - 2)
    return rounded(float(np.ceil(value / unit - 1e-9) * unit), 6)

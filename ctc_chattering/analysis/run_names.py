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
Names and colours that tell runs apart.

All figures, tables and pages use them.

A name has the experiment, the laws and, where runs would have the same name, what differs.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import chain, cycle, groupby
from typing import NamedTuple

from ctc_chattering.analysis.result import Result
from ctc_chattering.control.laws.registry import LAWS
from ctc_chattering.number_format import format_joint_values

#: Colour of each law in all figures and pages, after Okabe and Ito.
LAW_COLOURS = dict(
    zip(
        LAWS,
        cycle(
            (
                '#D55E00',
                '#0072B2',
                '#B0428A',
                '#B8860B',
                '#56A0D3',
                '#6B4E2E',
                '#7F7F7F',
                '#7B5EA7',
                '#8C1D40',
                '#009E9E',
                '#007A5A',
            )
        ),
    )
)
#: Colour of a run under several laws.
SEVERAL_LAWS_COLOUR = '#1B1B1B'
#: Share of white in the colours of further runs under a law; of black where it is negative.
_SHADES = (0.0, 0.45, -0.45, 0.25, -0.25, 0.65)


class RunName(NamedTuple):
    """
    Name of a run.

    Attributes
    ----------
    experiment, laws : str
        Experiment and laws.
    details : str
        Switching, gains, bag or number, as far as they tell the run from others.

    """

    experiment: str
    laws: str
    details: str = ''

    @property
    def short(self) -> str:
        """Name without the experiment."""
        return self.laws + self.details

    def __str__(self) -> str:
        """Return the whole name."""
        return f'{self.experiment}: {self.short}'


def run_name(result: Result) -> RunName:
    """
    Return the name of a run without others.

    It has the switching, unless that is `sign`, as in the paper.
    """
    switchings = [
        name
        for name, _ in groupby(
            config.switching
            for _, config in result.configs
            if 'switching' in config.law_parameters
        )
    ]
    details = ''
    if len(switchings) > 2:
        details = ' (several switchings)'
    elif switchings not in ([], ['sign']):
        details = f' ({" → ".join(switchings)})'
    return RunName(result.experiment, result.laws, details)


def run_names(results: Sequence[Result]) -> list[RunName]:
    """
    Return names of several runs, all different.

    Runs of the same name get the gains that differ. If none differ, they get the name of the bag.
    If that does not help, they get a number.
    """
    names = [run_name(result) for result in results]
    for indices in _repeated(names):
        gains = [_gains(results[i]) for i in indices]
        differing = [key for key in gains[0] if len({x.get(key) for x in gains}) > 1]
        for i, values in zip(indices, gains):
            # A name has three gains at most.
            named = [key for key in differing[:3] if key in values]
            _extend(names, i, ''.join(f', {key} {values[key]}' for key in named))
    for i in chain.from_iterable(_repeated(names)):
        if results[i].source:
            _extend(names, i, f', bag {results[i].source}')
    for number, i in enumerate(sorted(chain.from_iterable(_repeated(names))), 1):
        _extend(names, i, f' #{number}')
    return names


def _repeated(names: Sequence[RunName]) -> list[list[int]]:
    """Return the indices of runs with equal names."""
    groups: dict[RunName, list[int]] = {}
    for i, name in enumerate(names):
        groups.setdefault(name, []).append(i)
    return [indices for indices in groups.values() if len(indices) > 1]


def _extend(names: list[RunName], i: int, details: str) -> None:
    """Add details to a name."""
    names[i] = names[i]._replace(details=names[i].details + details)


class NamedRun(NamedTuple):
    """Run with its name and colour among several."""

    result: Result
    name: RunName
    colour: str


def name_runs(results: Sequence[Result]) -> list[NamedRun]:
    """Return runs with names and colours that differ."""
    colours = shaded([run_colour(x) for x in results], [x.experiment for x in results])
    return list(map(NamedRun, results, run_names(results), colours))


def gains_text(result: Result) -> str:
    """
    Return gains and sample period on one line.

    They are those in force at the end.
    """
    return ', '.join(f'{key} {value}' for key, value in _gains(result).items())


def _gains(result: Result) -> dict[str, str]:
    """Return gains and sample period as text."""
    values = {**result.gains, 'control_period': result.config.control_period}
    return {key: format_joint_values(value) for key, value in values.items()}


def run_colour(result: Result) -> str:
    """Return the colour of a run alone."""
    return SEVERAL_LAWS_COLOUR if result.changes else LAW_COLOURS[result.law]


def shaded(colours: Sequence[str], groups: Sequence[object] = ()) -> list[str]:
    """
    Return colours in shades that differ within groups.

    Colours are ``#rrggbb``.
    """
    used: Counter[tuple[object, str]] = Counter()
    shades = []
    for group, colour in zip(groups or [None] * len(colours), colours):
        share = _SHADES[used[group, colour] % len(_SHADES)]
        used[group, colour] += 1
        shades.append(_mix(colour, abs(share), 255 if share > 0.0 else 0))
    return shades


def _mix(colour: str, share: float, grey: int) -> str:
    """Return a colour mixed with white, 255, or black, 0."""
    mixed = [round((1.0 - share) * level + share * grey) for level in bytes.fromhex(colour[1:])]
    return f'#{bytes(mixed).hex().upper()}'

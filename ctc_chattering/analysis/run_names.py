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

"""Distinct names and colours for several runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import cycle, groupby

from ctc_chattering.analysis.number_format import number_text
from ctc_chattering.analysis.result import Result
from ctc_chattering.control.controller import LAWS

#: Colour of each law, the same in all figures and pages, and of a run under several (after
#: Okabe and Ito).
LAW_COLOURS = dict(zip(LAWS, cycle((
    '#D55E00', '#0072B2', '#B0428A', '#B8860B', '#56A0D3', '#6B4E2E', '#7F7F7F', '#7B5EA7',
    '#8C1D40', '#009E9E', '#007A5A'))))
MIXED = '#1B1B1B'
#: Part of white, or of black where it is negative, in the colours of further runs under one law.
_SHADES = (0.0, 0.45, -0.45, 0.25, -0.25, 0.65)
#: Parameters that are added to names which would be equal, and their symbols.
_SIGNS = {'ka': 'Ka', 'kp': 'Kp', 'kv': 'Kv', 'lambda': 'λ', 'b': 'b', 'control_period': 'h',
          'boundary_layer': 'layer', 'observer_bandwidth': 'bandwidth',
          'ki': 'Ki', 'momentum_gain': 'K', 'super_twisting_k1': 'k₁',
          'super_twisting_k2': 'k₂', 'adaptation_gain': 'Γ', 'friction_level': 'f',
          'friction_velocity': 'ε', 'friction_lead': 't', 'lead_ratio': 'a',
          'input_delay': 'delay', 'inertia_scale': 'inertia ×', 'gravity_scale': 'gravity ×'}


def name(result: Result) -> str:
    """Return experiment, laws, and the switching where it is not the paper's."""
    kinds = [kind for kind, _ in groupby(
        config.switching for _, config in result.configs if config.law == 'chattering')]
    if not kinds or kinds == ['sign']:
        return result.label
    return f'{result.label} ({" → ".join(kinds) if len(kinds) < 3 else "several switchings"})'


def names(results: Sequence[Result]) -> list[str]:
    """
    Return a name for each of several runs, all different.

    Where experiment, law and switching are the same, gains that differ are added; where these
    are the same too, the name of the bag, or a number.
    """
    found = [name(result) for result in results]
    for clash in [text for text, count in Counter(found).items() if count > 1]:
        mine = [i for i, text in enumerate(found) if text == clash]
        values = [results[i].config.as_mapping() for i in mine]
        differ = [key for key in _SIGNS if len({str(v[key]) for v in values}) > 1]
        for i, value in zip(mine, values):
            found[i] = ', '.join([found[i], *(
                f'{_SIGNS[key]} {number_text(value[key])}' for key in differ[:3])])
    for i in _repeated(found):
        if results[i].source:
            found[i] += f', bag {results[i].source}'
    for k, i in enumerate(_repeated(found), 1):
        found[i] += f' #{k}'
    return found


def colours(results: Sequence[Result]) -> list[str]:
    """Return a colour for each run: that of its law, in shades for several of an experiment."""
    return shaded([colour(x) for x in results], [x.experiment for x in results])


def shaded(colours: Sequence[str], groups: Sequence[object] = ()) -> list[str]:
    """Return colours, ``#rrggbb``, of which equal ones of a group become different shades."""
    before: Counter[tuple[object, str]] = Counter()
    found = []
    for group, text in zip(groups or [None] * len(colours), colours):
        share = _SHADES[before[group, text] % len(_SHADES)]
        before[group, text] += 1
        end = 255.0 if share > 0.0 else 0.0
        found.append('#' + ''.join(
            f'{round((1.0 - abs(share)) * int(text[i:i + 2], 16) + abs(share) * end):02X}'
            for i in (1, 3, 5)))
    return found


def colour(result: Result) -> str:
    """Return the colour of a run by itself."""
    return MIXED if result.changes else LAW_COLOURS[result.law]


def gains(result: Result) -> str:
    """Return the gains in force at the end, and the sample period, on one line."""
    values = [f'{_SIGNS.get(key, key)} {number_text(value)}'
              for key, value in result.gains.items()]
    return ', '.join([*values, f'h {1e3 * result.config.control_period:g} ms'])


def _repeated(found: Sequence[str]) -> list[int]:
    counts = Counter(found)
    return [i for i, text in enumerate(found) if counts[text] > 1]

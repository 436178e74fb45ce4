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

"""Figures and page of the map of a spec."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.number_format import short
from ctc_chattering.robustness.quantity import Quantity, Uncertain
from ctc_chattering.robustness.report.data import MapData
from ctc_chattering.robustness.report.figures import save_map_figures
from ctc_chattering.robustness.report.page import write_map_page
from ctc_chattering.robustness.shards import FIGURES, JSON, PAGE, TABLE
from ctc_chattering.robustness.spec import MapSpec

#: Numbers of a distribution in words.
_WORDS = {'uniform': 'uniform, {} to {}', 'log_uniform': 'log-uniform, {} to {}',
          'normal': 'normal, {} ± {}'}


def write_report(spec: MapSpec, table: Any, directory: Path, extra: str = 'svg',
                 command: str = '') -> Path:
    """
    Write figures and page of a map beside its results, and return the page.

    Parameters
    ----------
    spec : MapSpec
        What was run.
    table : pyarrow.Table
        Its rows.
    directory : Path
        Of the results.
    extra : str
        A second format of the figures: ``pdf`` or ``png``.
    command : str
        What was run.

    Raises
    ------
    CtcError
        If a file cannot be written.

    """
    data = MapData(table, {x.name: x.unit for x in spec.axes}, [x.name for x in spec.uncertain],
                   [x.name for x, step in zip(spec.axes, spec.coarse) if step > 1],
                   spec.repeats.sampling == 'saltelli')
    figures = save_map_figures(data, directory / FIGURES, extra)
    write_map_page(data, figures, directory / PAGE, facts(spec),
                   {TABLE: 'a row a run', JSON: 'the spec, versions and counts'}, command)
    return directory / PAGE


def facts(spec: MapSpec) -> dict[str, str]:
    """Return what a page says of a spec, besides the grid and the numbers of runs."""
    plant, (low, high) = spec.setup.plant, spec.window
    found = {'map': spec.name, 'robot and motion': (
        f'{plant.experiment}, {plant.duration:g} s, evaluated from {low:g} s to {high:g} s')}
    found |= {x.name: _meaning(x) for x in (*spec.axes, *spec.uncertain)}
    if spec.uncertain:
        found['draws'] = f'{spec.repeats.sampling}, with seed {spec.repeats.seed}'
    return {**found, 'a run fails if': ', or '.join(_failures(spec))}


def _failures(spec: MapSpec) -> Iterator[str]:
    limits = spec.failure
    yield 'it diverges'
    if isfinite(limits.error_above):
        yield f'the RMS error of a joint exceeds {limits.error_above:g} rad'
    if limits.saturated_above < 1.0:
        yield (f'a torque is at its limit in more than {100.0 * limits.saturated_above:g} % of '
               'the samples')
    if limits.not_reached:
        yield 'v never stays within its band'
    yield f'it would take more than {short(limits.steps_above)} steps of the integrator'


def _meaning(x: Quantity) -> str:
    """Return what a quantity sets, and how it is drawn."""
    names = [f'{node}.{spec.name}' for node, spec in x.targets]
    text = ('factor of ' if x.factor else '') + ' and '.join(names)
    if isinstance(x, Uncertain):
        numbers = [short(y) for y in x.numbers]
        text += ', ' + (_WORDS[x.distribution].format(*numbers) if x.distribution in _WORDS
                        else 'one of ' + ', '.join(numbers))
    return text

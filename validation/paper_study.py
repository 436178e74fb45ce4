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
The tables of validation/paper.md: `PYTHONPATH=test/support python validation/paper_study.py`.

The first is of the package's laws, the second of the programs written by hand.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.compilation import compile_setups
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.runs.conditions import find_condition, merge_overrides
from ctc_chattering.runs.recommended import gains_by_rule
from ctc_chattering.runs.score import PER_JOINT, Score, score
from independent_laws import Array, Gains, Known, Sliding
import numpy as np
from reproduced_table import played

#: Columns of the first table: file, condition, what the controller is told in place of the truth.
COLUMNS: dict[str, tuple[str, str, dict[str, Any]]] = {
    'ideal': ('friction', 'clean', {}),
    'lag, not told': ('friction', 'lag', {'actuator_lag': [0.0, 0.0]}),
    'delay, not told': ('friction', 'delay', {'input_delay': 0}),
    'encoder': ('friction', 'encoder', {}),
    'model ±10 %': ('friction', 'model_error', {}),
    'real arm': ('friction', 'real_arm', {}),
    'payload, Panda': ('panda', 'payload', {})}
#: Ka of its rows [N·m]: None for that of the file.
KA = {'0': 0.0, 'of the file': None, 'sufficient': 'recommended', 'no bound': 1e6}
#: Laws of its rows, and which Ka they have.
_OBSERVER = {'law': 'chattering', 'switching': 'implicit_observer', 'observer_bandwidth': 200.0}
LAWS: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    '(2)': ({'law': 'compensation'}, ('of the file',)),
    **{f'(6) `{x}`': ({'law': 'chattering', 'switching': x}, ('of the file',))
       for x in ('sign', 'boundary_layer', 'implicit')},
    '(6) `implicit_observer`': (_OBSERVER, tuple(KA)[1:]),
    '`observer_feedback`': ({'law': 'observer_feedback'}, tuple(KA))}
#: H [s] of the second table.
HORIZONS = (1e-3, 1e-2, 3e-2, 1e-1, np.inf)
#: Columns of the second table: what the law knows of `real_arm`; the worst of each.
TOLD = {
    'real arm': (Known(0.9), Known(1.1)),
    'model ±20 %': (Known(0.8), Known(1.2)),
    'rate told 20 % too high': (Known(0.9, rate=(6e3, 1.2e3)), Known(1.1, rate=(6e3, 1.2e3))),
    'lag not told, model × 0.9': (Known(0.9, lag=(0.0, 0.0)),),
    'lag not told, model × 1.1': (Known(1.1, lag=(0.0, 0.0)),)}


def setups(law: dict[str, Any], ka: str, column: str) -> list[Setup]:
    """Return the runs of a cell of the first table."""
    file, name, told = COLUMNS[column]
    path, found = config_directory() / f'{file}.yaml', []
    for case in find_condition(name).cases(parameter_file.load(path)):
        setup = parameter_file.load(path, case.overrides)
        known = gains_by_rule(setup, 'observer_feedback')
        given = {**(known if law['law'] == 'observer_feedback' else {}), **law}
        given['ka'] = known['ka'] if KA[ka] == 'recommended' else [
            x if KA[ka] is None else KA[ka] for x in setup.controller.ka]
        found.append(parameter_file.load(path, merge_overrides(
            case.overrides, {'controller': {**told, **given}})))
    return found


def worst(scores: Iterable[Score]) -> Score:
    """Return the largest of every number of each joint, or the first score without numbers."""
    found: list[Score] = []
    for each in scores:
        if each.failure:
            return each
        found.append(each)
    largest: dict[str, Any] = {name: tuple(map(max, zip(*(getattr(x, name) for x in found))))
                               for name in PER_JOINT}
    return found[0]._replace(**largest)


def cell(law: dict[str, Any], ka: str, column: str) -> str:
    """Return RMS error [rad] and torque variation [N·m/s] of joint 2; of a Panda the largest."""
    found: Score = worst(score(x) for x in setups(law, ka, column))
    if found.failure:
        return 'diverges'
    if len(found.rms) > 2:
        return f'{found.error:.1e}'
    return f'{found.rms[1]:.1e}, {found.variation[1]:.0f}'


def law_rows() -> Iterator[list[str]]:
    """Yield the rows of the first table."""
    for name, (law, kas) in LAWS.items():
        for ka in kas:
            yield [name if len(kas) == 1 else f'{name}, Ka {ka}', *(
                cell(law, ka, column) for column in COLUMNS)]


def slid(horizon: float, told: tuple[Known, ...]) -> tuple[Array, Array]:
    """Return RMS errors and torque variation, shape (2,), the worst of what is told."""
    with np.errstate(all='ignore'):
        found = [played(Sliding(known, Gains(), horizon)) for known in told]
    return np.max([x[0] for x in found], axis=0), np.max([x[1] for x in found], axis=0)


def sliding_row(horizon: float) -> list[str]:
    """Return a row of the second table: errors of both joints."""
    found = [slid(horizon, told) for told in TOLD.values()]
    variation = found[0][1]
    return ['∞' if horizon == np.inf else f'{1e3 * horizon:g}',
            f'{variation[0]:.0f}, {variation[1]:.0f}', *(
                f'{e[0]:.1e}, {e[1]:.1e}' if e.max() < 3.0 else 'diverges' for e, _ in found)]


def print_table(head: list[str], rows: Iterator[list[str]]) -> None:
    """Print a table in Markdown, row by row."""
    print(f'| {" | ".join(head)} |\n{"|---" * len(head)}|')
    for row in rows:
        print(f'| {" | ".join(row)} |', flush=True)
    print()


def main() -> None:
    """Print both tables."""
    compile_setups([x for law, kas in LAWS.values() for column in ('ideal', 'payload, Panda')
                    for x in setups(law, kas[0], column)], print)
    print_table(['law', *COLUMNS], law_rows())
    print_table(['H [ms]', 'variation', *TOLD], (sliding_row(x) for x in HORIZONS))


if __name__ == '__main__':
    main()

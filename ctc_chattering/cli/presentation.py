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

"""Terminal output of commands: progress bar, table of results, path of the page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TYPE_CHECKING

from ctc_chattering.number_format import format_number, format_numbers
from ctc_chattering.numerics.time_grid import seconds

if TYPE_CHECKING:
    from ctc_chattering.learning.progress import Pass

_BAR = '{desc}: {bar} {n_fmt}/{total_fmt} {unit} [{elapsed}]'


@contextmanager
def progress(title: str, total: float = 0.0, unit: str = 's') -> Iterator[Callable[..., None]]:
    """
    Yield a function that shows progress as a bar in a terminal.

    Its arguments are the completed amount and the total. No bar appears before its first call, so
    that an early refusal remains one line.

    Parameters
    ----------
    title : str
        Text before the bar.
    total : float
        Total amount, unless a call gives another one. 0 without an end.
    unit : str
        Unit of the amount, ``s`` for simulated time.

    """
    from tqdm import tqdm  # A node's executable works without it.
    bars: list[Any] = []

    def show(completed: float, total: float = total) -> None:
        if not bars:
            bars.append(tqdm(desc=title, total=total or None, unit=unit, disable=None,
                             mininterval=0.2, bar_format=_BAR))
        bars[0].total = total or None
        bars[0].n = round(min(completed, total) if total else completed, 1)
        with suppress(OSError):  # The reader of a pipe has ended.
            bars[0].update(0)
    try:
        yield show
    finally:
        for bar in bars:
            bar.close()


def print_page(page: Path, *commands: str) -> None:
    """Print the path of the page and further commands, as the last line of a command."""
    print('; '.join([f'open {page}', *commands]))


def print_results(results: Sequence[Any]) -> None:
    """Print the metrics of runs, each a `Result`, as a table, and their notes."""
    from ctc_chattering.analysis.run_comparison import comparison_rows
    from ctc_chattering.analysis.run_names import run_names
    from ctc_chattering.analysis.tables import print_columns
    rows: list[Sequence[str]] = [(
        'run', 'RMS e [rad]', 'max |e|_1 [rad]', 'torque variation [N*m/s]', 'v reached [s]')]
    notes = []
    for name, result in zip(run_names(results), results):
        m = result.metrics()
        rows.append((str(name), *(format_numbers(m[key]) for key in (
            'rms_error_rad', 'max_error_norm1_rad', 'torque_variation_nm_per_s',
            'reaching_time_s'))))
        notes += [[f'{name}: {text}'] for text in m['notes']]
    print_columns(rows)
    if compared := comparison_rows(results):
        print_columns([['joint', 'compared', *map(str, run_names(results))], *compared])
    if notes:
        print_columns(notes)


def print_passes(passes: Sequence[Pass], joint_names: Sequence[str]) -> None:
    """Print the RMS error of each joint in each pass as a table."""
    from ctc_chattering.analysis.tables import print_columns
    rows = [(str(k), f'{seconds(x.begin):.4g}', f'{seconds(x.end):.4g}',
             *map(format_number, x.rms)) for k, x in enumerate(passes, 1)]
    print('RMS error of each joint [rad]')
    print_columns([('pass', 'from [s]', 'to [s]', *joint_names), *rows])

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

"""What commands show: progress, results of runs as a table, and where the page is."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ctc_chattering.number_format import format_numbers

_BAR = '{desc}: {bar} {n_fmt}/{total_fmt} {unit} [{elapsed}]'


@contextmanager
def progress(title: str, total: float = 0.0, unit: str = 's') -> Iterator[Callable[..., None]]:
    """
    Yield a function of what is done, and of all there is, which shows a bar in a terminal.

    There is no bar before its first call: what is refused until then is one line.

    Parameters
    ----------
    title : str
        What stands before the bar.
    total : float
        All there is, until a call says otherwise; 0 without an end.
    unit : str
        ``s`` for simulated time, otherwise of what is counted.

    """
    from tqdm import tqdm  # A node's executable does without.
    bars: list[Any] = []

    def moved(done: float, whole: float = total) -> None:
        if not bars:
            bars.append(tqdm(desc=title, total=whole or None, unit=unit, disable=None,
                             mininterval=0.2, bar_format=_BAR))
        bars[0].total = whole or None
        bars[0].n = round(min(done, whole) if whole else done, 1)
        with suppress(OSError):  # Nobody reads it any more.
            bars[0].update(0)
    try:
        yield moved
    finally:
        for bar in bars:
            bar.close()


def print_page(page: Path, *commands: str) -> None:
    """Print where the page is, as the last line of a command, and what can be done next."""
    print('; '.join([f'open {page}', *commands]))


def print_results(results: Sequence[Any]) -> None:
    """Print the numbers of runs, each a `Result`, in a table."""
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
    if notes:
        print_columns(notes)

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

"""Results of runs as figures, metrics and page, and as a table on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ctc_chattering.analysis.result import Result
from ctc_chattering.analysis.run_names import names
from ctc_chattering.analysis.tables import measured, print_columns


def present(results: Sequence[Result], bags: Sequence[Path], out: Path,
            extra: str = 'svg', command: str = '') -> int:
    """Write figures, metrics, samples and page into `out`; the figures as `extra` as well."""
    from ctc_chattering.analysis.run_page import PAGE, write_runs
    print(f'drawing {len(results)} run{"s" if len(results) > 1 else ""} ...', flush=True)
    write_runs(results, out, bags, extra, command)
    print_results(results)
    print_page(out / PAGE)
    return 0


def print_page(page: Path, *commands: str) -> None:
    """Print where the page is, as the last line of a command, and what can be done next."""
    print('; '.join([f'open {page}', *commands]))


def print_results(results: Sequence[Result]) -> None:
    """Print the runs' numbers in a table."""
    rows: list[Sequence[str]] = [(
        'run', 'RMS e [rad]', 'max |e|_1 [rad]', 'torque variation [N*m/s]', 'v reached [s]')]
    notes = []
    for name, result in zip(names(results), results):
        m = result.metrics()
        rows.append((name, *(measured(m[key]) for key in (
            'rms_error_rad', 'max_error_norm1_rad', 'torque_variation_nm_per_s',
            'reaching_time_s'))))
        notes += [[f'{name}: {text}'] for text in m['notes']]
    print_columns(rows)
    if notes:
        print_columns(notes)

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

"""What is written of runs: figures, numbers, samples and page."""

from __future__ import annotations

from collections.abc import Sequence
import os
from pathlib import Path

from ctc_chattering.analysis.output import check_format, prepare
from ctc_chattering.analysis.result import Result, write_metrics
from ctc_chattering.arguments import check_each, checked
from ctc_chattering.errors import ParameterError

#: Names in the directory of `write_runs`.
FIGURES, METRICS, PAGE, SAMPLES = NAMES = ('figures', 'metrics.json', 'index.html', 'samples')


@checked(results=Sequence, out=(str, Path), bags=Sequence, command=str)
def write_runs(results: Sequence[Result], out: str | Path, bags: Sequence[str | Path] = (),
               extra: str = 'svg', command: str = '') -> None:
    """
    Write figures, numbers and a page with interactive plots, on which runs are compared.

    Parameters
    ----------
    results : sequence of Result
        As `simulate` and `read_bag` return them.
    out : str or Path
        Directory for ``index.html``, ``metrics.json``, ``figures``, ``samples``.
    bags : sequence of str or Path
        The bag of each result, to which the page links; empty for no links.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.
    command : str
        What was run, for the page.

    Raises
    ------
    CtcError
        If there is no result, a run has no samples, a file exists already, or cannot be written.

    """
    from ctc_chattering.analysis.figures import save_figures
    from ctc_chattering.analysis.report import write_page
    from ctc_chattering.analysis.run_samples import write_samples

    check_each('results', results, Result, 1)
    check_each('bags', bags, (str, Path))
    if len(bags) not in (0, len(results)):
        raise ParameterError('bags', bags, f'none, or {len(results)}, one of each result')
    check_format(extra)
    out = prepare(Path(out), NAMES)
    figures = save_figures(results, out / FIGURES, extra)
    write_metrics(results, out / METRICS)
    write_page(results, figures, out / PAGE, [os.path.relpath(bag, out) for bag in bags],
               write_samples(results, out / SAMPLES), command)

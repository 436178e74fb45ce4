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

"""`ctc study`: every switching, or every law, over sample periods, gains and imperfections."""

from __future__ import annotations

import argparse
import time

from ctc_chattering.analysis.output import prepare
from ctc_chattering.cli.command_line import say
from ctc_chattering.cli.options import (
    add_format,
    add_jobs,
    add_output,
    number_of_jobs,
)
from ctc_chattering.cli.presentation import print_page

DETAILS = ('Simulate them and write study.md, study.csv, figures and study.html; with --laws, '
           'laws.md, laws.csv, laws_figures and laws.html.')


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc study`."""
    add_output(parser, 'study')
    parser.add_argument('--laws', action='store_true',
                        help='compare the laws, with recommended settings, not the switchings')
    add_jobs(parser)
    add_format(parser, 'png')


def run(options: argparse.Namespace) -> int:
    """Run `ctc study`."""
    from ctc_chattering.cli.progress import counting_bar
    from ctc_chattering.runs.study import engines, study
    from ctc_chattering.runs.study_page import OF_LAWS, OF_SWITCHINGS, write_study

    jobs, start = number_of_jobs(options.jobs), time.monotonic()
    kind = OF_LAWS if options.laws else OF_SWITCHINGS
    out = prepare(options.out, kind.names, options.overwrite)
    with counting_bar(desc=kind.name, unit='run') as progress:
        outcomes = study(options.laws, jobs=jobs, show=say, progress=progress)
    print('drawing ...', flush=True)
    write_study(outcomes, out, options.format, options.said)
    failed = sum(bool(outcome.score.failure) for outcome in outcomes)
    print(f'{len(outcomes)} runs, {failed} diverged, {time.monotonic() - start:.0f} s. '
          f'{engines(outcomes)}.')
    print_page(out / f'{kind.name}.html')
    return 0

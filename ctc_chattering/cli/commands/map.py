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

"""`ctc map`: from a spec to results, figures and a page, or to one run of them."""

from __future__ import annotations

import argparse
from functools import partial
from importlib.util import find_spec

from ctc_chattering.cli.options import add_format, add_jobs, add_output, number_of_jobs
from ctc_chattering.cli.presentation import print_page
from ctc_chattering.errors import UsageError

DETAILS = ('Write map.parquet, one row per run, map.json, figures and index.html. An interrupted '
           'map is continued.')


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc map`."""
    parser.add_argument('spec', metavar='SPEC.yaml',
                        help='what to run (docs/maps.md), or the name of a map in the package')
    add_jobs(parser)
    parser.add_argument('--scheduler', metavar='ADDRESS',
                        help='address of a running dask cluster, tcp://host:port')
    parser.add_argument('--explain', metavar='POINT',
                        help='write and plot one run, given by its number or by name=value,... of '
                             'axes, law and repeat')
    add_format(parser)
    add_output(parser, 'map')


def run(options: argparse.Namespace) -> int:
    """Run `ctc map`."""
    from ctc_chattering.cli.map_explanation import explain
    from ctc_chattering.cli.progress import counting_bar
    from ctc_chattering.runs.map import compute_map, map_spec
    from ctc_chattering.runs.points import Runs
    from ctc_chattering.runs.store import PAGE

    if options.jobs is not None and options.scheduler is not None:
        raise UsageError('--jobs and --scheduler exclude each other: a cluster has its workers')
    if find_spec('pandas') is None:  # It is needed at the end, and takes time to import.
        raise ModuleNotFoundError(name='pandas')
    jobs = number_of_jobs(options.jobs)
    spec = map_spec(options.spec)
    if options.explain is not None:
        return explain(Runs(spec), options)
    with counting_bar(desc='map', unit='run') as progress:
        compute_map(spec, options.out, jobs, options.scheduler, options.overwrite,
                    partial(print, flush=True), progress, options.format, options.said)
    print_page(options.out / PAGE)
    return 0

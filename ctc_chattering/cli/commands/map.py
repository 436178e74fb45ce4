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
from importlib.util import find_spec

from ctc_chattering.cli.options import add_format, add_jobs, add_output, number_of_jobs
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.errors import UsageError

DETAILS = ('Write map.parquet, a row a run; map.json, figures and index.html. What is there of '
           'the same map is not computed again.')
#: Folder of the package's own specs, below `config`.
_FOLDER = 'maps'


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc map`."""
    parser.add_argument('spec', metavar='SPEC.yaml',
                        help='what to run, docs/maps.md; or the name of one of the package')
    add_jobs(parser)
    parser.add_argument('--scheduler', metavar='ADDRESS',
                        help='of a dask cluster that is there, tcp://host:port')
    parser.add_argument('--explain', metavar='POINT',
                        help='write and draw one run, by its number or by name=value,... of axes, '
                             'law and repeat')
    add_format(parser)
    add_output(parser, 'map')


def run(options: argparse.Namespace) -> int:
    """Run `ctc map`."""
    from ctc_chattering.cli.map_explanation import explain
    from ctc_chattering.cli.map_runs import compute_map
    from ctc_chattering.robustness.runs import Runs
    from ctc_chattering.robustness.spec import read_spec

    if options.jobs is not None and options.scheduler is not None:
        raise UsageError('--jobs and --scheduler exclude each other: a cluster has its workers')
    if find_spec('pandas') is None:  # It is needed at the end, and takes time to import.
        raise ModuleNotFoundError(name='pandas')
    jobs = number_of_jobs(options.jobs)
    runs = Runs(read_spec(find_config(options.spec, folder=_FOLDER)))
    if options.explain is not None:
        return explain(runs, options)
    return compute_map(runs, jobs, options)

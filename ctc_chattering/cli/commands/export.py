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

"""`ctc export`: the samples of a bag as a table."""

from __future__ import annotations

import argparse

from ctc_chattering.analysis.output import prepare
from ctc_chattering.analysis.result import export
from ctc_chattering.cli.options import add_bag, add_output, add_own, own

DETAILS = ('Write trajectory.npz, which also has the gains, or trajectory.csv, with names and '
           'units of the joints.')


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc export`."""
    add_bag(parser)
    add_own(parser)
    parser.add_argument('--csv', action='store_true',
                        help='write trajectory.csv instead of trajectory.npz')
    add_output(parser, 'export')


def run(options: argparse.Namespace) -> int:
    """Run `ctc export`."""
    from ctc_chattering.bags.reader import read_bag

    result = read_bag(options.bag, **own(options))
    name = 'trajectory.csv' if options.csv else 'trajectory.npz'
    out = prepare(options.out, (name,), options.overwrite)
    export(result, out / name)
    print(f'{len(result.t)} samples: {out / name}')
    return 0

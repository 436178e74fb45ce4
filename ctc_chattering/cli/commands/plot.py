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

"""`ctc plot`: figures, metrics and page of bags."""

from __future__ import annotations

import argparse
from pathlib import Path
import sys

from ctc_chattering.analysis.output import prepare
from ctc_chattering.analysis.run_page import NAMES
from ctc_chattering.cli.options import add_format, add_output, add_own, own
from ctc_chattering.cli.presentation import present
from ctc_chattering.errors import CtcError

DETAILS = 'Write them with metrics.json and index.html. Several bags are compared.'


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc plot`."""
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG',
                        help='bag, or directory of bags')
    add_own(parser)
    add_format(parser)
    add_output(parser, 'plots')


def run(options: argparse.Namespace) -> int:
    """Run `ctc plot`."""
    from ctc_chattering.bags.reader import find_bags, read_bag

    bags, results = [], []
    for path in options.bags:
        found = find_bags(path)
        for bag in found or [path]:
            try:
                results.append(read_bag(bag, **own(options)))
                bags.append(bag)
            except CtcError as error:
                if not found:
                    raise
                print(f'left out: {error}', file=sys.stderr)
    if not results:
        raise CtcError('no bag of this package in '
                       + ', '.join(str(path) for path in options.bags))
    out = prepare(options.out, NAMES, options.overwrite)
    return present(results, bags, out, options.format, options.said)

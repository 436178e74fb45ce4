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

"""`ctc replay`: a bag on its topics again."""

from __future__ import annotations

import argparse

from ctc_chattering.cli.options import add_bag, check

DETAILS = 'With its original timing, and /clock.'


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc replay`."""
    add_bag(parser)
    parser.add_argument('--rate', type=float, default=1.0, metavar='R',
                        help='speed factor, default: 1')
    parser.add_argument('--delay', type=float, default=1.0, metavar='S',
                        help='time to wait for subscribers first [s], default: 1')


def run(options: argparse.Namespace) -> int:
    """Run `ctc replay`."""
    check('--rate', options.rate, 0, exclusive=True)
    check('--delay', options.delay, 0)
    from ctc_chattering.bags.replay import replay
    count = replay(options.bag, options.rate, options.delay)
    print(f'{count} messages')
    return 0

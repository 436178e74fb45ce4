"""`ctc replay`: a bag on its topics again."""

from __future__ import annotations

import argparse
from contextlib import closing

from ctc_chattering.cli.options import add_bag, check

DETAILS = 'With its own timing, and /clock.'


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc replay`."""
    add_bag(parser)
    parser.add_argument('--rate', type=float, default=1.0, metavar='R',
                        help='speed, 1 by default; 2 is twice as fast')
    parser.add_argument('--delay', type=float, default=1.0, metavar='S',
                        help='time to wait for subscribers first, 1 by default [s]')


def run(options: argparse.Namespace) -> int:
    """Run `ctc replay`."""
    check('--rate', options.rate, 0, exclusive=True)
    check('--delay', options.delay, 0)
    from ctc_chattering.bags.repair import open_bag
    with closing(open_bag(options.bag)) as reader:
        from ctc_chattering.bags.replay import play
        count = play(reader, options.rate, options.delay)
    print(f'{count} messages')
    return 0

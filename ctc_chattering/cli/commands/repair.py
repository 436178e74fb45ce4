"""`ctc repair`: a complete bag of a damaged one."""

from __future__ import annotations

import argparse

from ctc_chattering.cli.options import add_bag as add_options

__all__ = ['DETAILS', 'add_options', 'run']

DETAILS = 'Every tool reads it then; what was there is kept beside it.'


def run(options: argparse.Namespace) -> int:
    """Run `ctc repair`."""
    from ctc_chattering.bags.repair import repair

    done = repair(options.bag)
    print(f'{options.bag}: '
          + (f'{done[0]}; the damaged bag is now {done[1]}' if done else 'nothing to repair'))
    return 0

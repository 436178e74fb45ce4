"""`ctc parameters`: all parameters of all nodes."""

from __future__ import annotations

import argparse

from ctc_chattering.configuration.node_parameters import parameter_table

DETAILS = 'As a Markdown table.'


def add_options(_parser: argparse.ArgumentParser) -> None:
    """Add no option."""


def run(_options: argparse.Namespace) -> int:
    """Run `ctc parameters`."""
    print(parameter_table())
    return 0

"""Tables on a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from ctc_chattering.analysis.output import columns


def print_columns(rows: Sequence[Sequence[str]]) -> None:
    """Print rows of as many cells each, in columns."""
    print('\n'.join(columns(rows)))

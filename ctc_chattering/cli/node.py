"""
The nodes' executables: signals are taken before anything else is imported.

Importing ROS takes a good part of a second, in which SIGINT would end in a traceback.
"""

from __future__ import annotations

from collections.abc import Sequence
import importlib
import sys

from ctc_chattering import signals


def main(name: str, argv: Sequence[str] | None = None) -> int:
    """
    Run a node.

    Parameters
    ----------
    name : str
        Name of its module in `ctc_chattering.nodes`.
    argv : sequence of str, optional
        Arguments, with the program's name first; those of the process by default.

    Returns
    -------
    int
        Exit status.

    """
    stop = signals.collect()
    module = importlib.import_module(f'ctc_chattering.nodes.{name}')
    if stop:
        return 0
    runtime = importlib.import_module('ctc_chattering.nodes.runtime')
    return int(runtime.run(module.NODE, name, argv, stop))


def plant() -> int:
    """Run the plant."""
    return main('plant')


def controller() -> int:
    """Run the controller."""
    return main('controller')


def reference() -> int:
    """Run the reference."""
    return main('reference')


def recorder() -> int:
    """Run the recorder."""
    return main('recorder')


if __name__ == '__main__':
    sys.exit(main(sys.argv[1], sys.argv[1:]))

"""Parameter files for users of the package: by path, or by the name of one of its own."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ctc_chattering.arguments import check_type, checked
from ctc_chattering.configuration.node_parameters import NODES
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.configuration.parameter_file import EVERY_NODE, load, Overrides, Setup
from ctc_chattering.errors import ParameterError


@checked(path=(str, Path), overrides=(Mapping, type(None)))
def load_parameters(path: str | Path, overrides: Overrides | None = None) -> Setup:
    """
    Return the configurations of plant, controller and reference, and the events, of a file.

    Parameters
    ----------
    path : str or Path
        A file, or ``friction``, ``disturbance``, … for the package's own.
    overrides : mapping, optional
        Values by node and parameter that override the file's.

    Raises
    ------
    CtcError
        If the file cannot be read, or something in it is not allowed.

    """
    for node, values in (overrides or {}).items():
        if node not in (*NODES, EVERY_NODE):
            raise ParameterError('overrides', node, ' | '.join((*NODES, EVERY_NODE)))
        check_type(f'overrides of {node}', values, Mapping)
    return load(find_config(path) if isinstance(path, str) else path, overrides)

"""The laws by name: law ``NAME`` is the class `LAW` of the module ``control/laws/NAME.py``."""

from __future__ import annotations

from importlib import import_module

from ctc_chattering.control.controller_config import LAWS
from ctc_chattering.control.error_filter import ErrorFilter
from ctc_chattering.control.laws.base import Law


def law_class(name: str) -> type[Law]:
    """Return the class of a law, one of `LAWS`."""
    kind: type[Law] = import_module(f'ctc_chattering.control.laws.{name}').LAW
    return kind


def make_laws(filter_: ErrorFilter) -> dict[str, Law]:
    """Return every law by name; they share the filter (3)."""
    return {name: law_class(name)(filter_) for name in LAWS}

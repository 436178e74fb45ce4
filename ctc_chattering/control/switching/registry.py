"""
The switchings by name: ``NAME`` is the class `SWITCHING` of ``control/switching/NAME.py``.

A switching of your own is a class of the same form (`switching.base`), ``package.module:Name``.
"""

from __future__ import annotations

from typing import cast

from ctc_chattering.control.own_class import named_class
from ctc_chattering.control.switching.base import Switching


def switching_class(name: str) -> type[Switching]:
    """Return the class of a switching: one of `SWITCHINGS`, or ``package.module:Name``."""
    own = name if ':' in name else f'ctc_chattering.control.switching.{name}:SWITCHING'
    return cast('type[Switching]', named_class('switching', own))

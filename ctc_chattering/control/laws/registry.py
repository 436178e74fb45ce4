"""
The laws by name: law ``NAME`` is the class `LAW` of the module ``control/laws/NAME.py``.

A law of your own is a class of the same form (`laws.base`), named ``package.module:Name``.
"""

from __future__ import annotations

from typing import cast

from ctc_chattering.control.laws.base import Law
from ctc_chattering.control.own_class import named_class


def law_class(name: str) -> type[Law]:
    """Return the class of a law: one of `LAWS`, or ``package.module:Name``."""
    own = name if ':' in name else f'ctc_chattering.control.laws.{name}:LAW'
    return cast('type[Law]', named_class('law', own))

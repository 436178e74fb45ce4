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

"""
The switchings by name: ``NAME`` is the class `SWITCHING` of ``control/switching/NAME.py``.

A switching of your own is a class of the same form (`switching.base`), ``package.module:Name``.
"""

from __future__ import annotations

from typing import cast

from ctc_chattering.control.switching.base import Switching
from ctc_chattering.numerics.compilable import RECORDS
from ctc_chattering.parameters import named_class


def switching_class(name: str) -> type[Switching]:
    """Return the class of a switching: one of `SWITCHINGS`, or ``package.module:Name``."""
    own = name if ':' in name else f'ctc_chattering.control.switching.{name}:SWITCHING'
    return cast('type[Switching]', named_class(
        'switching', own, lambda x: x in RECORDS and hasattr(x, 'term'),
        'class marked by @switching'))

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

"""Laws and switchings that a parameter names as ``package.module:Name``."""

from __future__ import annotations

import importlib
from typing import Any

from ctc_chattering.errors import CtcError, refused_as
from ctc_chattering.numerics.compilable import RECORDS


def named_class(what: str, name: str) -> Any:
    """Return the class ``package.module:Name``, which must be marked as `what` says."""
    module, _, attribute = name.partition(':')
    with refused_as(f'there is no {what} {name}'):
        found = getattr(importlib.import_module(module), attribute)
    if found not in RECORDS or not hasattr(found, {'law': 'answer', 'switching': 'term'}[what]):
        raise CtcError(f'the {what} {name} is not marked by @{what}')
    return found

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
The laws by name: law ``NAME`` is the class `LAW` of the module ``control/laws/NAME.py``.

A law of your own is a class of the same form (`laws.base`), named ``package.module:Name``.
"""

from __future__ import annotations

from typing import cast

from ctc_chattering.arguments import checked
from ctc_chattering.control.controller_config import ControllerConfig, LAWS
from ctc_chattering.control.laws.base import Law
from ctc_chattering.numerics.compilable import RECORDS
from ctc_chattering.parameters import named_class, Parameter


def law_class(name: str) -> type[Law]:
    """Return the class of a law: one of `LAWS`, or ``package.module:Name``."""
    own = name if ':' in name else f'ctc_chattering.control.laws.{name}:LAW'
    return cast('type[Law]', named_class(
        'law', own, lambda x: x in RECORDS and hasattr(x, 'answer'), 'class marked by @law'))


@checked()
def laws() -> dict[str, tuple[Parameter, ...]]:
    """
    Return the laws by name, with the parameters of `ControllerConfig` that are theirs.

    Returns
    -------
    dict of str to tuple of Parameter
        Each with ``name``, ``default``, ``unit``, ``description`` and ``allowed``. A law of your
        own (`law`) takes them all.

    Examples
    --------
    >>> from ctc_chattering import laws
    >>> for x in laws()['super_twisting']:
    ...     print(f'{x.name} {x.default} {x.unit}'.strip())
    kp 100.0 1/s^2
    kv 50.0 1/s
    lambda 10.0 1/s
    b 1.0
    super_twisting_k1 60.0 sqrt(rad/s^3)
    super_twisting_k2 2000.0 rad/s^3
    anti_windup True

    """
    known = ControllerConfig.parameters().values()
    return {name: tuple(x for x in known if x.name in ('kp', 'kv') or name in x.laws)
            for name in LAWS}

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
Names and classes of laws and switchings.

It also has the parameters that laws take.

`ControllerConfig` asks here, so nothing here imports a law before a name is looked up. A name is
one of `LAWS` or `SWITCHINGS`, or ``package.module:Name`` for a class of the user's.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from ctc_chattering.compiled.compilable import RECORDS
from ctc_chattering.parameters import named_class

#: Values of the parameter ``law``, besides classes; each is a module of this folder.
LAWS = ('compensation', 'chattering', 'integral', 'momentum_observer', 'super_twisting',
        'slotine_li', 'friction_feedforward', 'pd_gravity', 'pid_kalman',
        'extended_state_observer', 'observer_feedback')
#: Values of the parameter ``switching``, besides classes; all are in `control/switching.py`.
SWITCHINGS = ('sign', 'boundary_layer', 'implicit', 'implicit_observer')
#: Parameters of law (6) that one of its switchings takes.
OF_SWITCHING = {'boundary_layer': 'boundary_layer', 'observer_bandwidth': 'implicit_observer'}
#: The law to which comparisons, maps and pages relate others: nothing in it fights friction.
BASELINE_LAW = 'compensation'
#: Parameters that every law takes, and that are its gains.
COMMON_GAINS = ('kp', 'kv')


def law_class(name: str) -> Any:
    """
    Return the class of a law.

    It has what `laws.base.Law` has.
    """
    return _marked_class('law', name, f'ctc_chattering.control.laws.{name}', 'answer')


def switchings_of(law: str) -> tuple[str, ...]:
    """Return the switchings that a law can have."""
    return SWITCHINGS if 'switching' in (law_class(law).parameters or ()) else ()


def switching_class(name: str) -> Any:
    """
    Return the class of a switching.

    It has what `control.switching.Switching` has.
    """
    return _marked_class('switching', name, 'ctc_chattering.control.switching', 'term')


def _marked_class(decorator: str, name: str, module: str, method: str) -> Any:
    """
    Return the class `name`.

    A class of the package has its name in CamelCase.
    """
    path = name
    if ':' not in name:
        class_name = name.title().replace('_', '')
        path = f'{module}:{class_name}'
    return named_class(
        decorator,
        path,
        lambda x: x in RECORDS and hasattr(x, method),
        f'class marked by @{decorator}')


@cache
def laws_by_parameter() -> dict[str, tuple[str, ...]]:
    """Return the laws that declare each parameter."""
    takers: dict[str, tuple[str, ...]] = {}
    for law in LAWS:
        for name in law_class(law).parameters or ():
            takers[name] = (*takers.get(name, ()), law)
    return takers


def takes(law: str, parameter: str) -> bool:
    """
    Return whether a law takes a parameter.

    A law that declares none takes all.
    """
    if parameter not in laws_by_parameter():
        return True
    declared = law_class(law).parameters
    return declared is None or parameter in declared

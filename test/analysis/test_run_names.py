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

"""Names and colours: whatever several runs differ in, they can be told apart."""

from __future__ import annotations

import dataclasses
from typing import Any

from ctc_chattering.analysis.result import Result
from ctc_chattering.analysis.run_names import colours, gains, LAW_COLOURS, names
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.simulation.closed_loop import Run
import numpy as np


def run(source: str = '', **values: Any) -> Result:
    config = dataclasses.replace(ControllerConfig(), **values)
    return Result('trial', [(0.0, config)], Run(np.zeros(1), *[np.zeros((1, 2))] * 7),
                  source=source)


def test_what_differs_is_named() -> None:
    assert names([run(), run(law='compensation'), run(switching='implicit')]) == [
        'trial: chattering', 'trial: compensation', 'trial: chattering (implicit)']
    assert names([run(ka=(8.0, 8.0)), run(ka=(8.0, 9.0), kp=(50.0, 50.0))]) == [
        'trial: chattering, Ka 8, Kp 100', 'trial: chattering, Ka 8/9, Kp 50']
    assert names([run('a'), run('b')]) == ['trial: chattering, bag a', 'trial: chattering, bag b']
    assert names([run('a')]) == ['trial: chattering']


def test_names_are_all_different() -> None:
    results = [run(), run(), run('a'), run('a'), run('a', ka=(1.0, 1.0)), run(b=2.0)]
    assert len(set(names(results))) == len(results)


def test_switchings_that_change() -> None:
    base = run()
    kinds = ('sign', 'implicit', 'implicit_observer')
    configs = [(0.1 * k, ControllerConfig(switching=kind)) for k, kind in enumerate(kinds)]
    assert names([dataclasses.replace(base, configs=configs[:2]),
                  dataclasses.replace(base, configs=configs)]) == [
        'trial: chattering (sign → implicit)', 'trial: chattering (several switchings)']


def test_colours_differ_within_an_experiment() -> None:
    results = [run(), run(law='compensation'), run('a'), run('b')]
    found = colours([*results, dataclasses.replace(results[0], experiment='other')])
    assert found[:2] == [LAW_COLOURS['chattering'], LAW_COLOURS['compensation']]
    assert len(set(found[:4])) == 4
    assert not {*found[2:4]} & {*LAW_COLOURS.values()}  # Shades, no other law's colour.
    assert found[4] == found[0]


def test_gains_on_a_line() -> None:
    assert gains(run(switching='implicit_observer', ka=(8.0, 9.0))) == (
        'Kp 100, Kv 50, Ka 8/9, λ 10, b 1, bandwidth 200, h 1 ms')
    assert 'Ka' not in gains(run(law='compensation'))

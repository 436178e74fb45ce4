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

"""Names and colours by which runs are told apart."""

from __future__ import annotations

import dataclasses
from typing import Any

from ctc_chattering.analysis.result import Result
from ctc_chattering.analysis.run_names import gains_text, LAW_COLOURS, name_runs, run_names
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.simulation.closed_loop import Run
import numpy as np


def run(source: str = '', **values: Any) -> Result:
    config = dataclasses.replace(ControllerConfig(), **values)
    made = Run(np.zeros(1), *[np.zeros((1, 2))] * 7)
    return Result('trial', [(0.0, config)], made, source=source)


def names(results: list[Result]) -> list[str]:
    return [str(name) for name in run_names(results)]


def test_names_tell_runs_apart() -> None:
    assert names([run(), run(law='compensation'), run(switching='implicit')]) == [
        'trial: chattering', 'trial: compensation', 'trial: chattering (implicit)']
    assert names([run(ka=(8.0, 8.0)), run(ka=(8.0, 9.0), kp=(50.0, 50.0))]) == [
        'trial: chattering, kp 100, ka 8', 'trial: chattering, kp 50, ka 8/9']
    assert names([run('a'), run('b')]) == [
        'trial: chattering, bag a', 'trial: chattering, bag b']
    assert names([run('a')]) == ['trial: chattering']
    kinds = ('sign', 'implicit', 'implicit_observer')
    configs = [(0.1 * k, ControllerConfig(switching=kind)) for k, kind in enumerate(kinds)]
    assert names([dataclasses.replace(run(), configs=configs[:k]) for k in (2, 3)]) == [
        'trial: chattering (sign → implicit)', 'trial: chattering (several switchings)']
    results = [run(), run(), run('a'), run('a'), run('a', ka=(1.0, 1.0)), run(b=2.0)]
    assert len(set(names(results))) == len(results)


def test_colours_differ_within_an_experiment() -> None:
    results = [run(), run(law='compensation'), run('a'), run('b')]
    others = [*results, dataclasses.replace(results[0], experiment='other')]
    colours = [x.colour for x in name_runs(others)]
    assert colours[:2] == [LAW_COLOURS['chattering'], LAW_COLOURS['compensation']]
    assert len(set(colours[:4])) == 4
    assert not {*colours[2:4]} & {*LAW_COLOURS.values()}  # Shades, no other law's colour.
    assert colours[4] == colours[0]


def test_gains_on_a_line() -> None:
    assert gains_text(run(switching='implicit_observer', ka=(8.0, 9.0))) == (
        'kp 100, kv 50, ka 8/9, lambda 10, b 1, observer_bandwidth 200, control_period 0.001')
    assert 'ka' not in gains_text(run(law='compensation'))

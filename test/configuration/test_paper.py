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

"""The list of the paper's experiments."""

from __future__ import annotations

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.package_share import EXPERIMENTS, find_config
from ctc_chattering.simulation.closed_loop import Event


def test_all_figures_and_the_switch() -> None:
    """Check both laws of both experiments, and the switch from one to the other at 5 s."""
    setups = {name: parameter_file.load(find_config(file), {'controller': values})
              for name, (file, values) in EXPERIMENTS.items()}
    assert len(setups) == len(EXPERIMENTS) == 6
    observer = setups['friction_chattering_implicit_observer'].controller
    assert (observer.law, observer.switching, observer.ka) == (
        'chattering', 'implicit_observer', (12.0, 12.0))
    others = [s.controller for name, s in setups.items() if 'observer' not in name]
    assert {(c.switching, c.ka) for c in others} == {('sign', (10.0, 10.0))}
    assert {(s.plant.experiment, s.controller.law) for s in setups.values()} == {
        ('friction', 'compensation'), ('friction', 'chattering'),
        ('disturbance', 'compensation'), ('disturbance', 'chattering'),
        ('switch', 'compensation')}
    for name, setup in setups.items():
        expected = (Event(5.0, 'controller', {'law': 'chattering'}),) if name == 'switch' else ()
        assert setup.events == expected
        assert (setup.plant.pacing, setup.plant.duration) == ('lockstep', 10.0)


def test_names_are_plain_file_names() -> None:
    assert all(name.replace('_', '').isalnum() for name in EXPERIMENTS)

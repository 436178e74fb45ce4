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

import math

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
        c, p, r = setup.controller, setup.plant, setup.reference
        assert (setup.events, p.pacing, p.duration) == (expected, 'lockstep', 10.0)
        # Section 4, number by number.
        assert (c.kp, c.kv, c.lambda_, c.b) == ((100, 100), (50, 50), 10, 1)
        assert (p.coulomb_friction, p.gravity) == ((9.9, 9.9), 9.81)
        assert p.disturbance_frequency == (1, 2)
        assert p.disturbance_amplitude == ((1, 1) if p.experiment == 'disturbance' else (0, 0))
        assert (p.initial_position, p.initial_velocity) == ((0, 0), (0, 0))
        assert (r.center, r.amplitude) == ((math.pi, math.pi / 2), (0.5, 0.5))
        assert (r.frequency, r.phase) == ((1, 1), (0, 0))
        assert c.control_period == p.control_period == r.control_period == 0.001
        assert c.effort_limit == p.torque_saturation

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

"""Every switching over a real graph, and the change between any two of them while running."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path

from ctc_chattering.analysis.result import simulate
from ctc_chattering.analysis.terms import terms
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.configuration import parameter_file
from ctc_chattering.control.controller import LAWS
from ctc_chattering.control.controller_config import SWITCHINGS
from ctc_chattering.simulation import closed_loop
import numpy as np
from processes import run_bringup
import pytest

pytestmark = pytest.mark.ros
FIELDS = ('t', 'q', 'dq', 'q_d', 'dq_d', 'tau', 'v')
PLAIN = """
plant:
  ros__parameters: {{pacing: lockstep, duration: {duration}}}
controller:
  ros__parameters: {{ka: [12.0, 12.0], switching: {switching}}}
bringup:
  ros__parameters:
    events: {events}
"""


def tour() -> list[str]:
    """Return switchings in an order in which each follows each other one exactly once."""
    left = set(itertools.permutations(SWITCHINGS, 2))

    def walk(path: list[str]) -> list[str] | None:
        if not left:
            return path
        for step in sorted(left):
            if step[0] == path[-1]:
                left.remove(step)
                found = walk([*path, step[1]])
                if found:
                    return found
                left.add(step)
        return None

    path = walk([SWITCHINGS[0]])
    assert path is not None and len(path) == 13
    return path


@pytest.mark.slow
def test_any_two_are_exchanged_without_a_bump(tmp_path: Path) -> None:
    """At the sample of a change nothing differs from the run without it but the term itself."""
    first, *others = tour()
    times = [0.1 + 0.03 * i for i in range(len(others))]
    file = tmp_path / 'params.yaml'
    file.write_text(PLAIN.format(duration=0.5, switching=first, events=[
        f'{t:.3f} controller switching {name}' for t, name in zip(times, others)]))
    status, output = run_bringup('--params-file', str(file), '--record', str(tmp_path / 'bag'))
    assert status == 0, output
    result = read_bag(tmp_path / 'bag')
    setup = parameter_file.load(file)
    expected = simulate(setup)
    for field in FIELDS:
        assert np.array_equal(getattr(result.run, field), getattr(expected.run, field)), field
    assert [config.switching for _, config in result.configs] == [first, *others]
    assert (np.abs(result.terms.robust) <= 12.0).all()
    rest = result.run.tau + result.terms.robust
    for i, event in enumerate(setup.events):
        k = int(np.flatnonzero(result.run.t >= event.time - 1e-12)[0])
        plant = dataclasses.replace(setup.plant, duration=event.time)
        without = closed_loop.simulate(plant, setup.controller, setup.reference, setup.events[:i])
        assert np.array_equal(result.run.v[k], without.v[k])
        assert np.array_equal(result.run.q[k], without.q[k])
        other = terms(without, [(0.0, setup.controller), *result.configs[1:i + 1]])
        assert rest[k] == pytest.approx(other.tau[k] + other.robust[k], rel=1e-12)


def test_every_law_one_after_another(tmp_path: Path) -> None:
    """
    The law changes every 50 ms; the graph equals the simulation to the last bit.

    Both are plain: what other tests compile meanwhile, a node would take law by law.
    """
    file = tmp_path / 'params.yaml'
    events = [f'{0.05 * k:.2f} controller law {law}' for k, law in enumerate(LAWS[1:], 1)]
    file.write_text(f"""
plant:
  ros__parameters: {{pacing: lockstep, duration: 0.52, compiled: false,
    actuator_lag: [0.002, 0.002], encoder_resolution: [1.0e-5, 1.0e-5],
    initial_position: [3.14159, 1.5708]}}
controller:
  ros__parameters: {{law: {LAWS[0]}, compiled: false, switching: implicit_observer,
    ka: [60.0, 30.0], actuator_lag: [0.002, 0.002], friction_level: [9.0, 9.0]}}
bringup:
  ros__parameters:
    events: {events}
""")
    status, output = run_bringup('--params-file', str(file), '--record', str(tmp_path / 'bag'))
    assert status == 0, output
    result, expected = read_bag(tmp_path / 'bag'), simulate(parameter_file.load(file))
    assert [config.law for _, config in result.configs] == list(LAWS)
    for field in FIELDS:
        assert np.array_equal(getattr(result.run, field), getattr(expected.run, field)), field


@pytest.mark.parametrize(
    'switching', [pytest.param('sign', marks=pytest.mark.slow), 'implicit_observer'])
def test_with_every_imperfection_the_graph_equals_the_simulation(
        switching: str, tmp_path: Path) -> None:
    file = tmp_path / 'params.yaml'
    file.write_text(f"""
plant:
  ros__parameters: {{pacing: lockstep, duration: 0.4, velocity_noise: [0.005, 0.004],
    position_noise: [1.0e-5, 0.0], encoder_resolution: [0.0, 1.0e-4], noise_seed: 7,
    input_delay: 2, torque_saturation: [900.0, 150.0], viscous_friction: [0.5, 0.2],
    stribeck_friction: [1.0, 0.5], load_friction: [0.02, 0.01],
    friction_asymmetry: [0.1, -0.2], actuator_lag: [0.002, 0.001],
    torque_rate_limit: [.inf, 100000.0], torque_resolution: [0.0, 0.01],
    joint_stiffness: [.inf, 5000.0], motor_inertia: [0.0, 0.1], joint_damping: [0.0, 5.0],
    velocity_sensor: filtered, velocity_cutoff: 900.0, sample_loss: 0.1, late_samples: 0.1}}
controller:
  ros__parameters: {{ka: [12.0, 12.0], switching: {switching}, input_delay: 2,
    inertia_scale: 0.95, gravity_scale: 1.05}}
bringup:
  ros__parameters:
    events: ['0.2 controller ka [13.0, 13.0]', '0.25 plant sample_loss 0.4',
             '0.3 plant friction_asymmetry [0.0, 0.1]']
""")
    status, output = run_bringup('--params-file', str(file), '--record', str(tmp_path / 'bag'))
    assert status == 0, output
    result, expected = read_bag(tmp_path / 'bag'), simulate(parameter_file.load(file))
    assert 300 < len(result.run.t) < 380
    assert result.metrics() == {**expected.metrics(), 'bag': 'bag'}
    for field in FIELDS:
        assert np.array_equal(getattr(result.run, field), getattr(expected.run, field)), field


@pytest.mark.slow
def test_in_real_time_the_torque_hardly_varies(tmp_path: Path) -> None:
    """At 1 kHz on the clock, joint 2 varies less than a tenth of what it does with `sign`."""
    variation = {}
    for switching in ('sign', 'implicit_observer'):
        file, bag = tmp_path / f'{switching}.yaml', tmp_path / switching
        file.write_text(PLAIN.format(duration=10.0, switching=switching, events=[]).replace(
            'lockstep', 'real_time').replace('    events: []', '    events: [""]'))
        status, output = run_bringup('--params-file', str(file), '--record', str(bag))
        assert status == 0, output
        variation[switching] = read_bag(bag).metrics()['torque_variation_nm_per_s']
    assert 10.0 * variation['implicit_observer'][1] < variation['sign'][1]
    assert variation['implicit_observer'][0] < variation['sign'][0]

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

"""How long a torque may be held: the loop is stopped at random, as on a computer that is busy."""

from pathlib import Path
import random

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.controller import Controller
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.trajectory.reference import make_motion
import numpy as np
import pytest

FILE = Path(__file__).resolve().parents[2] / 'config' / 'friction.yaml'
UNLIMITED = {'plant': {'torque_saturation': [float('inf')] * 2},
             'controller': {'effort_limit': [float('inf')] * 2}}
MS = 1_000_000


def stopped_at_random(setup: Setup, timeout: float) -> tuple[float, float, float]:
    """
    Run for 2 s, then for 6 s in which the loop stands still for up to 0.1 s at a time, then 3 s.

    Returns
    -------
    tuple of float
        Largest |q_d - q| [rad] and |dq| [rad/s] while it is stopped, and |q_d - q| at the end.

    """
    plant, law = Plant(setup.plant), Controller(setup.controller)
    motion, dice = make_motion(setup.reference), random.Random(0)
    errors: list[float] = []
    speeds: list[float] = []

    def go(samples: int) -> None:
        for _ in range(samples):
            plant.step(law.step(plant.q, plant.dq, *motion.at(plant.k * MS)).tau)

    go(2000)
    while plant.k < 8_000:
        go(dice.randint(1, 5))
        tau, stop = plant.applied, dice.randint(0, 100)
        for i in range(stop):
            plant.brake(i >= round(timeout * 1000))
            plant.step((0.0, 0.0) if plant.braking else tau)
            errors.append(np.abs(np.subtract(motion.at(plant.k * MS)[0], plant.q)).max())
            speeds.append(np.abs(plant.dq).max())
        plant.brake(False)
        if stop > 20:
            law.reset(bumpless=True)
    go(3000)
    return max(errors), max(speeds), float(
        np.abs(np.subtract(motion.at(plant.k * MS)[0], plant.q)).max())


def test_with_the_defaults_the_motion_stays_bounded_and_recovers() -> None:
    """Check this with the drives' limits of the paper's file, and without any."""
    for overrides in ({}, UNLIMITED):
        setup = parameter_file.load(FILE, overrides)
        error, speed, end = stopped_at_random(setup, setup.values['plant']['command_timeout'])
        assert error < 1.0
        assert speed < 8.0
        assert end < 5e-3


def test_a_torque_held_for_five_times_the_time_constant_runs_away() -> None:
    """Kv = 50/s: held for 0.1 s, M Kv de turns de into -4 de, the next time into 16 de."""
    with pytest.raises(CtcError, match=r'diverged at t = .* s, under a torque|is not finite'):
        stopped_at_random(parameter_file.load(FILE, UNLIMITED), 0.1)
    error, speed, _ = stopped_at_random(parameter_file.load(FILE), 0.1)
    assert 1.0 < error < 100.0
    assert 8.0 < speed < 1000.0

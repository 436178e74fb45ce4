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

"""Samples that are lost and torques that come late: statistics, seeds, and the law beside them."""

from __future__ import annotations

from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.simulation import closed_loop
from ctc_chattering.simulation.closed_loop import Run
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig
import numpy as np
from oracles import Masses
import pytest

LAW = ControllerConfig(ka=(12.0, 12.0), switching='implicit_observer')


def run_of(**plant: Any) -> Run:
    return closed_loop.run_closed_loop(PlantConfig(duration=1.0, **plant), LAW, ReferenceConfig())


def same(one: Run, other: Run) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(vars(one).values(), vars(other).values()))


def test_how_many_samples_are_lost() -> None:
    """
    Check the share within 5 sigma, that of no more than two in a row: first and last are there.

    From one that is sent to the next, 0, 1 or 2 are lost with 1 - p, p (1 - p) and p².
    """
    count, probability = 2_000, 0.2
    plant = Plant(PlantConfig(duration=1e-3 * count, sample_loss=probability, noise_seed=3,
                              coulomb_friction=(0.0, 0.0)), Masses([[1.0, 0.0], [0.0, 1.0]]))
    sent = [0]
    for k in range(1, count + 1):
        plant.step([0.0, 0.0])
        if not plant.lost:
            sent.append(k)
    gaps = np.diff(sent) - 1
    assert sent[-1] == count
    for lost, expected in ((0, 1.0 - probability), (1, probability * (1.0 - probability)),
                           (2, probability ** 2)):
        sigma = np.sqrt(expected * (1.0 - expected) / len(gaps))
        assert (gaps == lost).mean() == pytest.approx(expected, abs=5.0 * sigma)
    assert gaps.max() == 2


def test_the_last_sample_is_there() -> None:
    for seed in range(20):
        plant = Plant(PlantConfig(duration=0.003, sample_loss=0.5, noise_seed=seed))
        for _ in range(3):
            plant.step([0.0, 0.0])
        assert not plant.lost


def test_irregular_samples_are_of_their_stamps() -> None:
    """In free motion positions, and velocities that are differences of them, have closed forms."""
    most, start, speed = 4e-4, np.array([0.1, -0.2]), np.array([0.5, -3.0])
    plant = Plant(PlantConfig(
        sample_jitter=most, coulomb_friction=(0.0, 0.0), initial_position=tuple(start),
        initial_velocity=tuple(speed), velocity_sensor='difference'),
        Masses([[1.0, 0.0], [0.0, 1.0]]))
    early = []
    for k in range(1, 501):
        plant.step([0.0, 0.0])
        t, (q, dq) = 1e-9 * plant.stamp, plant.measured
        early.append((t - 1e-3 * k) / most)
        assert q == pytest.approx(start + speed * t, abs=1e-9)
        assert dq == pytest.approx(speed, abs=1e-9)
    # Evenly between both ends.
    assert np.sort(early) == pytest.approx(np.linspace(-1.0, 1.0, 500), abs=0.15)


def test_a_lost_sample_holds_the_torque_and_the_law() -> None:
    """Check a run against a loop by hand that steps the law at the samples of the run only."""
    run = run_of(sample_loss=0.2, noise_seed=1)
    assert 700 < len(run.t) < 900
    sent = set(np.rint(run.t * 1e3).astype(int).tolist())
    plant, law, motion = Plant(PlantConfig()), Controller(LAW), make_motion(ReferenceConfig())
    states, taus = [], []
    for k in range(1001):
        if k in sent:
            tau = law.step(plant.q, plant.dq, *motion.at(k * 1_000_000), t=k * 1_000_000).tau
            states.append([*plant.q, *plant.dq])
            taus.append(tau)
        plant.step(tau)
    assert np.array_equal(np.hstack([run.q, run.dq]), states)
    assert np.array_equal(run.tau, taus)


def test_every_torque_late_is_a_delay_of_one_sample() -> None:
    """Check bit for bit; and that some late torques are neither that nor none."""
    late, delayed, some, none = (run_of(**values) for values in (
        {'late_samples': 1.0}, {'input_delay': 1}, {'late_samples': 0.5}, {}))
    assert same(late, delayed)
    assert not same(some, late)
    assert not same(some, none)


def test_seeds_and_that_nothing_else_is_drawn() -> None:
    """Check that the same seed gives the same run, another another; and the noise stays."""
    lossy: dict[str, Any] = {'sample_loss': 0.1, 'late_samples': 0.1}
    assert same(run_of(**lossy), run_of(**lossy))
    assert len(run_of(**lossy).t) != len(run_of(noise_seed=1, **lossy).t)
    plants = [Plant(PlantConfig(velocity_noise=(1e-3, 1e-3), **values))
              for values in ({}, lossy)]
    for _ in range(50):
        for plant in plants:
            plant.step([0.0, 0.0])
        assert plants[0].measured == plants[1].measured

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

"""The known input delay: the predicted state, and the law for it."""

from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.simulation.closed_loop import run_closed_loop
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
import numpy as np
from oracles import Array, Masses
import pytest

H = 1e-3
MASS = np.array([[2.0, 0.7], [0.7, 0.5]])
Row = tuple[list[float], list[float], list[float]]


def _desired(k: int) -> Row:
    t, w = k * H, np.array([3.0, 5.0])
    return (np.sin(w * t).tolist(), (w * np.cos(w * t)).tolist(),
            (-w * w * np.sin(w * t)).tolist())


def _law(delay: int, switching: str) -> Controller:
    return Controller(ControllerConfig(
        switching=switching, input_delay=delay, ka=(5.0, 5.0)), Masses(MASS.tolist()))


def _move(q: Array, dq: Array, tau: Array) -> tuple[Array, Array]:
    """Return the state a period later: two coupled masses in closed form."""
    a = np.linalg.solve(MASS, tau)
    return q + H * dq + H * H / 2 * a, dq + H * a


@pytest.mark.parametrize(('switching', 'd'), [('boundary_layer', 1), ('implicit', 5)])
def test_the_torque_is_the_undelayed_law_of_the_state_d_samples_later(
        switching: str, d: int) -> None:
    """
    Check tau of every sample where the prediction is exact: on two masses without gravity.

    The undelayed law watches the same motion, its first d torques not being applied.
    """
    late, prompt = _law(d, switching), _law(0, switching)
    start = np.array([0.1, -0.1]), np.array([3.3, 4.0])
    (q, dq), sent = start, []
    for k in range(600):
        ahead = [_desired(k + j) for j in range(1, d + 1)]
        sample = late.step(q.tolist(), dq.tolist(), *_desired(k), ahead)
        seen = prompt.step(q.tolist(), dq.tolist(), *_desired(k))
        sent.append(np.array(sample.tau))
        assert sample.v == seen.v
        if k >= d:
            np.testing.assert_allclose(sent[k - d], seen.tau, atol=1e-6)
        q, dq = _move(q, dq, sent[k - d] if k >= d else np.zeros(2))
    assert np.abs(sample.v).max() < 1e-3
    assert np.abs(np.subtract(sent[-1], sent[-1 - d])).max() > 0.05


def test_points_ahead_may_be_arrays() -> None:
    """A node passes tuples, the simulation rows of a table."""
    first, second = _law(2, 'implicit'), _law(2, 'implicit')
    for k in range(3):
        ahead = [_desired(k + j) for j in (1, 2)]
        state = [0.1, 0.2], [0.0, 0.0]
        sample = first.step(*state, *_desired(k), ahead)
        arrays: list[Any] = [np.array(point) for point in ahead]
        assert second.step(*state, *_desired(k), arrays) == sample


@pytest.mark.parametrize(('switching', 'bound', 'factor'), [
    ('implicit_observer', 3e-4, 250.0), ('sign', 2.1e-2, 4.5)])
def test_prediction_helps(switching: str, bound: float, factor: float) -> None:
    """
    Check |v| of the arm with a delay of 3 samples; unpredicted, it is worse by a factor.

    The observer's estimate is d samples old when it is used, which adds d h² M⁻¹ dP/dt.
    """
    known, unknown = (np.abs(run_closed_loop(
        PlantConfig(duration=2.2, input_delay=3, coulomb_friction=(0.0, 0.0)),
        ControllerConfig(switching=switching, input_delay=d), ReferenceConfig()).v[1500:]).max()
        for d in (3, 0))
    assert known < bound
    assert unknown > factor * known


def test_the_estimate_is_part_of_the_prediction() -> None:
    """Check v = 0 under a constant force and a delay; `implicit` rests beside it, at h M⁻¹ F."""
    force, ends, d = np.array([3.0, -2.0]), {}, 3
    for switching in ('implicit', 'implicit_observer'):
        law = _law(d, switching)
        q, dq, coming = np.zeros(2), np.zeros(2), [np.zeros(2)] * d
        rest = ([0.0, 0.0], [0.0, 0.0], [0.0, 0.0])
        for _ in range(1000):
            sample = law.step(q.tolist(), dq.tolist(), *rest, [rest] * d)
            coming.append(np.array(sample.tau))
            q, dq = _move(q, dq, coming.pop(0) - force)
        ends[switching] = np.array(sample.v)
    assert np.abs(ends['implicit_observer']).max() < 1e-8
    assert (np.abs(ends['implicit']) > 0.5 * H * np.abs(np.linalg.solve(MASS, force))).all()

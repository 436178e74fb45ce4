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

"""What the sensors make of a state: resolution, statistics, seeds."""

from random import Random
from typing import Any

from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.simulation.sensor import (
    draw_noise,
    Encoders,
    encoders_of,
    Measured,
    measured,
    measured_at_start,
)
import numpy as np
from oracles import Array
import pytest
from scipy.signal import lfilter  # type: ignore[import-untyped]


class Sensor:
    """Sensors with these parameters of the plant, and the numbers that they draw."""

    def __init__(self, seed: int, period: float = 1e-3, **parameters: Any) -> None:
        self.encoders: Encoders = encoders_of(PlantConfig(**parameters), period)
        self.random = Random(seed)

    def first(self, q: Array, dq: Array) -> Measured:
        return measured_at_start(self.encoders, self.random, q, dq)


def noisy(seed: int, position: tuple[float, float], velocity: tuple[float, float]) -> Sensor:
    return Sensor(seed, position_noise=position, velocity_noise=velocity)


def _series(sensor: Sensor, count: int) -> Array:
    """Return `count` measurements of one state, as rows q1, q2, dq1, dq2."""
    rows = series(sensor, np.tile([1.0, -2.0], (count, 1)), np.array([0.5, 3.0]))
    return np.array([[*a, *b] for a, b in rows])


def series(sensor: Sensor, q: Array, dq: Array) -> list[Measured]:
    """Return the measurements at positions, shape (N, 2), and one velocity."""
    rows, shown = [sensor.first(q[0], dq)], sensor.encoders
    for x in q[1:]:
        noise = [draw_noise(sensor.random, deviation)
                 for deviation in (shown.position_noise, shown.velocity_noise)]
        rows.append(measured(shown, rows[-1], x, dq, shown.period, *noise))
    return rows


def test_seeds() -> None:
    """Check that the same seed gives the same noise bit for bit, and another one another."""
    a, b, c = (_series(Sensor(
        seed, encoder_resolution=(0.0, 1e-4), position_noise=(1e-3, 2e-3),
        velocity_noise=(5e-3, 1e-2)), 200) for seed in (3, 3, 4))
    assert (a == b).all()
    assert (a[:, [0, 2, 3]] != c[:, [0, 2, 3]]).mean() > 0.99
    assert (a[1:, [0, 2, 3]] != a[:-1, [0, 2, 3]]).all()  # different in every sample


def test_statistics() -> None:
    """
    Check mean, deviation, independence and normality of 10000 samples within 5 sigma.

    A mean has the deviation σ / √N, a deviation σ / √(2N), a correlation 1 / √N, and the share
    within ±σ the deviation √(p (1 - p) / N) around p = 0.6827.
    """
    count, sigma = 10_000, np.array([1e-3, 3e-2, 5e-3, 0.4])
    sensor = noisy(11, (1e-3, 3e-2), (5e-3, 0.4))
    noise = (_series(sensor, count) - [1.0, -2.0, 0.5, 3.0]) / sigma
    assert np.abs(noise.mean(axis=0)).max() < 5 / np.sqrt(count)
    assert np.abs(noise.std(axis=0) - 1.0).max() < 5 / np.sqrt(2 * count)
    cross = noise.T @ noise / count - np.eye(4)
    assert np.abs(cross - np.diag(np.diag(cross))).max() < 5 / np.sqrt(count)
    assert np.abs((noise[1:] * noise[:-1]).mean(axis=0)).max() < 5 / np.sqrt(count)
    share = (np.abs(noise) < 1.0).mean(axis=0)
    assert np.abs(share - 0.6827).max() < 5 * np.sqrt(0.6827 * 0.3173 / count)


def test_resolution_rounds_to_multiples() -> None:
    """Check the nearest multiple, joint by joint, for both signs; the velocity is not rounded."""
    rng = np.random.default_rng(2)
    step = 1e-3, 2 * np.pi / 4096
    sensor = Sensor(0, encoder_resolution=step)
    for _ in range(200):
        q, dq = rng.uniform(-4.0, 4.0, 2), rng.normal(size=2)
        made, speed = sensor.first(q, dq)
        turns = np.array(made) / step
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)
        assert (np.abs(made - q) <= np.array(step) * (0.5 + 1e-9)).all()
        assert list(speed) == dq.tolist()
    one, _ = Sensor(0, encoder_resolution=(0.25, 0.0)).first(np.full(2, 0.4), np.zeros(2))
    assert list(one) == [0.5, 0.4]


@pytest.mark.parametrize('name', ['position_noise', 'velocity_noise', 'encoder_resolution'])
def test_the_plant_shows_but_does_not_feel_it(name: str) -> None:
    """Check `measured` against the true state, which is bit-equal to a perfect plant's."""
    start = {'initial_position': [0.3003, 0.1003]}
    blind, perfect = (Plant(PlantConfig.from_mapping(values)) for values in (
        {name: [1e-3, 1e-3], **start}, start))
    for _ in range(50):
        for plant in (blind, perfect):
            plant.step([30.0, -8.0])
        assert (list(blind.q), list(blind.dq)) == (list(perfect.q), list(perfect.dq))
        assert perfect.measured == (perfect.q, perfect.dq)
        off = np.abs(np.subtract(blind.measured, (blind.q, blind.dq)))
        row = 1 if name == 'velocity_noise' else 0
        assert (off[row] > 0.0).all()
        assert (off[1 - row] == 0.0).all()
        assert off.max() < 8e-3


#: Positions that wander [rad].
WALK = np.random.default_rng(4).normal(size=(300, 2)).cumsum(axis=0) * 1e-3


def test_the_difference_of_positions() -> None:
    """Check (q[k] - q[k-1]) / h of what the encoders show, and that before the start q0 - h v0."""
    h, step, start = 2e-3, 1e-4, np.array([0.7, -0.3])
    sensor = Sensor(0, h, encoder_resolution=(step, 0.0), velocity_sensor='difference')
    q = WALK[:100]
    made = series(sensor, q, start)
    shown = np.array([position for position, _ in made])
    assert shown == pytest.approx(np.stack([step * np.rint(q[:, 0] / step), q[:, 1]], axis=1))
    before = q[0] - h * start
    before[0] = step * np.rint(before[0] / step)
    assert [speed for _, speed in made] == pytest.approx(
        np.diff(np.vstack([before, shown]), axis=0) / h, abs=1e-9)


def test_the_filter_against_scipy() -> None:
    """Check y + (1 - exp(-ω h)) (x - y) of the differences, that begins where they begin."""
    h, cutoff = 1e-3, 300.0
    gain = 1.0 - np.exp(-cutoff * h)
    plain, filtered = (Sensor(
        3, h, encoder_resolution=(1e-4, 1e-4), velocity_noise=(0.1, 0.1), velocity_sensor=sensor,
        velocity_cutoff=cutoff) for sensor in ('difference', 'filtered'))
    x, y = (np.array([speed for _, speed in series(sensor, WALK, np.array([0.5, 0.0]))])
            for sensor in (plain, filtered))
    start = [(1.0 - gain) * x[0]]
    expected, _ = lfilter([gain], [1.0, gain - 1.0], x, axis=0, zi=np.array(start))
    assert y == pytest.approx(expected, abs=1e-12)
    assert y.std() < 0.7 * x.std()

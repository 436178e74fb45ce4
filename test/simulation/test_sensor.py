"""What the sensors make of a state: resolution, statistics, seeds."""

import numpy as np
from oracles import Array
import pytest

from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.simulation.sensor import Sensor

ZERO = (0.0, 0.0)


def _series(sensor: Sensor, count: int, q: tuple[float, float] = (1.0, -2.0),
            dq: tuple[float, float] = (0.5, 3.0)) -> Array:
    """Return `count` measurements of one state, as rows q1, q2, dq1, dq2."""
    rows = (sensor.measure(q, dq) for _ in range(count))
    return np.array([[*a, *b] for a, b in rows])


def test_perfect_sensors_return_the_very_state() -> None:
    """Check that without imperfections nothing is copied, drawn or rounded."""
    sensor = Sensor(ZERO, ZERO, ZERO, 7)
    q, dq = [0.1, 0.2], [0.3, 0.4]
    assert sensor.perfect
    a, b = sensor.measure(q, dq)
    assert a is q
    assert b is dq
    one = (1e-3, 0.0)
    for a, b, c in ((one, ZERO, ZERO), (ZERO, one, ZERO), (ZERO, ZERO, one)):
        assert not Sensor(a, b, c, 7).perfect


def test_seeds() -> None:
    """Check that the same seed gives the same noise bit for bit, and another one another."""
    noise = ((0.0, 1e-4), (1e-3, 2e-3), (5e-3, 1e-2))
    a, b, c = (_series(Sensor(*noise, seed), 200) for seed in (3, 3, 4))
    assert (a == b).all()
    assert (a[:, [0, 2, 3]] != c[:, [0, 2, 3]]).mean() > 0.99
    assert (a[1:, [0, 2, 3]] != a[:-1, [0, 2, 3]]).all()  # different in every sample


def test_statistics() -> None:
    """
    Check mean, deviation, independence and normality of 40000 samples within 5 sigma.

    A mean has the deviation σ / √N, a deviation σ / √(2N), a correlation 1 / √N, and the share
    within ±σ the deviation √(p (1 - p) / N) around p = 0.6827.
    """
    count, sigma = 40_000, np.array([1e-3, 3e-2, 5e-3, 0.4])
    sensor = Sensor(ZERO, (1e-3, 3e-2), (5e-3, 0.4), 11)
    noise = (_series(sensor, count) - [1.0, -2.0, 0.5, 3.0]) / sigma
    assert np.abs(noise.mean(axis=0)).max() < 5 / np.sqrt(count)
    assert np.abs(noise.std(axis=0) - 1.0).max() < 5 / np.sqrt(2 * count)
    cross = noise.T @ noise / count - np.eye(4)
    assert np.abs(cross - np.diag(np.diag(cross))).max() < 5 / np.sqrt(count)
    assert np.abs((noise[1:] * noise[:-1]).mean(axis=0)).max() < 5 / np.sqrt(count)
    share = (np.abs(noise) < 1.0).mean(axis=0)
    assert np.abs(share - 0.6827).max() < 5 * np.sqrt(0.6827 * 0.3173 / count)


def test_only_what_is_noisy_gets_noise() -> None:
    """Check joint by joint and quantity by quantity."""
    made = _series(Sensor(ZERO, (0.0, 1e-3), (1e-2, 0.0), 1), 50)
    assert (made[:, [0, 3]] == [1.0, 3.0]).all()
    assert (made[:, [1, 2]] != [-2.0, 0.5]).all()


def test_resolution_rounds_to_multiples() -> None:
    """Check the nearest multiple, joint by joint, for both signs; the velocity is not rounded."""
    rng = np.random.default_rng(2)
    sensor, step = Sensor((1e-3, 2 * np.pi / 4096), ZERO, ZERO, 0), [1e-3, 2 * np.pi / 4096]
    for _ in range(200):
        q, dq = rng.uniform(-4.0, 4.0, 2), rng.normal(size=2)
        made, speed = sensor.measure(q.tolist(), dq.tolist())
        turns = np.array(made) / step
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)
        assert (np.abs(made - q) <= np.array(step) * (0.5 + 1e-9)).all()
        assert list(speed) == dq.tolist()
    one, _ = Sensor((0.25, 0.0), ZERO, ZERO, 0).measure([0.4, 0.4], [0.0, 0.0])
    assert list(one) == [0.5, 0.4]


def test_noise_is_rounded_too() -> None:
    """Check that an encoder shows multiples of its step whatever shakes it."""
    made = _series(Sensor((0.25, 0.25), (0.3, 0.3), ZERO, 5), 300)
    assert (made[:, :2] % 0.25 == 0.0).all()
    assert len(np.unique(made[:, 0])) > 5


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


def test_a_finest_resolution_is_no_resolution() -> None:
    """Check that a step so small that it overflows the count of steps does no harm."""
    q, _ = Sensor((1e-320, 5e-324), ZERO, ZERO, 0).measure([0.4, -3.0], [0.0, 0.0])
    assert list(q) == pytest.approx([0.4, -3.0])

"""Mean, quantiles and histogram of durations, against numpy's."""

from collections.abc import Sequence

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from ctc_chattering.monitoring.durations import Durations

#: Binary fractions, so that numpy's count of samples is ours.
SHARES = (0.0, 0.25, 0.5, 0.984375, 1.0)
#: Within the range of the bins, or 0.
DURATION = st.floats(1e-6, 500.0) | st.just(0.0)
MANY = st.lists(DURATION, min_size=1, max_size=200)
#: Half a bin.
EXACT = 0.011


def _filled(*windows: Sequence[float], size: int = 10) -> Durations:
    made = Durations(size)
    for k, window in enumerate(windows):
        if k:
            made.rotate()
        for duration in window:
            made.add(duration)
    return made


def _check(made: Durations, samples: Sequence[float]) -> None:
    assert made.count == len(samples) == sum(made.histogram().values())
    assert made.mean() == pytest.approx(np.mean(samples), rel=1e-12, abs=1e-300)
    assert made.largest() == max(samples)
    for share, found in zip(SHARES, made.quantiles(*SHARES)):
        exact = np.quantile(samples, share, method='inverted_cdf')
        assert found == pytest.approx(exact, rel=EXACT, abs=1e-6)


@given(MANY)
def test_against_numpy(samples: list[float]) -> None:
    """Check count, mean, quantiles and the largest of anything."""
    _check(_filled(samples), samples)


@given(st.lists(st.lists(DURATION, max_size=30), min_size=1, max_size=15), st.integers(1, 6))
def test_only_the_last_windows_count(windows: list[list[float]], size: int) -> None:
    """Check against numpy on the samples of the last windows, whatever came before."""
    made = _filled(*windows, size=size)
    kept = [x for window in windows[-size:] for x in window]
    if kept:
        _check(made, kept)
    else:
        assert (made.count, made.mean(), made.quantiles(0.5)) == (0, 0.0, [0.0])


@given(MANY, st.integers(1, 20))
def test_asking_in_between_changes_nothing(samples: list[float], every: int) -> None:
    """Check that durations asked for at any time are those of all samples up to then."""
    made = Durations()
    for k, duration in enumerate(samples):
        made.add(duration)
        if k % every == 0:
            _check(made, samples[:k + 1])
    _check(made, samples)


def test_a_log_normal_loop() -> None:
    """Check the quantiles of 100 000 samples with a long tail, in five windows."""
    samples = np.random.default_rng(0).lognormal(np.log(2e-4), 0.7, 100_000)
    made = _filled(*samples.reshape(5, -1).tolist())
    shares = (0.5, 0.99, 0.999)
    exact = np.quantile(samples, shares)
    assert made.quantiles(*shares) == pytest.approx(exact, rel=1.5 * EXACT)
    assert exact[2] > 5.0 * made.mean()
    assert made.mean() == pytest.approx(samples.mean())


def test_one_outlier_is_the_maximum_and_no_quantile() -> None:
    """Check that one late sample in a thousand shows above 99.9 % and not on it."""
    made = _filled([1e-3] * 999 + [0.5])
    assert made.quantiles(0.5, 0.999, 0.9995) == [1e-3, 1e-3, pytest.approx(0.5, rel=EXACT)]
    assert made.largest() == 0.5


def test_the_octaves_of_the_histogram() -> None:
    """Check which octave each duration is in, by hand: about 1 ms times powers of two."""
    made = _filled([0.9e-3, 1.1e-3, 1.3e-3, 1.5e-3, 2.7e-3, 0.6e-3, 0.1])
    ends, counts = zip(*made.histogram().items())
    assert counts == (1, 3, 2, 1)
    assert ends == pytest.approx([0.707e-3, 1.414e-3, 2.828e-3, 128e-3 * 2 ** 0.5], rel=1e-3)


def test_beyond_the_bins() -> None:
    """Check that a nanosecond and a day are counted, the day as the largest one."""
    made = _filled([1e-9, 0.0, 86400.0])
    assert made.count == 3
    assert made.largest() == 86400.0
    assert made.quantiles(0.3) < [1.2e-6]


def test_memory_is_bounded() -> None:
    """Check that windows that have gone leave nothing behind."""
    made = Durations(2)
    for _ in range(50):
        for _ in range(100):
            made.add(1e-3)
        made.rotate()
        assert len(made._windows) <= 2
        assert made.count <= 200
        assert not made._noted


def test_nothing_yet() -> None:
    """Check 0 without any sample, also after a rotation."""
    made = Durations()
    for _ in range(20):
        assert (made.count, made.mean(), made.largest(), made.histogram()) == (0, 0, 0, {})
        assert made.quantiles(0.0, 1.0) == [0.0, 0.0]
        made.rotate()

"""Mean and quantiles of durations, against numpy's."""

from collections.abc import Sequence

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from ctc_chattering.core.durations import Durations

#: Binary fractions, so that numpy's count of samples is ours.
SHARES = (0.0, 0.25, 0.5, 0.984375, 1.0)
DURATION = st.floats(0.0, 1e3)
MANY = st.lists(DURATION, min_size=1, max_size=200)


def _filled(*windows: Sequence[float], size: int = 10) -> Durations:
    made = Durations(size)
    for k, window in enumerate(windows):
        if k:
            made.rotate()
        for duration in window:
            made.add(duration)
    return made


def _check(made: Durations, samples: Sequence[float]) -> None:
    assert made.count == len(samples)
    assert made.mean() == pytest.approx(np.mean(samples), rel=1e-12, abs=1e-300)
    for share in SHARES:
        exact = np.quantile(samples, share, method='inverted_cdf')
        assert made.quantile(share) == exact


@given(MANY)
def test_against_numpy(samples: list[float]) -> None:
    """Check count, mean and quantiles of anything."""
    _check(_filled(samples), samples)


@given(st.lists(st.lists(DURATION, max_size=30), min_size=1, max_size=15), st.integers(1, 6))
def test_only_the_last_windows_count(windows: list[list[float]], size: int) -> None:
    """Check against numpy on the samples of the last windows, whatever came before."""
    made = _filled(*windows, size=size)
    kept = [x for window in windows[-size:] for x in window]
    if kept:
        _check(made, kept)
    else:
        assert (made.count, made.mean(), made.quantile(0.5)) == (0, 0.0, 0.0)


def test_a_log_normal_loop() -> None:
    """Check the 99.9 % quantile of 100 000 samples with a long tail, in five windows."""
    samples = np.random.default_rng(0).lognormal(np.log(2e-4), 0.7, 100_000)
    made = _filled(*samples.reshape(5, -1).tolist())
    exact = float(np.quantile(samples, 0.999, method='inverted_cdf'))
    assert made.quantile(0.999) == exact
    assert exact > 5.0 * made.mean()
    assert made.mean() == pytest.approx(samples.mean())


def test_one_outlier_is_the_maximum_and_no_quantile() -> None:
    """Check that one late sample in a thousand shows above 99.9 % and not on it."""
    made = _filled([1e-3] * 999 + [0.5])
    assert made.quantile(0.999) == 1e-3
    assert made.quantile(0.9995) == 0.5


def test_nothing_yet() -> None:
    """Check 0 without any sample, also after a rotation."""
    made = Durations()
    for _ in range(20):
        assert (made.count, made.mean(), made.quantile(0.0), made.quantile(1.0)) == (0, 0, 0, 0)
        made.rotate()

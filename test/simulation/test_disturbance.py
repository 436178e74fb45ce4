"""The disturbance d(t) of the plant."""

import numpy as np
import pytest

from ctc_chattering.simulation.disturbance import disturbance


def test_is_the_paper_s() -> None:
    """Check d = [sin t, sin 2t] of the second experiment."""
    for t in np.linspace(0.0, 10.0, 97).tolist():
        assert disturbance((1.0, 1.0), (1.0, 2.0), t) == [np.sin(t), np.sin(2.0 * t)]


def test_amplitude_frequency_and_sign_per_joint() -> None:
    """Check quarter periods by hand, with three joints."""
    d = disturbance((2.0, -3.0, 5.0), (np.pi, np.pi / 2, 0.0), 0.5)
    assert d == pytest.approx([2.0, -3.0 / np.sqrt(2.0), 0.0], abs=1e-15)


def test_starts_at_zero_and_obeys_the_oscillator_equation() -> None:
    """Check d(0) = 0 and d'' = -w² d by central differences."""
    amplitude, frequency, h = (1.5, 0.7), (3.0, 8.0), 1e-4
    assert disturbance(amplitude, frequency, 0.0) == [0.0, 0.0]
    for t in (0.3, 1.1, 7.7):
        before, now, after = (
            np.array(disturbance(amplitude, frequency, x)) for x in (t - h, t, t + h))
        second = (after - 2 * now + before) / h ** 2
        assert second == pytest.approx(-np.square(frequency) * now, abs=1e-5)


def test_no_amplitude_is_no_disturbance() -> None:
    """Check that the default of the plant adds nothing."""
    assert disturbance((0.0, 0.0), (0.0, 5.0), 12.3) == [0.0, 0.0]

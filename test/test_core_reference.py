"""The desired motion."""

import math

import numpy as np
import pytest

from ctc_chattering.core.reference import ReferenceConfig, Sinusoid
from ctc_chattering.errors import ParameterError

FULL = ReferenceConfig(
    joint_names=('a', 'b', 'c'), center=(1.0, -2.0, 0.0), amplitude=(0.5, -1.5, 2.0),
    frequency=(1.0, 0.3, 2.5), phase=(0.0, 0.7, -2.0))


@pytest.mark.parametrize('t', [0.0, 0.123, 1.0, 3.337, 9.9])
def test_default_is_the_paper_s(t: float) -> None:
    """Check q_d of section 4 and its derivatives, differentiated by hand."""
    q_d, dq_d, ddq_d = Sinusoid(ReferenceConfig()).at(t)
    w = 2 * math.pi
    x = 0.5 * math.sin(w * t)
    assert q_d == pytest.approx([math.pi + x, math.pi / 2 + x], abs=1e-14)
    assert dq_d == pytest.approx([w * 0.5 * math.cos(w * t)] * 2, abs=1e-13)
    assert ddq_d == pytest.approx([-w * w * x] * 2, abs=1e-12)


def test_derivatives_are_finite_differences() -> None:
    """Check velocity and acceleration of every joint against the positions."""
    motion, h = Sinusoid(FULL), 1e-4
    for t in np.linspace(0.0, 5.0, 41).tolist():
        before, after = (np.array(motion.at(t + s)) for s in (-h, h))
        now = np.array(motion.at(t))
        assert now[1] == pytest.approx((after[0] - before[0]) / (2 * h), abs=1e-4)
        assert now[2] == pytest.approx((after[1] - before[1]) / (2 * h), abs=1e-3)


def test_centre_amplitude_and_period() -> None:
    """Check that each joint sweeps centre ± amplitude in 1 / frequency."""
    motion = Sinusoid(FULL)
    path = np.array([motion.at(t)[0] for t in np.linspace(0.0, 10.0, 20_001)])
    assert path.max(axis=0) == pytest.approx([1.5, -0.5, 2.0], abs=1e-5)
    assert path.min(axis=0) == pytest.approx([0.5, -3.5, -2.0], abs=1e-5)
    for i, f in enumerate(FULL.frequency):
        assert motion.at(0.4 + 1 / f)[0][i] == pytest.approx(motion.at(0.4)[0][i], abs=1e-12)


def test_frequency_zero_rests_at_the_phase() -> None:
    """Check that a joint of frequency 0 stands still at centre + amplitude sin(phase)."""
    motion = Sinusoid(ReferenceConfig(frequency=(0.0, 1.0), phase=(math.pi / 2, 0.0)))
    for t in (0.0, 0.77, 5.0):
        q_d, dq_d, ddq_d = motion.at(t)
        assert q_d[0] == pytest.approx(math.pi + 0.5)
        assert dq_d[0] == pytest.approx(0.0, abs=1e-15)
        assert ddq_d[0] == 0.0


@pytest.mark.parametrize('values', [
    {'frequency': [-1.0, 1.0]}, {'center': [0.0]}, {'amplitude': [math.inf, 0.0]},
    {'phase': [math.nan, 0.0]}, {'control_period': 1.5e-9}, {'joint_names': ['a', 'a']}])
def test_refusals(values: dict[str, object]) -> None:
    """Check that the error names the parameter."""
    with pytest.raises(ParameterError) as error:
        ReferenceConfig.from_mapping(values)
    assert error.value.name == next(iter(values))

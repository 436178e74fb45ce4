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

"""The desired motion, and its table for compiled runs."""

import math

from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.trajectory.reference import (
    make_motion,
    reference_table,
    ReferenceConfig,
    Sinusoid,
    Trapezoid,
)
from ctc_chattering.trajectory.waypoints import Route
import numpy as np
import pytest

S = 1_000_000_000
FULL = ReferenceConfig(
    joint_names=('a', 'b', 'c'), center=(1.0, -2.0, 0.0), amplitude=(0.5, -1.5, 2.0),
    frequency=(1.0, 0.3, 2.5), phase=(0.0, 0.7, -2.0))


@pytest.mark.parametrize('t', [0.0, 0.123, 1.0, 3.337, 9.9])
def test_default_is_the_paper_s(t: float) -> None:
    """Check q_d of section 4 and its derivatives, differentiated by hand."""
    q_d, dq_d, ddq_d = Sinusoid(ReferenceConfig()).at(round(t * S))
    w = 2 * math.pi
    x = 0.5 * math.sin(w * t)
    assert q_d == pytest.approx([math.pi + x, math.pi / 2 + x], abs=1e-14)
    assert dq_d == pytest.approx([w * 0.5 * math.cos(w * t)] * 2, abs=1e-13)
    assert ddq_d == pytest.approx([-w * w * x] * 2, abs=1e-12)


def test_derivatives_are_finite_differences() -> None:
    """Check velocity and acceleration of every joint against the positions."""
    motion, h = Sinusoid(FULL), 1e-4
    for t in range(0, 5 * S + 1, S // 8):
        before, after = (np.array(motion.at(t + s)) for s in (-S // 10_000, S // 10_000))
        now = np.array(motion.at(t))
        assert now[1] == pytest.approx((after[0] - before[0]) / (2 * h), abs=1e-4)
        assert now[2] == pytest.approx((after[1] - before[1]) / (2 * h), abs=1e-3)


def test_extremes() -> None:
    """Check them against many points, one joint being at rest."""
    sinusoid = Sinusoid(FULL.changed({'frequency': [1.0, 0.3, 0.0]}))
    path = np.array([sinusoid.at(t) for t in range(0, 20 * S, S // 200)])
    found = np.array(sinusoid.extremes())
    for extreme in ('max', 'min'):
        assert getattr(found, extreme)(0) == pytest.approx(getattr(path, extreme)(0), abs=1e-2)


def test_the_trapezoid_accelerates_moves_brakes_and_rests() -> None:
    """Check a cycle of each joint: integrals, parts of the time, and its largest values."""
    config = FULL.changed({'profile': 'trapezoid', 'phase': [0.0, 0.0, 0.0]})
    motion = make_motion(config)
    assert isinstance(motion, Trapezoid)
    for i, (c, a, f) in enumerate(zip(config.center, config.amplitude, config.frequency)):
        slow = math.pi * f
        t = np.linspace(0.0, 4.0 / f, 8_001)
        q, dq, ddq = np.array([motion.at(round(x * S)) for x in t])[:, :, i].T
        assert (q[0], q[4_000]) == pytest.approx((c - a, c + a))
        rate = np.gradient(q, t)
        assert np.abs(rate - dq).max() < 2e-3 * np.abs(dq).max()
        assert np.abs(np.diff(dq) - np.diff(t) * ddq[:-1]).max() < 2e-3 * np.abs(dq).max()
        assert np.abs(dq).max() == pytest.approx(slow * abs(a))
        assert set(np.round(np.abs(ddq) / (slow * slow * abs(a)), 9)) == {0.0, 1.0}
        still = (dq == 0.0) & (ddq == 0.0)
        assert still.mean() == pytest.approx(1.0 - 1.5 / math.pi, abs=1e-3)


@pytest.mark.parametrize('values', [
    {'frequency': [-1.0, 1.0]}, {'center': [0.0] * 3}, {'amplitude': [math.inf, 0.0]},
    {'phase': [math.nan, 0.0]}, {'control_period': 1.5e-9}, {'joint_names': ['a', 'a']},
    {'start_duration': -1.0}, {'start_duration': math.inf}, {'trajectory_file': 5}])
def test_refusals(values: dict[str, object]) -> None:
    """Check that the error names the parameter."""
    with pytest.raises(ParameterError) as error:
        ReferenceConfig.from_mapping(values)
    assert error.value.name == next(iter(values))


ROUTE = Route(('c', 'b', 'a'), (S, 2 * S), (
    ((3.0, 2.0, 1.0), (0.0, 0.0, 1.0), ()), ((6.0, 5.0, 4.0), (0.0, 0.0, 0.0), ())))
STATE = {'a': (0.1, 0.2), 'b': (0.3, 0.4), 'c': (0.5, 0.6)}


def test_without_a_smooth_start_it_is_the_sinusoid() -> None:
    """Check equality to the last bit, wherever the robot is."""
    sinusoid = Sinusoid(FULL)
    for motion in (make_motion(FULL), make_motion(FULL, start=STATE)):
        for t in (0, 1, 123_456_789, 7 * S):
            assert motion.at(t) == sinusoid.at(t)


def test_a_joint_without_a_state_begins_on_the_motion() -> None:
    motion = make_motion(FULL.changed({'start_duration': 2.0}), start={'b': (9.0, 0.0)})
    for t in (0, 2 * S, 3 * S):
        found, exact = motion.at(t), Sinusoid(FULL).at(t)
        assert [[row[i] for i in (0, 2)] for row in found] == [
            [row[i] for i in (0, 2)] for row in exact]
    assert [row[1] for row in motion.at(0)] == [9.0, 0.0, 0.0]
    route = make_motion(FULL, ROUTE, {'b': (9.0, 0.5)})
    assert route.at(0)[0] == (1.0, 9.0, 3.0)
    assert route.at(0)[1] == pytest.approx((0.0, 0.5, 0.0))


def test_refusals_of_a_motion() -> None:
    """Check a file that has not been read, an unknown start, and waypoints of other joints."""
    with pytest.raises(CtcError, match=r'trajectory_file: x\.yaml'):
        make_motion(FULL.changed({'trajectory_file': 'x.yaml'}))
    with pytest.raises(ParameterError, match='start_duration'):
        make_motion(FULL.changed({'start_duration': 1.0}))
    with pytest.raises(ParameterError, match='joint_names'):
        make_motion(ReferenceConfig(), ROUTE)


MS = 1_000_000


@pytest.mark.parametrize('start', [0.0, 0.05])
def test_the_layout_is_the_same_for_every_motion(start: float) -> None:
    """The rows are those of the motion, in the order of the joints that is asked for."""
    config = ReferenceConfig(start_duration=start)
    where = {'joint1': (0.1, 0.0), 'joint2': (-0.2, 0.3)} if start else {}
    table = reference_table(
        config, None, tuple(where.items()), config.joint_names[::-1], MS, 100)
    assert table.flags.c_contiguous
    motion = make_motion(config, None, where)
    expected = [[row[::-1] for row in motion.at(k * MS)] for k in range(100)]
    np.testing.assert_allclose(table, expected, rtol=1e-12, atol=1e-12)

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

"""Limits of joints, and the motions and starts that they refuse."""

from __future__ import annotations

from ctc_chattering.errors import CtcError
from ctc_chattering.trajectory.buffer import Point
from ctc_chattering.trajectory.joint_limits import describe_violations, JointLimits, read_limits
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig, StartError
from ctc_chattering.trajectory.transitions import TimedMotion
from ctc_chattering.trajectory.waypoints import Route
from hypothesis import assume, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from sinusoids import instants, positions, ranges, S, sample, sinusoids, velocities


def test_a_violation_has_joint_quantity_amount_and_limit() -> None:
    """Check the worse side of each quantity, up to the tolerance of a thousandth."""
    limits = [JointLimits('a', 'rad', (-1.0, 2.0), (-3.0, 3.0), (-5.0, 5.0)),
              JointLimits('b', 'm', (0.0, 1.0))]
    inside: list[Point] = [((-1.0009, 1.0), (3.002, 9.0), (-5.004, 9.0)), ((2.0009, 0.0), (), ())]
    assert describe_violations(limits, inside) == ''
    beyond: list[Point] = [((-1.5, 1.2), (3.5, 0.0), (-6.0, 0.0)), ((2.1, 0.0), (), ())]
    assert describe_violations(limits, beyond) == (
        'a: position -1.5 rad, 0.5 below its lower limit of -1; '
        'b: position 1.2 m, 0.2 above its upper limit of 1; '
        'a: velocity 3.5 rad/s, 0.5 above its upper limit of 3; '
        'a: acceleration -6 rad/s², 1 below its lower limit of -5')


LIMITED = """<robot name="r"><link name="base"/><link name="arm"/>
<joint name="a" type="{kind}"><parent link="base"/><child link="arm"/>
<limit effort="0" {limits}/></joint></robot>"""


def _limits(kind: str = 'revolute', **limits: float) -> list[JointLimits]:
    values = {'lower': -9.0, 'upper': 9.0, 'velocity': 0.0, **limits}
    return read_limits(LIMITED.format(kind=kind, limits=' '.join(
        f'{name}="{value}"' for name, value in values.items())), ('a',))


@settings(max_examples=20)
@given(sinusoids, positions, velocities, st.floats(0.05, 3.0), instants, st.floats(0.5, 8.0),
       st.floats(0.5, 8.0), st.floats(1.0, 100.0))
def test_an_accepted_start_and_a_suggested_duration_keep_the_limits(
        config: ReferenceConfig, q0: float, dq0: float, duration: float, t0: int, upper: float,
        velocity: float, acceleration: float) -> None:
    limits = _limits(lower=-upper, upper=upper, velocity=velocity, acceleration=acceleration)
    c, a, speed, push = ranges(config)
    state = {'a': (q0, dq0)}

    def started(duration: float) -> TimedMotion:
        return make_motion(config.changed({'start_duration': duration}), None, state, t0, limits)

    try:
        motion = started(duration)
    except StartError as error:
        assume(error.enough)
        assert error.enough is not None
        duration = error.enough
        motion = started(duration)
    except CtcError:
        assert (abs(c) + a > upper or speed > velocity or push > acceleration
                or abs(q0) > upper or abs(dq0) > velocity)
        return
    path = np.abs(sample(motion, t0, t0 + round(duration * S) + S, 1000))[:, :, 0]
    assert (path.max(axis=0) <= np.array([
        upper + 1e-3, velocity * 1.001, acceleration * 1.001]) + 0.02).all()


def test_refusals_name_the_joint_and_by_how_much() -> None:
    """Check motion, start and duration, one limit each."""
    config = ReferenceConfig(joint_names=('a',), center=(1.0,), amplitude=(0.5,),
                             frequency=(1.0,), start_duration=1.0)
    state = {'a': (0.0, 0.0)}
    for limits, start, message in (
            ({'upper': 1.4}, state, 'the motion is beyond the limits of the description: '
             'a: position 1.5 rad, 0.1 above its upper limit of 1.4'),
            ({'lower': -0.5}, {'a': (-0.6, 0.0)}, 'the start is beyond the limits of the '
             'description: a: position -0.6 rad, 0.1 below its lower limit of -0.5'),
            ({'velocity': 3.2}, {'a': (-3.0, 0.0)}, r'start_duration 1 s: the start is beyond .* '
             r'a: velocity 6\.\d+ rad/s, .* above its upper limit of 3.2; \d+ s keeps them'),
            ({'lower': -0.1}, {'a': (0.0, -3.0)}, 'no other duration keeps them')):
        with pytest.raises(CtcError, match=message):
            make_motion(config, None, start, 0, _limits(**limits))  # type: ignore[arg-type]
    route = Route(('a',), (S, 2 * S), (((0.0,), (0.0,), ()), ((2.0,), (0.0,), ())))
    with pytest.raises(CtcError, match=r'the motion .* a: velocity 3 rad/s, 1 above its upper'):
        make_motion(config, route, state, 0, _limits(velocity=2.0))

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
"""Friction of a joint as numbers with intervals."""

from __future__ import annotations

from ctc_chattering.identification.findings import Gap
from ctc_chattering.identification.friction import joint_friction
from ctc_chattering.identification.prior import BodyPrior
from ctc_chattering.identification.selection import select
from ctc_chattering.numerics.linear_algebra import Array
from made_up_windows import arm_windows, NO_BODIES, observed, velocities, windows
import numpy as np
import pytest
import urdfs

COUNT = 600


def torque_of(velocity: Array) -> Array:
    """Return friction of three joints: that of the last one depends on the second, too."""
    coulomb = np.where(velocity > 0.0, [3.0, 2.0, 1.0], [2.5, 2.0, 1.0])
    torque = np.sign(velocity) * coulomb + 0.4 * velocity
    torque[:, 2] += 2.0 * np.sign(velocity[:, 1]) + 0.3 * velocity[:, 1]
    return np.asarray(torque + 0.01 * np.random.default_rng(0).normal(size=velocity.shape))


def test_numbers_of_each_direction_and_of_a_coupled_joint() -> None:
    velocity = velocities(COUNT, 3, 2)
    solution = select(observed(windows(velocity), torque_of(velocity)), NO_BODIES, False).best
    first, second, third = (joint_friction(solution, joint) for joint in range(3))
    assert [first.forwards.value, first.backwards.value] == pytest.approx([3.0, 2.5], abs=0.01)
    assert first.coulomb.value == pytest.approx(2.75, abs=first.coulomb.half)
    assert second.viscous.value == pytest.approx(0.4, abs=second.viscous.half)
    assert (second.viscous.unit, second.coulomb.unit) == ('N*m*s/rad', 'N*m')
    assert second.load.absent and second.stribeck.absent and second.dead_band.absent
    (coupled,) = third.coupled
    assert coupled.joint == 1
    assert coupled.coulomb.value == pytest.approx(2.0, abs=0.02)
    assert third.as_mapping(('a', 'b', 'c'))['coupled'][0]['joint'] == 'b'
    assert first.at_rest == pytest.approx(3.0, abs=0.01)


def test_torque_that_lasts_unexplained_widens_the_intervals() -> None:
    velocity = velocities(COUNT, 3, 2)
    solution = select(observed(windows(velocity), torque_of(velocity)), NO_BODIES, False).best
    narrow, wide = (joint_friction(solution, 0, lasting) for lasting in (0.0, 0.5))
    assert wide.coulomb.value == narrow.coulomb.value
    assert wide.coulomb.half >= 1.0 > 10.0 * narrow.coulomb.half
    speed = float(np.sqrt(np.square(velocity[:, 0]).mean()))
    assert wide.viscous.half == pytest.approx(1.0 / speed, rel=0.05)


def test_a_joint_that_rests_has_no_numbers() -> None:
    velocity = velocities(COUNT, 2)
    velocity[:, 1] = 0.0
    solution = select(observed(windows(velocity), np.sign(velocity)), NO_BODIES, False).best
    rest = joint_friction(solution, 1)
    assert rest.coulomb.value is None and rest.viscous.gap == Gap.HARDLY_MOVES
    assert rest.at_rest == 0.0


def test_stribeck_friction_is_excluded_only_at_velocities_that_were_shown() -> None:
    fast = 0.6 + 0.2 * np.abs(velocities(COUNT, 1))
    sign = np.where(np.arange(COUNT) % 100 < 50, 1.0, -1.0)[:, None]
    solution = select(observed(windows(sign * fast), 2.0 * sign), NO_BODIES, False).best
    assert joint_friction(solution, 0).stribeck.gap == Gap.NOT_SLOW
    slow = velocities(COUNT, 1)
    solution = select(observed(windows(slow), 2.0 * np.sign(slow)), NO_BODIES, False).best
    stribeck = joint_friction(solution, 0).stribeck
    assert stribeck.absent and stribeck.shown_above is not None
    assert 0.0 < stribeck.shown_above < 0.1


def test_little_friction_of_joint_torque_sensors_beside_wrong_bodies() -> None:
    """Intervals are narrow, and a viscous friction of zero is inside of its interval."""
    rows, regressor = arm_windows(urdfs.panda(), urdfs.PANDA, 800)
    rng = np.random.default_rng(1)
    bodies = np.asarray(1.0 + 0.1 * rng.normal(size=rows.bodies.shape[2]), float)
    bodies[-3:] = 1.0
    change = np.append(regressor.parameters[:-3], np.zeros(3)) * (bodies - 1.0)
    torque = rows.model_torque + rows.bodies @ change + 0.2 * rows.direction
    torque += 0.1 * rng.normal(size=torque.shape)
    solution = select(observed(rows, torque), BodyPrior.of(regressor, 0.2), False).best
    for joint in range(7):
        friction = joint_friction(solution, joint)
        assert friction.coulomb.half < 0.1
        assert friction.coulomb.value == pytest.approx(0.2, abs=1.5 * friction.coulomb.half)
        assert friction.viscous.value == pytest.approx(0.0, abs=1.5 * friction.viscous.half)
        assert friction.viscous.number() >= 0.0


def test_quadratic_friction_leaves_stribeck_friction_uncertain() -> None:
    """Stribeck friction explains most of it, with less Coulomb friction than there is."""
    velocity = 4.0 * velocities(COUNT, 1)
    torque = 2.0 * np.sign(velocity) + 0.1 * velocity * np.abs(velocity)
    torque += 0.05 * np.random.default_rng(0).normal(size=velocity.shape)
    best, basic, curved = select(observed(windows(velocity), torque), NO_BODIES, False)
    friction = joint_friction(best, 0, 0.0, basic, 0 in curved)
    assert friction.coulomb.value == pytest.approx(2.0, abs=friction.coulomb.half)
    stribeck = np.sign(velocity) * (2.0 + np.exp(-np.square(velocity / 0.3)))
    assert select(observed(windows(velocity), stribeck), NO_BODIES, False).curved == ()

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

"""What is identified of simulated robots is what they have; what a run does not show is named."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any

from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.findings import Gap, Severity
from ctc_chattering.identification.identify import (
    Identification,
    identify_recordings,
    TorqueSignal,
)
from ctc_chattering.identification.recording import Recording, RecordingFault
from ctc_chattering.identification.verdict import verdicts
from ctc_chattering.numerics.linear_algebra import Array, Rows, Vector
from ctc_chattering.trajectory.waypoints import Route
from identified_robots import record, Recorded
import numpy as np
import pytest
from refusals import refused
from robots import arm, motion

#: Duration of the runs [s].
SHORT = 15.0


@cache
def plain() -> Recorded:
    return record('two_link', 1, SHORT)


def of(made: Recorded, recording: Recording | None = None, side: str = '') -> Identification:
    recordings = [(recording or made.recording).checked()]
    return identify_recordings(recordings, made.model, TorqueSignal(side))


def check_friction(found: Identification, made: Recorded) -> None:
    """Coulomb friction within 2 %, viscous within 5 %, as the truth is."""
    for friction, coulomb, viscous in zip(
            found.friction, made.plant.coulomb_friction, made.plant.viscous_friction):
        assert friction.coulomb.value == pytest.approx(coulomb, rel=0.02)
        assert friction.viscous.value == pytest.approx(viscous, rel=0.05)


def test_a_plain_robot() -> None:
    made = plain()
    found = of(made)
    check_friction(found, made)
    for friction in found.friction:
        assert friction.stribeck.absent and friction.load.absent and not friction.coupled
        assert friction.forwards.number() == pytest.approx(friction.backwards.number(), abs=0.01)
    assert (found.timing.delay, list(found.timing.delays)) == (0.0, [0])
    assert not found.timing.lag.any()
    assert [x.severity for x in verdicts(found)] == [Severity.NOTE] * 2
    assert found.bodies is not None and not found.bodies.differ() and not found.bodies.turn
    assert [x.value for x in found.encoder] == pytest.approx([1e-5, 1e-5], rel=1e-6)
    assert [x.value for x in found.noise] == pytest.approx([1e-3, 1e-3], rel=0.1)
    assert found.clock.period == 1e-3


@pytest.mark.slow
def test_delay_and_lags_of_the_drives() -> None:
    made = record('two_link', 2, SHORT, plant={
        'input_delay': 2, 'actuator_lag': [2e-3, 4e-3]})
    found = of(made)
    check_friction(found, made)
    assert found.timing.delay == 2.0
    assert found.timing.lag == pytest.approx([2e-3, 4e-3], rel=0.05)


@pytest.mark.slow
def test_friction_that_depends_on_direction_and_speed() -> None:
    made = record('two_link', 3, 20.0, plant={
        'friction_asymmetry': [0.1, 0.0], 'stribeck_friction': [2.0, 0.0],
        'stribeck_velocity': [0.08, 0.05]})
    found = of(made)
    first, second = found.friction
    level = made.plant.coulomb_friction[0]
    assert first.forwards.value == pytest.approx(1.1 * level, rel=0.01)
    assert first.backwards.value == pytest.approx(0.9 * level, rel=0.01)
    assert first.stribeck.value == pytest.approx(2.0, rel=0.05)
    assert first.stribeck_velocity.value == pytest.approx(0.08, rel=0.05)
    assert second.stribeck.absent


@pytest.mark.slow
def test_friction_of_the_load() -> None:
    found = of(record('two_link', 3, 20.0, plant={'load_friction': [0.03, 0.0]}))
    load = found.friction[0].load
    assert load.value == pytest.approx(0.03, rel=0.1)
    assert load.value == pytest.approx(0.03, abs=load.half)
    assert found.friction[1].load.absent


class Rotors(TwoLink):
    """The paper's arm with rotors that are large beside the inertia of its second link."""

    def mass_matrix(self, q: Vector) -> Rows:
        (m11, m12), (_, m22) = super().mass_matrix(q)
        return (m11 + 0.5, m12), (m12, m22 + 0.4)


def check_intervals(found: Identification, made: Recorded, scale: float = 1.0) -> None:
    """Coulomb friction is within its interval, with 0.01 % for numerics."""
    for friction, coulomb in zip(found.friction, made.plant.coulomb_friction):
        assert friction.coulomb.value == pytest.approx(
            scale * coulomb, abs=friction.coulomb.half + 1e-4 * coulomb)


@pytest.mark.slow
def test_rotors_are_named_and_no_friction() -> None:
    made = record('two_link', 5, 12.0, truth=Rotors())
    found = of(made)
    check_intervals(found, made)
    assert found.bodies is not None
    first, second = found.bodies.rotors
    # The first rotor turns as the first body does: nothing tells them apart.
    assert first.value is None and first.at_most is not None and first.at_most > 0.5
    assert second.value == pytest.approx(0.4, abs=second.half) and second.half < 0.3
    assert found.bodies.differ()


def test_a_base_that_is_not_level() -> None:
    """An arm that is turned by an angle has an encoder that is off by it."""
    q = np.add(plain().recording.q, (0.05, 0.0))
    found = of(plain(), changed(q=q))
    check_intervals(found, plain())
    assert found.bodies is not None
    assert found.bodies.turn == pytest.approx(0.05, rel=0.02)


class Own(TwoLink):
    """A model of a user's own, without a regressor that holds."""

    def inertial_parameters(self) -> Array:
        return 2.0 * super().inertial_parameters()


def test_a_model_without_a_regressor_has_friction_alone() -> None:
    made = plain()
    found = identify_recordings([made.recording.checked()], Own())
    check_friction(found, made)
    assert found.bodies is None


def changed(**fields: Any) -> Recording:
    return dataclasses.replace(plain().recording, **fields)


@pytest.mark.slow
def test_a_pause_in_the_middle_changes_no_number() -> None:
    made = plain()
    t = made.recording.t.copy()
    t[9_000:] += 3.0
    found = of(made, changed(t=t))
    check_friction(found, made)
    assert found.clock.missing == 3000


@pytest.mark.slow
def test_without_velocities_their_noise_is_not_identifiable() -> None:
    found = of(plain(), changed(dq=None))
    check_friction(found, plain())
    assert {x.gap for x in found.noise} == {Gap.NO_VELOCITIES}


def test_torques_from_the_effort() -> None:
    """The effort of a state is the torque of the period before it."""
    command = plain().recording.command
    assert command is not None
    effort = np.concatenate((np.zeros((1, 2)), command[:-1]))
    found = of(plain(), changed(effort=effort, command=None), side='motor')
    check_friction(found, plain())
    assert (found.timing.source, found.timing.delay) == ('effort', -1.0)
    assert np.isnan(found.timing.drive.delay)
    with refused(RecordingFault.TORQUE):
        of(plain(), changed(effort=None, command=None))


def route(second: float) -> Route:
    """Return the motion with the second joint scaled."""
    names, times, points = motion(arm('two_link'), 12.0, 1)
    scaled = [tuple((a, second * b) for a, b in point) for point in points]
    return Route(names, times, scaled)  # type: ignore[arg-type]


def test_a_joint_at_rest_has_no_number() -> None:
    # Friction holds joint 2 against the coupling to joint 1.
    made = record('two_link', 1, 12.0, route=route(0.0), plant={
        'coulomb_friction': [6.0, 60.0]})
    found = of(made)
    rest = found.friction[1]
    assert [x.value for x in (rest.coulomb, rest.viscous, rest.stribeck)] == [None] * 3
    assert rest.viscous.gap == Gap.HARDLY_MOVES
    assert found.friction[0].coulomb.value == pytest.approx(6.0, rel=0.02)


def test_a_robot_that_stands_still_is_refused() -> None:
    made = plain()
    q = np.zeros_like(made.recording.q)
    with pytest.raises(CtcError, match='no joint moves'):
        of(made, changed(q=q))


@pytest.mark.slow
def test_one_speed_does_not_show_viscous_friction() -> None:
    """There and back at nearly one speed: Coulomb and viscous friction look the same."""
    times = [0.0, 4.0, 8.0, 12.0, 16.0]
    points = [((0.8 * (k % 2), -0.8 * (k % 2)), (), ()) for k in range(5)]
    there = Route(('joint1', 'joint2'), [round(1e9 * t) for t in times], points)
    made = record('two_link', 1, 16.0, route=there, controller={'kp': [400.0] * 2})
    viscous = of(made).friction[0].viscous
    assert viscous.half > 0.05 * viscous.number()
    assert viscous.value == pytest.approx(made.plant.viscous_friction[0], abs=viscous.half)


def test_one_direction_does_not_tell_coulomb_friction_from_an_offset() -> None:
    points = [((0.0, 0.0), (0.0, 0.0), ()), ((2.0, 1.5), (0.0, 0.0), ())]
    there = Route(('joint1', 'joint2'), [0, 8 * 10 ** 9], points)
    made = record('two_link', 1, 8.0, route=there)
    found = of(made)
    assert all(x.severity > Severity.NOTE for x in verdicts(found))
    for friction, coulomb in zip(found.friction, made.plant.coulomb_friction):
        assert friction.coulomb.half > 0.2 * coulomb
        assert friction.coulomb.value == pytest.approx(coulomb, abs=friction.coulomb.half)


@pytest.mark.slow
def test_a_robot_at_100_hz() -> None:
    made = record('two_link', 6, 30.0, period=0.01, plant={'input_delay': 1},
                  controller={'kp': [50.0] * 2, 'kv': [20.0] * 2})
    found = of(made)
    check_friction(found, made)
    assert found.timing.delay == 1.0

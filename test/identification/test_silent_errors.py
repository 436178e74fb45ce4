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

"""No number is silently wrong: an independent plant with what linear drives and sensors lack."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.analysis.result import simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.findings import Reason, Severity
from ctc_chattering.identification.identified_robot import identify as identified
from ctc_chattering.identification.identify import identify_recordings
from ctc_chattering.identification.recording import RecordedMotion, Recording
from ctc_chattering.identification.verdict import verdicts
from faults_of_arms import case, recorded
from faulty_robots import plain, played, recording_of
from identification_judge import judged, Outcome, outcome
import numpy as np
import pytest
from robots import arm, motion
import urdfs

DURATION = 15.0


def of(robot: str, fault: str, seed: int) -> tuple[Outcome, list[str]]:
    """Return what is made of a fault, and the numbers that are silently wrong."""
    one = case(robot, fault, seed, DURATION)
    seen, recording = recorded(one, seed, DURATION)
    made = outcome(one, recording, seed)
    return made, judged(one, seen, made, DURATION)['wrong']


@pytest.mark.slow
def test_friction_of_slow_motion_is_excluded_only_above_a_velocity() -> None:
    made, wrong = of('two_link_urdf', 'creeping', 7500)
    assert not wrong
    assert made.results is not None
    stribeck = [friction.stribeck for friction in made.results.found.friction]
    assert all(x.half > abs(x.number()) or x.shown_above is not None for x in stribeck)
    # A joint needs more to break away than it shows while it slides.
    for verdict in made.results.verdicts:
        assert Reason.BREAK_AWAY in [x.reason for x in verdict.findings]


@pytest.mark.parametrize(('fault', 'refused'), [
    ('velocity_degrees', 2), *(pytest.param(x, 1, marks=pytest.mark.slow)
                               for x in ('velocity_sign', 'velocity_scale'))])
def test_velocities_that_are_no_change_of_the_positions_are_refused(
        fault: str, refused: int) -> None:
    made, wrong = of('two_link_urdf', fault, 7501)
    assert not wrong
    assert made.results is not None
    refusing = [verdict for verdict in made.results.verdicts if not verdict.usable]
    assert [x.findings[0].reason for x in refusing] == [Reason.VELOCITY] * refused
    assert all(noise.value is None for noise, verdict in zip(
        made.results.found.noise, made.results.verdicts) if not verdict.usable)


@pytest.mark.slow
def test_a_delay_of_one_joint_is_a_lag_or_a_delay() -> None:
    made, wrong = of('two_link_urdf', 'joint_delay', 7500)
    assert not wrong
    assert made.results is not None
    found = made.results
    heads = {head for table in found.tables() for head in table.heads}
    assert 'lag, or delay of this joint' in heads
    low, _, high = found.found.timing.delays[0]
    own = 1e-3 * np.asarray(case('two_link_urdf', 'joint_delay', 7500, DURATION).own_delay)
    assert (low <= own).all() and (own <= high).all()


@pytest.mark.parametrize(('robot', 'fault', 'seed'), [
    ('two_link_urdf', 'dead_band', 7500),
    *(pytest.param('drawn3', fault, 7501, marks=pytest.mark.slow)
      for fault in ('dead_band', 'fading_torque'))])
def test_friction_beside_a_drive_that_is_not_linear(robot: str, fault: str, seed: int) -> None:
    """A dead band is a number of its own, or part of the friction of commands."""
    one = case(robot, fault, seed, DURATION)
    made, wrong = of(robot, fault, seed)
    assert not wrong
    assert made.results is not None
    bands = np.broadcast_to(one.band, one.robot.n)
    for i, coulomb in enumerate(one.robot.physics.coulomb):
        friction = made.results.found.friction[i]
        if friction.dead_band.value is not None:
            assert friction.dead_band.value == pytest.approx(
                bands[i], abs=2.0 * friction.dead_band.half)
        assert friction.coulomb.value == pytest.approx(
            coulomb, abs=2.0 * friction.coulomb.half + 0.01 * coulomb)
        # Torque that fades is an offset, of which the interval is wide.
        most = 2.0 * friction.coulomb.half + bands[i] + 0.05 * coulomb
        for number in (friction.forwards, friction.backwards):
            assert abs(number.number() - coulomb) < most or fault == 'fading_torque'


@pytest.mark.slow  # test_identify.py has a joint at rest beside one that moves.
def test_a_wrist_that_friction_holds_does_not_block_the_other_joints() -> None:
    """Rotors, a tool and a stuck last joint: the URDF is corrected without that joint."""
    one = case('ur5', 'real_arm', 7600, DURATION)
    made, wrong = of('ur5', 'real_arm', 7600)
    assert not wrong
    assert made.results is not None
    *others, stuck = made.results.verdicts
    assert (stuck.usable, stuck.findings[0].reason) == (False, Reason.NOT_EXCITED)
    assert all(x.usable for x in others)
    assert 'rotor_inertia' in made.urdf
    for i in range(5):
        assert made.results.found.friction[i].coulomb.value == pytest.approx(
            one.robot.physics.coulomb[i], rel=0.02)
    assert stuck.needs_motion


@pytest.mark.slow
def test_a_known_payload_tells_torque_constants_from_masses() -> None:
    """All torque constants are 5 % off: one run says masses or torques, and two say which."""
    one = plain('two_link_urdf', 7700).with_physics(scale=0.95)
    tip = np.array([0.0, 0.0, 0.0])
    bodies = one.physics.bodies
    heavier = bodies.mass.copy()
    heavier[-1] += 1.3
    centre = bodies.centre.copy()
    centre[-1] = (bodies.mass[-1] * centre[-1] + 1.3 * tip) / heavier[-1]
    inertia = bodies.inertia.copy()
    for mass, away in ((bodies.mass[-1], bodies.centre[-1] - centre[-1]), (1.3, tip - centre[-1])):
        inertia[-1] += mass * (away @ away * np.eye(3) - np.outer(away, away))
    inertia[-1] += 0.4 * 1.3 * 0.05 ** 2 * np.eye(3)
    carrying = one.with_bodies(mass=heavier, centre=centre, inertia=inertia)
    route = motion(arm(one.name), DURATION, 7700)
    runs = [RecordedMotion(recording_of(robot, played(robot, route, 7700)).checked(),
                           urdfs.two_links()) for robot in (one, carrying)]
    link = Tree(urdfs.two_links()).ends[one.joints[-1]][1]
    both = identified(runs, payloads=((0.0, ''), (1.3, link)))
    (note,) = [x for x in both.results.found.findings if x.reason == Reason.PAYLOAD]
    assert (note.values['mass'], note.values['link']) == (1.3, link)
    # The torque at the joint is 0.95 times the signal.
    assert [x.value for x in both.results.found.constant] == pytest.approx([0.95] * 2, rel=2e-3)
    for friction, coulomb in zip(both.results.found.friction, one.physics.coulomb):
        assert friction.coulomb.value == pytest.approx(coulomb, rel=1e-3)
    wrong: list[tuple[list[tuple[float, str]], str]] = [
        ([(1.0, link)], 'one for each'), ([(0.0, ''), (1.0, 'nowhere')], 'no link'),
        ([(0.0, ''), (-1.0, link)], 'mass >= 0')]
    for payloads, what in wrong:
        with pytest.raises(CtcError, match=what):
            identified(runs, payloads=payloads)


@pytest.mark.slow
def test_an_exact_run_has_no_error_of_the_model() -> None:
    run = simulate(parameter_file.load(Path('config/friction.yaml'))).run
    model = TwoLink()
    recording = Recording('run', ('joint1', 'joint2'), run.t, run.q, run.dq, None, run.tau)
    found = identify_recordings([recording.checked()], model)
    assert [x.severity for x in verdicts(found)] == [Severity.NOTE] * 2
    assert found.bodies is not None and not found.bodies.differ()
    assert [x.coulomb.value for x in found.friction] == pytest.approx([9.9, 9.9], rel=1e-3)

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
from ctc_chattering.bags.recording import RecordedMotion, Recording
from ctc_chattering.configuration import parameter_file
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.findings import Severity
from ctc_chattering.identification.identified_robot import identify as identified
from ctc_chattering.identification.identify import identify
from ctc_chattering.identification.model_errors import candidates
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
    return made, judged(one, fault, seen, made, DURATION)['wrong']


@pytest.mark.slow
def test_friction_of_slow_motion_is_excluded_only_above_a_velocity() -> None:
    made, wrong = of('two_link_urdf', 'creeping', 7500)
    assert not wrong
    assert made.results is not None
    for friction, reasons in zip(made.results.found.friction, made.reasons):
        assert friction.stribeck.reason.startswith('none above 0.0')
        # The joint needs more to break away than it shows while it slides.
        assert 'breaking away |P| is up to' in reasons


@pytest.mark.parametrize(('fault', 'refused'), [
    ('velocity_degrees', 2), *(pytest.param(x, 1, marks=pytest.mark.slow)
                               for x in ('velocity_sign', 'velocity_scale'))])
def test_velocities_that_are_no_change_of_the_positions_are_refused(
        fault: str, refused: int) -> None:
    made, wrong = of('two_link_urdf', fault, 7501)
    assert not wrong
    assert made.severity.count(Severity.REFUSED) == refused
    assert sum('times the change of its position' in x for x in made.reasons) == refused
    assert made.results is not None
    assert all(x.value is None for x, of_joint in zip(made.results.found.noise, made.severity)
               if of_joint == Severity.REFUSED)


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


@pytest.mark.parametrize(('robot', 'fault', 'seed', 'name'), [
    ('two_link_urdf', 'dead_band', 7500, 'dead band'),
    *(pytest.param('drawn3', fault, 7501, fault.replace('_', ' '), marks=pytest.mark.slow)
      for fault in ('dead_band', 'fading_torque'))])
def test_a_drive_that_is_not_linear_is_named_beside_right_friction(
        robot: str, fault: str, seed: int, name: str) -> None:
    one = case(robot, fault, seed, DURATION)
    made, wrong = of(robot, fault, seed)
    assert not wrong
    assert made.severity.count(Severity.CARE) == one.robot.n
    assert made.results is not None
    found, bands = made.results.found, np.broadcast_to(one.band, one.robot.n)
    for i, coulomb in enumerate(one.robot.physics.coulomb):
        friction, reasons, band = found.friction[i], made.reasons[i], found.dead_band[i]
        assert name in reasons
        assert friction.coulomb.value == pytest.approx(coulomb, rel=0.01)
        # A torque of one sign does not tell one from the other, and that is said.
        off = bands[i] if band.reason.startswith('in forwards, backwards') else 0.0
        assert friction.forwards.value is not None
        assert abs(friction.forwards.value - coulomb) == pytest.approx(off, abs=0.05 * coulomb)
        assert not off or 'and the torque has one sign' in reasons
        assert found.scale[i].value == pytest.approx(1.0, abs=1e-3)


@pytest.mark.slow  # test_identify.py has a joint at rest beside one that moves.
def test_a_wrist_that_friction_holds_does_not_block_the_other_joints() -> None:
    """Rotors, a tool and a stuck last joint: the URDF is corrected without that joint."""
    one = case('ur5', 'real_arm', 7600, DURATION)
    made, wrong = of('ur5', 'real_arm', 7600)
    assert not wrong
    assert made.severity[5] == Severity.REFUSED
    assert 'ctc excite --for' in made.reasons[5] and 'raise its kp' in made.reasons[5]
    assert made.severity[:5].count(Severity.REFUSED) == 0
    assert 'rotor_inertia' in made.urdf
    assert made.results is not None
    for i in range(5):
        assert made.results.found.friction[i].coulomb.value == pytest.approx(
            one.robot.physics.coulomb[i], rel=0.02)
    assert 'Next: `ctc excite --for' in made.results.text()


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
    alone = identified([runs[0]]).results.verdicts
    assert any('explained as well by' in x.reason for x in alone[0].findings)
    both = identified(runs, payloads=((0.0, ''), (1.3, link)))
    assert f'a ball of 1.3 kg, radius 5 cm, at the origin of {link}' in (
        both.results.text().replace('\n    ', ' '))
    assert [x.value for x in both.results.found.scale] == pytest.approx([0.95] * 2, rel=1e-3)
    assert not any('explained as well by' in x.reason for x in both.results.verdicts[0].findings)
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
    found = identify([Recording('run', ('joint1', 'joint2'), run.t, run.q, run.dq, None, run.tau
                                ).checked()], model, candidates(model))
    assert found.selected.attributed
    assert not [x.text for x in found.findings if x.severity > Severity.NOTE]
    assert [x.coulomb.value for x in found.friction] == pytest.approx([9.9, 9.9], rel=1e-3)

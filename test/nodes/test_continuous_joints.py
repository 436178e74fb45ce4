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

"""Joints that turn endlessly, whose driver reports angles within a window: real processes."""

from __future__ import annotations

from contextlib import closing
from math import pi
from pathlib import Path

from controller_process import ControllerUnderTest
from ctc_chattering.analysis.export import export
from ctc_chattering.analysis.result import simulate
from ctc_chattering.bags.recorded_reference import read_reference
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.configuration import parameter_file
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS, nanoseconds
from faults import Diagnostics, ERROR
import numpy as np
from processes import probe
import pytest
from recorded_runs import record, reports_of
from ros_messages import MS, reference, state

pytestmark = pytest.mark.ros
#: Laws in turn, each from this time on [s]; the first joint crosses the window's end under each.
LAWS = {0.9: 'observer_feedback', 1.9: 'slotine_li', 2.9: 'pd_gravity'}
#: Waypoints of a joint that turns at 7 rad/s, nearly three turns; the other moves to and fro.
WAYPOINTS = [(0.3, 0.8, 1.0), *((0.8 + 0.4 * k, 2.5 + 2.8 * k, (-1.0) ** k) for k in range(7))]


def written(path: Path, more: str = '', bringup: str = '') -> Path:
    """Return a parameter file of the run, with more parameters of the plant."""
    route, file = path / 'route.yaml', path / 'run.yaml'
    route.write_text('\n'.join(['joint_names: [joint1, joint2]', 'points:', *(
        f'  - {{time_from_start: {t:.1f}, positions: [{q:.2f}, {x:.2f}], velocities: [{v}, 0.0]}}'
        for (t, q, x), v in zip(WAYPOINTS, [2.0] + [7.0] * 7))]))
    file.write_text(f"""
/**:
  ros__parameters: {{continuous_joints: [joint1, joint2], control_period: 0.002}}
plant:
  ros__parameters: {{duration: 3.2, coulomb_friction: [3.0, 1.0], {more}}}
controller:
  ros__parameters: {{law: compensation, ka: [60.0, 30.0], effort_limit: [400.0, 150.0]}}
reference:
  ros__parameters: {{trajectory_file: {route}}}
bringup:
  ros__parameters:
    events: [{bringup}]
""")
    return file


def raw_positions(bag: Path) -> Array:
    """Return positions as they were published, shape (N, 2)."""
    with closing(open_bag(bag)) as reader:
        return np.array([m.position for _, m in reader.read(reader.named('joint_states'))])


def tracking(bag: Path) -> tuple[Array, Array, Array]:
    """Return times, desired positions and errors of the controller's samples with torques."""
    with closing(open_bag(bag)) as reader:
        messages = [m for _, m in reader.read(reader.named('controller/tracking'))]
        start = read_reference(reader, ('joint1', 'joint2')).start
    stamps = np.array([nanoseconds(m.header.stamp) for m in messages])
    desired, error = np.hsplit(np.array([m.position for m in messages]), 2)
    return (stamps - start) / NANOSECONDS, desired, error


@pytest.mark.slow  # `test_positions.py` has it without ROS.
@pytest.mark.parametrize(('least', 'loss'), [(-pi, 0.0), (0.0, 0.05)])
def test_in_lockstep_the_window_makes_no_difference(
        tmp_path: Path, least: float, loss: float) -> None:
    """
    Under four laws one after the other, also with lost states: as where turns are counted.

    Before, `compensation` went to both effort limits at the first crossing, at 12 rad/s. Neither
    the run that is read nor its table jumps.
    """
    events = ', '.join(f'{t} controller law {law}' for t, law in LAWS.items())
    more = f'pacing: lockstep, least_angle: {least}, sample_loss: {loss}'
    file = written(tmp_path, more, events)
    result = record(tmp_path / 'bag', '--params-file', str(file))
    raw = raw_positions(tmp_path / 'bag')
    assert raw.min() >= least and raw.max() < least + 2.0 * pi
    assert np.abs(np.diff(raw[:, 0])).max() > 6.0
    assert [config.law for _, config in result.configs] == ['compensation', *LAWS.values()]
    counted = simulate(parameter_file.load(file))
    assert np.abs(result.run.q[:, 0]).max() > 6.0 * pi
    for name in ('q', 'dq', 'q_d', 'e'):
        found, expected = getattr(result, name), getattr(counted, name)
        np.testing.assert_allclose(found, expected, atol=1e-6, err_msg=name)
    # Where a busy recorder receives torques late, v is known as the controller publishes it.
    known = np.isfinite(result.v).all(axis=1)
    assert np.mean(known) > 0.09
    np.testing.assert_allclose(result.v[known], counted.v[known], atol=1e-6)
    # Up to three states are lost: it moves four periods at 7 rad/s.
    assert np.abs(np.diff(result.run.q, axis=0)).max() < 0.06
    export(result, tmp_path / 'run.csv')
    table = np.genfromtxt(tmp_path / 'run.csv', delimiter=',', skip_header=1)
    assert np.abs(np.diff(table[:, 1])).max() < 0.06


def test_in_real_time_it_turns_without_a_word(tmp_path: Path) -> None:
    """
    Even if a busy computer has outages, no turn is miscounted and no position is refused.

    After an outage the joint goes back the short way, so its error depends on the computer. The
    controller publishes it: the run has the same turns in each such sample.
    """
    file = written(tmp_path, f'pacing: real_time, least_angle: {-pi}')
    result = record(tmp_path / 'bag', '--params-file', str(file))
    raw = raw_positions(tmp_path / 'bag')[:, 0]
    assert (np.abs(np.diff(raw)) > pi).any()
    t, desired, error = tracking(tmp_path / 'bag')
    assert len(t) > 20
    sample = np.searchsorted(result.run.t, t)
    assert sample.max() < len(result.run.t)
    # The error is that of the present, which a late answer predicts; a turn is 6.28 rad.
    assert np.abs(result.run.q[sample] - (desired - error)).max() < 1.0
    assert np.abs(error).max() < pi  # The way back to the reference begins at the joint.
    report = reports_of(tmp_path / 'bag', 'controller')[-1]
    assert 'joint_states: refused, position_jump' not in report


def test_a_jump_is_named_once_and_one_that_stays_ends_the_torques() -> None:
    """A single one is passed over; the same states without turns told name the parameter."""
    at_rest = [[3.0, 0.5], [0.0, 0.0], [0.0, 0.0]]
    with probe() as it:
        reports = Diagnostics(it)
        controller = ControllerUnderTest(it, '-p', 'law:=pd_gravity')
        controller.states.publish(state(0, joint1=(3.0, 0.0), joint2=(0.5, 0.0)))
        controller.references.publish(reference(['joint1', 'joint2'], [at_rest] * 40))
        it.until(lambda: controller.commands, 'the torque')
        steady = list(controller.commands[-1].data)

        controller.states.publish(state(MS, joint1=(3.0 - 2.0 * pi, 0.0), joint2=(0.5, 0.0)))
        it.until_said('joint_states: refused: joint1 is at -3.283 rad, but 1 ms before it was at '
                      '3 rad with 0 rad/s; the difference is a whole turn; if the joint turns '
                      'endlessly, add it to continuous_joints')
        assert controller.answer(state(2 * MS, joint1=(3.0, 0.0), joint2=(0.5, 0.0))) == steady
        report = reports.until('controller', lambda r: r.refused('joint_states'), 'the count')
        assert report.refused('joint_states') == {'position_jump': 1}

        for k in range(3, 6):
            controller.states.publish(state(k * MS, joint1=(3.0, 0.0), joint2=(1.1, 0.0)))
        report = reports.until('controller', lambda r: r.level == ERROR, 'the trip')
        assert report.message.startswith('tripped: joint2 is at 1.1 rad, but 3 ms before it was ')
        assert 'it stays there; check whether its encoder was reset or slips' in report.message
        assert report.refused('joint_states') == {'position_jump': 4}
        assert not any('nan' in line for line in it.lines)

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

"""From a URDF to a run without a refusal."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.analysis.result import simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.new_robot import KA, new_robot
from ctc_chattering.configuration.package_share import find_file
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_commands import ctc, refused
import numpy as np
from urdfs import two_links

URDF = 'package://example-robot-data/robots/asr_twodof_description/urdf/TwoDofs.urdf'


def test_the_motion_is_within_half_the_limits_and_the_torques() -> None:
    """Compare with the limits as the URDF has them, at the samples of a simulated run."""
    values = new_robot(URDF)
    setup = parameter_file.load(None, {**values, 'plant': {**values['plant'], 'duration': 4.0}})
    result = simulate(setup)
    joints = [Tree(find_file(URDF).read_text()).joints[x] for x in result.joint_names]
    assert len(joints) == 2
    moving = result.t >= 2.0  # After the smooth start.
    for i, joint in enumerate(joints):
        low, high = joint.position
        quarter = 0.25 * (high - low)
        if np.isfinite(quarter):
            assert np.abs(result.q_d[:, i] - 0.5 * (low + high)).max() <= 1.001 * quarter + 0.01
        assert np.abs(result.dq_d[moving, i]).max() <= 0.51 * joint.velocity
        assert np.abs(result.tau[moving, i]).max() <= joint.effort
        assert setup.controller.ka[i] >= (KA * joint.effort if np.isfinite(joint.effort) else 0.0)
    error = np.sqrt(np.square(result.e[result.t >= 3.0]).mean(axis=0))
    assert (error < 0.01 * np.ptp(result.q_d, axis=0)).all()


def test_the_command_writes_a_file_that_runs(tmp_path: Path) -> None:
    (tmp_path / 'arm.urdf').write_text(two_links())
    done = ctc('new-robot', '--urdf', 'arm.urdf', '--out', 'mine/arm.yaml', cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1].startswith('wrote mine/arm.yaml; next: ctc compile mine')
    assert (tmp_path / 'mine' / 'arm.yaml').read_text().startswith('# By `ctc new-robot` from ')
    assert ctc('simulate', tmp_path / 'mine' / 'arm.yaml', '--duration', '0.1').returncode == 0
    again = ('new-robot', '--urdf', 'arm.urdf', '--out', 'mine/arm.yaml')
    refused(ctc(*again, cwd=tmp_path), 'mine/arm.yaml: exists already')
    assert ctc(*again, '--overwrite', cwd=tmp_path).returncode == 0


def test_what_has_no_motion_is_refused(tmp_path: Path) -> None:
    """A robot without joints, and one that its drives cannot hold."""
    weak, fixed = tmp_path / 'weak.urdf', tmp_path / 'fixed.urdf'
    weak.write_text(two_links().replace('effort="', 'effort="0.0001" was="'))
    fixed.write_text('<robot name="r"><link name="base"/></robot>')
    refused(ctc('new-robot', '--urdf', weak, '--out', tmp_path / 'a.yaml'),
            'the motion takes', 'allows 0.0001')
    refused(ctc('new-robot', '--urdf', fixed, '--out', tmp_path / 'a.yaml'), 'joint_names')
    refused(ctc('new-robot', '--urdf', weak, '--joints', 'a,elbow', '--out', tmp_path / 'a.yaml'),
            'elbow')
    refused(ctc('new-robot'), '--urdf')
    assert not (tmp_path / 'a.yaml').exists()

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

"""Samples of a run as CSV and NumPy files."""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path

from ctc_chattering.analysis.export import export
from ctc_chattering.analysis.result import Result
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation.closed_loop import Run
from made_up_runs import made_up
import numpy as np
import pytest

GANTRY = """<robot name="gantry"><link name="base"/><link name="beam"/><link name="arm"/>
<joint name="rail, long" type="prismatic"><parent link="base"/><child link="beam"/></joint>
<joint name="elbow" type="continuous"><parent link="beam"/><child link="arm"/></joint></robot>"""


@pytest.fixture
def gantry() -> Result:
    """Return made-up samples of a joint that slides and one that turns."""
    x = np.random.default_rng(1).normal(size=(7, 5, 2))
    x[5, 2, 0] = np.nan
    config = ControllerConfig(model='urdf', joint_names=('rail, long', 'elbow'), ka=(3.0, 4.0),
                              switching='implicit_observer')
    return Result('gantry', [(0.0, config)], Run(np.arange(5) / 10, *x),
                  dataclasses.replace(made_up(2, 5).terms, t=np.arange(5) / 10), GANTRY)


def test_a_csv_file_has_a_column_per_joint_and_quantity(gantry: Result, tmp_path: Path) -> None:
    with pytest.raises(CtcError, match='nowhere'):
        export(gantry, tmp_path / 'nowhere' / 'a.csv')
    export(gantry, tmp_path / 'a.csv')
    with (tmp_path / 'a.csv').open(newline='', encoding='utf-8') as file:
        heads, *rows = csv.reader(file)
    assert heads == [
        't [s]', 'q_rail, long [m]', 'q_elbow [rad]', 'dq_rail, long [m/s]', 'dq_elbow [rad/s]',
        'q_d_rail, long [m]', 'q_d_elbow [rad]', 'dq_d_rail, long [m/s]', 'dq_d_elbow [rad/s]',
        'ddq_d_rail, long [m/s²]', 'ddq_d_elbow [rad/s²]', 'tau_rail, long [N]',
        'tau_elbow [N·m]', 'v_rail, long [m/s]', 'v_elbow [rad/s]']
    table = np.array(rows, float)
    run = gantry.run
    for k, name in enumerate(('q', 'dq', 'q_d', 'dq_d', 'ddq_d', 'tau', 'v')):
        np.testing.assert_array_equal(table[:, 1 + 2 * k:3 + 2 * k], getattr(run, name))
    assert table[:, 0].tolist() == run.t.tolist()


def test_a_numpy_file_has_the_arrays_and_gains(gantry: Result, tmp_path: Path) -> None:
    export(gantry, tmp_path / 'a.npz')
    with np.load(tmp_path / 'a.npz') as found:
        assert 'correction' not in found
        for name in {*vars(gantry.run)} - {'correction'}:
            array = getattr(gantry.run, name)
            np.testing.assert_array_equal(found[name], array)
        assert [found[x].tolist() for x in ('joint_names', 'torque_units', 'ka', 'switching')] == [
            ['rail, long', 'elbow'], ['N', 'N·m'], [3.0, 4.0], 'implicit_observer']


def test_the_desired_motion_is_exported_without_its_correction(
        gantry: Result, tmp_path: Path) -> None:
    correction = np.random.default_rng(2).normal(size=(5, 3, 2))
    learned = dataclasses.replace(
        gantry, run=dataclasses.replace(gantry.run, correction=correction))
    for name in ('a.npz', 'a.csv'):
        export(learned, tmp_path / name)
    with np.load(tmp_path / 'a.npz') as found:
        np.testing.assert_array_equal(found['q_d'], gantry.q_d - correction[:, 0])
        np.testing.assert_array_equal(found['correction'], correction)
        np.testing.assert_array_equal(found['q_d'] - found['q'], learned.e)
    table = np.loadtxt(tmp_path / 'a.csv', delimiter=',', skiprows=1, usecols=range(7, 9),
                       converters=float, encoding='utf-8', quotechar='"')
    assert table.shape == (5, 2)

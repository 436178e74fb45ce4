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

"""Runs in files: exact samples, those that a page reads, and names that tell runs apart."""

from __future__ import annotations

import base64
import csv
import dataclasses
import json
from pathlib import Path
import re
from typing import Any

from ctc_chattering import write_runs
from ctc_chattering.analysis.result import (
    colours,
    export,
    gains,
    LAW_COLOURS,
    names,
    PARTS,
    Result,
)
from ctc_chattering.analysis.run_page import write_samples
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.simulation.closed_loop import Run
from made_up_runs import made_up
import numpy as np
import pytest


def test_a_page_with_figures_numbers_and_samples(tmp_path: Path) -> None:
    results = [made_up(1, 50)]
    out = tmp_path / 'a' / 'out'
    write_runs(results, str(out), [tmp_path / 'one'], command='mine')
    page = (out / 'index.html').read_text(encoding='utf-8')
    assert all(x in page for x in ('href="../../one"', '<code>mine</code>'))
    assert len(json.loads((out / 'metrics.json').read_text(encoding='utf-8'))['runs']) == 1
    assert len(list((out / 'samples').iterdir())) == 1
    assert len(list((out / 'figures').glob('*.svg'))) == 3
    with pytest.raises(CtcError, match='exists already'):
        write_runs(results, out)


def test_what_is_no_result_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    out = tmp_path / 'out'
    for results, bags, extra, words in (
            ([], (), 'svg', 'results'),
            ([made_up(1, 9)], ['a', 'b'], 'svg', 'none, or 1, one of each'),
            ([made_up(1, 9)], (), 'jpg', 'svg | pdf | png')):
        with pytest.raises(ParameterError, match=words):
            write_runs(results, out, bags, extra)
    assert not out.exists()


def run(source: str = '', **values: Any) -> Result:
    config = dataclasses.replace(ControllerConfig(), **values)
    return Result('trial', [(0.0, config)], Run(np.zeros(1), *[np.zeros((1, 2))] * 7),
                  source=source)


def test_what_differs_is_named() -> None:
    assert names([run(), run(law='compensation'), run(switching='implicit')]) == [
        'trial: chattering', 'trial: compensation', 'trial: chattering (implicit)']
    assert names([run(ka=(8.0, 8.0)), run(ka=(8.0, 9.0), kp=(50.0, 50.0))]) == [
        'trial: chattering, kp 100, ka 8', 'trial: chattering, kp 50, ka 8/9']
    assert names([run('a'), run('b')]) == ['trial: chattering, bag a', 'trial: chattering, bag b']
    assert names([run('a')]) == ['trial: chattering']
    kinds = ('sign', 'implicit', 'implicit_observer')
    configs = [(0.1 * k, ControllerConfig(switching=kind)) for k, kind in enumerate(kinds)]
    assert names([dataclasses.replace(run(), configs=configs[:k]) for k in (2, 3)]) == [
        'trial: chattering (sign → implicit)', 'trial: chattering (several switchings)']
    results = [run(), run(), run('a'), run('a'), run('a', ka=(1.0, 1.0)), run(b=2.0)]
    assert len(set(names(results))) == len(results)


def test_colours_differ_within_an_experiment() -> None:
    results = [run(), run(law='compensation'), run('a'), run('b')]
    found = colours([*results, dataclasses.replace(results[0], experiment='other')])
    assert found[:2] == [LAW_COLOURS['chattering'], LAW_COLOURS['compensation']]
    assert len(set(found[:4])) == 4
    assert not {*found[2:4]} & {*LAW_COLOURS.values()}  # Shades, no other law's colour.
    assert found[4] == found[0]


def test_gains_on_a_line() -> None:
    assert gains(run(switching='implicit_observer', ka=(8.0, 9.0))) == (
        'kp 100, kv 50, ka 8/9, lambda 10, b 1, observer_bandwidth 200, control_period 0.001')
    assert 'ka' not in gains(run(law='compensation'))


def columns(path: Path) -> dict[tuple[str, int], Any]:
    """Return the columns of a file by signal and joint, read as the page does."""
    found = re.fullmatch(r'ctcSamples\["([\w.-]+)"\] = "([\w+/=]+)";\n', path.read_text())
    assert found is not None and found[1] == path.stem
    data = base64.b64decode(found[2])
    size = int.from_bytes(data[:4], 'little')
    head, at, result = json.loads(data[4:4 + size]), -(-(4 + size) // 8) * 8, {}
    for name, joint, width in head['columns']:
        result[name, joint] = np.frombuffer(data, f'<f{width}', head['count'], at)
        at += -(-width * head['count'] // 8) * 8
    return result


def test_runs_of_an_experiment_are_plotted_together(tmp_path: Path) -> None:
    one, two = made_up(2), made_up(2, law='compensation')
    other = dataclasses.replace(one, experiment='</script>')
    plots = write_samples([one, other, two], tmp_path)
    assert [[run.name for run in x.runs] for x in plots] == [
        ['chattering', 'compensation'], ['chattering']]
    assert len({run.path for x in plots for run in x.runs}) == len(list(tmp_path.iterdir())) == 3
    found = columns(plots[0].runs[1].path)
    assert np.array_equal(found['q', 1], two.run.q[:, 1])
    assert np.allclose(found['e', 1], 0.1, rtol=1e-6)
    assert np.array_equal(found['torque', 0], two.run.tau[:, 0].astype('f4'))
    assert np.array_equal(found['V', 0], two.terms.lyapunov.astype('f4'))
    # The parts of the torque only where the run is alone; as published, so that they add up.
    alone = columns(plots[1].runs[0].path)
    assert ('robust', 0) not in found and ('robust', 0) in alone
    parts = other.terms
    total = (parts.nominal - parts.compensation - parts.robust)[:, 1]
    assert sum(alone[x, 1] for x in PARTS) == pytest.approx(total, rel=1e-5, abs=1e-5)


def test_a_page_says_what_it_does_not_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch
                                           ) -> None:
    (plots,) = write_samples([made_up(2)], tmp_path)
    assert 'Too long' not in plots.caption
    monkeypatch.setattr('ctc_chattering.analysis.run_page.MOST', 1000)
    (plots,) = write_samples([made_up(2)], tmp_path)
    assert 'Too long to show all: friction: chattering to 0.' in plots.caption
    found = columns(plots.runs[0].path)['t', 0]
    assert np.array_equal(found, made_up(2).run.t[:len(found)]) and 50 < len(found) < 200


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
    return Result('gantry', [(0.0, config)], Run(np.arange(5) / 10, *x), None, GANTRY)


def test_csv(gantry: Result, tmp_path: Path) -> None:
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


def test_npz(gantry: Result, tmp_path: Path) -> None:
    export(gantry, tmp_path / 'a.npz')
    with np.load(tmp_path / 'a.npz') as found:
        for name, array in vars(gantry.run).items():
            np.testing.assert_array_equal(found[name], array)
        assert [found[x].tolist() for x in (
            'joint_names', 'position_units', 'torque_units', 'ka', 'switching')] == [
            ['rail, long', 'elbow'], ['m', 'rad'], ['N', 'N·m'], [3.0, 4.0], 'implicit_observer']


def test_a_file_that_cannot_be_written(gantry: Result, tmp_path: Path) -> None:
    for name in ('file.csv', 'file.npz'):
        with pytest.raises(CtcError, match='nowhere'):
            export(gantry, tmp_path / 'nowhere' / name)

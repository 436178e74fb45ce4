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

"""Runs with their numbers, terms of the law and names; their files, exact or for a page."""

from __future__ import annotations

import csv
import dataclasses
import json
from pathlib import Path
from typing import Any

from ctc_chattering import write_runs
from ctc_chattering.analysis import result as analysis
from ctc_chattering.analysis.run_page import write_samples
from ctc_chattering.analysis.signals import PARTS, SignalOrigin
from ctc_chattering.analysis.terms import terms
from ctc_chattering.configuration import parameter_file
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.simulation import closed_loop
from ctc_chattering.simulation.closed_loop import Event, Run
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
from made_up_runs import made_up
import numpy as np
from oracles import paper_c, paper_g, paper_m
from page_samples import columns
import pytest

#: As in metrics.json, by contract.
KEYS = ['experiment', 'law', 'switching', 'control_period_s', 'window_s', 'rms_error_rad',
        'max_error_norm1_rad', 'rms_torque_nm', 'torque_variation_nm_per_s',
        'max_torque_step_nm', 'max_torque_rate_nm_per_s', 'reaching_time_s', 'bag', 'joint_names',
        'position_units', 'torque_units', 'gains', 'missing_samples', 'term_at_bound', 'origins',
        'notes']


def result_of(duration: float, *events: str, **controller: object) -> analysis.Result:
    return analysis.simulate(parameter_file.load(None, {
        'plant': {'duration': duration, 'experiment': 'trial'}, 'controller': controller,
        '/**': {'control_period': 0.002}, 'bringup': {'events': list(events)}}))


def notes_with_errors(*rms_errors: float, amplitude: float = 0.5, law: str = 'compensation'
                      ) -> list[str]:
    """Return the notes on a sinusoid with constant errors."""
    t = np.linspace(0.0, 10.0, 10_001)
    q_d = amplitude * np.sin(2.0 * t)[:, None] + np.zeros(2)
    zero = np.zeros_like(q_d)
    config = ControllerConfig(law=law)
    run = Run(t, q_d - np.array(rms_errors), zero, q_d, zero, zero, zero, zero)
    computed = terms(run, [(0.0, config)], model_of(config))
    notes: list[str] = analysis.Result('trial', [(0.0, config)], run, computed).metrics()['notes']
    return [x for x in notes if 'amplitude of the motion' in x]


def test_an_error_that_is_a_large_part_of_the_motion_is_said() -> None:
    """Beyond a tenth of the amplitude, half the range; a joint that is to rest has none."""
    assert not notes_with_errors(0.049, 0.0)
    assert notes_with_errors(0.051, 0.0) == [
        'joint1: the RMS error is 10 % of the amplitude of the motion. Choose a law that takes '
        'friction into account (docs/laws.md), or raise kp and kv']
    assert notes_with_errors(0.078, 0.2, law='chattering') == [
        'joint1, joint2: the RMS error is 16 to 40 % of the amplitude of the motion. Set ka above '
        'friction and disturbance, or raise kp and kv']
    assert not notes_with_errors(0.078, 0.078, amplitude=0.0)


def test_keys_are_the_contract_s() -> None:
    m = result_of(5.5, law='compensation').metrics()
    assert sorted(m) == sorted(KEYS)
    assert [m[x] for x in ('experiment', 'law', 'control_period_s', 'switching', 'window_s')] == [
        'trial', 'compensation', 0.002, 'sign', [5.0, 10.0]]
    per_joint = [m[key] for key in KEYS if key.startswith(('rms', 'torque_v', 'max_t'))]
    assert all(len(x) == 2 and all(y > 0.0 for y in x) for x in per_joint)
    assert m['max_error_norm1_rad'] > 0.0


def test_label_slug_and_changes() -> None:
    plain = result_of(0.1, law='compensation')
    assert (plain.label, plain.slug, plain.changes) == (
        'trial: compensation', 'trial_compensation', [])
    assert repr(plain) == (
        '<trial: compensation: 51 samples, RMS error 2.85 1.47 from 0.05 to 0.1 s>')
    result = result_of(
        0.1, '0.02 controller law chattering', '0.03 controller switching implicit',
        '0.04 controller ka [1.0, 2.0]', '0.06 controller law compensation',
        '0.07 plant coulomb_friction [0.0, 0.0]', law='compensation')
    assert result.label == 'trial: compensation → chattering → compensation'
    assert result.slug == 'trial'
    assert result.changes == [(0.02, 'chattering'), (0.06, 'compensation')]
    assert result.marks == [(0.02, 'chattering'), (0.03, 'implicit'), (0.06, 'compensation')]
    assert result.metrics()['law'] == result.law == 'compensation'
    assert [t for t, _ in result.configs] == [0.0, 0.02, 0.03, 0.04, 0.06]
    assert result.configs[3][1].ka == (1.0, 2.0)


def test_simulated_is_the_core_s_simulation() -> None:
    setup = parameter_file.load(None, {'plant': {'duration': 0.1}, 'bringup': {
        'events': ['0.03 controller law compensation', '0.05 plant coulomb_friction [1, 2]']}})
    seen: list[float] = []
    result = analysis.simulate(setup, seen.append)
    expected = closed_loop.simulate(setup.plant, setup.controller, setup.reference, setup.events)
    for field in dataclasses.fields(expected):
        np.testing.assert_array_equal(
            getattr(result.run, field.name), getattr(expected, field.name))
    assert seen == sorted(seen) and seen[-1] == pytest.approx(0.1)
    np.testing.assert_array_equal(result.terms.tau, result.run.tau)


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


def run(source: str = '', **values: Any) -> analysis.Result:
    config = dataclasses.replace(ControllerConfig(), **values)
    made = Run(np.zeros(1), *[np.zeros((1, 2))] * 7)
    return analysis.Result('trial', [(0.0, config)], made, source=source)


def test_what_differs_is_named() -> None:
    assert analysis.names([run(), run(law='compensation'), run(switching='implicit')]) == [
        'trial: chattering', 'trial: compensation', 'trial: chattering (implicit)']
    assert analysis.names([run(ka=(8.0, 8.0)), run(ka=(8.0, 9.0), kp=(50.0, 50.0))]) == [
        'trial: chattering, kp 100, ka 8', 'trial: chattering, kp 50, ka 8/9']
    assert analysis.names([run('a'), run('b')]) == [
        'trial: chattering, bag a', 'trial: chattering, bag b']
    assert analysis.names([run('a')]) == ['trial: chattering']
    kinds = ('sign', 'implicit', 'implicit_observer')
    configs = [(0.1 * k, ControllerConfig(switching=kind)) for k, kind in enumerate(kinds)]
    assert analysis.names([dataclasses.replace(run(), configs=configs[:k]) for k in (2, 3)]) == [
        'trial: chattering (sign → implicit)', 'trial: chattering (several switchings)']
    results = [run(), run(), run('a'), run('a'), run('a', ka=(1.0, 1.0)), run(b=2.0)]
    assert len(set(analysis.names(results))) == len(results)


def test_colours_differ_within_an_experiment() -> None:
    results = [run(), run(law='compensation'), run('a'), run('b')]
    found = analysis.colours([*results, dataclasses.replace(results[0], experiment='other')])
    assert found[:2] == [analysis.LAW_COLOURS['chattering'], analysis.LAW_COLOURS['compensation']]
    assert len(set(found[:4])) == 4
    assert not {*found[2:4]} & {*analysis.LAW_COLOURS.values()}  # Shades, no other law's colour.
    assert found[4] == found[0]


def test_gains_on_a_line() -> None:
    assert analysis.gains(run(switching='implicit_observer', ka=(8.0, 9.0))) == (
        'kp 100, kv 50, ka 8/9, lambda 10, b 1, observer_bandwidth 200, control_period 0.001')
    assert 'ka' not in analysis.gains(run(law='compensation'))


def test_runs_of_an_experiment_are_plotted_together(tmp_path: Path) -> None:
    one, two = made_up(2), made_up(2, law='compensation')
    other = dataclasses.replace(one, experiment='</script>')
    plots = write_samples([one, other, two], tmp_path)
    assert [[run.name for run in x.runs] for x in plots] == [
        ['chattering', 'compensation'], ['chattering']]
    assert len({run.path for x in plots for run in x.runs}) == len(list(tmp_path.iterdir())) == 3
    found = columns(plots[0].runs[1].path)
    assert np.abs(found['q_d', 1] - two.run.q_d[:, 1]).max() < 1e-9
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


def test_samples_of_a_long_run_are_rounded(tmp_path: Path) -> None:
    """Check by how much, what the caption says, and half the bytes."""
    rng = np.random.default_rng(4)
    made = made_up(2, 80_000)
    t = made.run.t + rng.normal(scale=1e-5, size=80_000)
    noisy = dataclasses.replace(made, run=dataclasses.replace(
        made.run, t=t, tau=made.run.tau + rng.normal(size=(80_000, 2))))
    exact, rounded = noisy, dataclasses.replace(noisy, law_terms=dataclasses.replace(
        made.terms, t=t))
    (short,), (long,) = (write_samples([x], tmp_path / str(k)) for k, x in enumerate(
        (dataclasses.replace(exact, law_terms=made_up(2, 100).terms), rounded)))
    assert 'rounded' not in short.caption
    assert 'Values of friction: chattering are rounded by at most 2e-5 of each' in long.caption
    one, two = (columns(x.runs[0].path) for x in (short, long))
    assert np.array_equal(one['t', 'e'], t)
    assert np.abs(two['t', 'e'] - t).max() < 5e-7
    tau = noisy.run.tau[:, 1]
    assert np.array_equal(one['torque', 1], tau.astype('f4'))
    assert (np.abs(two['torque', 1] - tau) <= 1.6e-5 * np.abs(tau)).all()
    numbers = [sum(x.size for x in found.values()) for found in (one, two)]
    sizes = [x.runs[0].path.stat().st_size / n for x, n in zip((short, long), numbers)]
    assert sizes[1] < 0.8 * sizes[0] < 4.0


GANTRY = """<robot name="gantry"><link name="base"/><link name="beam"/><link name="arm"/>
<joint name="rail, long" type="prismatic"><parent link="base"/><child link="beam"/></joint>
<joint name="elbow" type="continuous"><parent link="beam"/><child link="arm"/></joint></robot>"""


@pytest.fixture
def gantry() -> analysis.Result:
    """Return made-up samples of a joint that slides and one that turns."""
    x = np.random.default_rng(1).normal(size=(7, 5, 2))
    x[5, 2, 0] = np.nan
    config = ControllerConfig(model='urdf', joint_names=('rail, long', 'elbow'), ka=(3.0, 4.0),
                              switching='implicit_observer')
    return analysis.Result('gantry', [(0.0, config)], Run(np.arange(5) / 10, *x),
                           dataclasses.replace(made_up(2, 5).terms, t=np.arange(5) / 10), GANTRY)


def test_csv(gantry: analysis.Result, tmp_path: Path) -> None:
    with pytest.raises(CtcError, match='nowhere'):
        analysis.export(gantry, tmp_path / 'nowhere' / 'a.csv')
    analysis.export(gantry, tmp_path / 'a.csv')
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


def test_npz(gantry: analysis.Result, tmp_path: Path) -> None:
    analysis.export(gantry, tmp_path / 'a.npz')
    with np.load(tmp_path / 'a.npz') as found:
        for name, array in vars(gantry.run).items():
            np.testing.assert_array_equal(found[name], array)
        assert [found[x].tolist() for x in ('joint_names', 'torque_units', 'ka', 'switching')] == [
            ['rail, long', 'elbow'], ['N', 'N·m'], [3.0, 4.0], 'implicit_observer']


CONTROLLER = ControllerConfig(
    kp=(90.0, 20.0, 20.0, 130.0), kv=(40.0, 5.0, 5.0, 60.0), effort_limit=(300.0, 300.0))
PLANT = PlantConfig(duration=1.0, disturbance_amplitude=(1.0, 1.0),
                    disturbance_frequency=(1.0, 2.0))


def _run(*events: Event) -> Run:
    return closed_loop.simulate(PLANT, CONTROLLER, ReferenceConfig(), events)


def test_bit_for_bit_through_events() -> None:
    """Check a law, gains and a filter that change in the run, given in any order."""
    changes: list[tuple[float, dict[str, Any]]] = [
        (0.4, {'law': 'compensation'}), (0.2005, {'kp': [50.0, 60.0], 'lambda': 3.0}),
        (0.7, {'law': 'chattering', 'ka': [20.0, 5.0]})]
    run = _run(*(Event(t, 'controller', values) for t, values in changes))
    configs, config = [(0.0, CONTROLLER)], CONTROLLER
    for t, values in sorted(changes, key=lambda change: change[0]):
        config = config.changed(values)
        configs.append((t, config))
    found = terms(run, configs[::-1])
    assert (found.tau == run.tau).all()
    assert (found.v == run.v).all()
    off = (run.t >= 0.4) & (run.t < 0.7)
    assert (found.robust[off] == 0.0).all()
    assert (found.robust[~off] != 0.0).any(axis=1).all()
    assert not (terms(run, [(0.0, CONTROLLER)]).tau == run.tau).all()


def test_parts_are_the_equations() -> None:
    """Check every term of law (6) and V of (9) against numpy at each sample."""
    run = closed_loop.simulate(PLANT, ControllerConfig(), ReferenceConfig())
    found = terms(run, [(0.0, ControllerConfig())])
    for k in range(0, len(run.t), 7):
        q, dq, v = run.q[k].tolist(), run.dq[k].tolist(), run.v[k]
        a = run.ddq_d[k] + 50 * (run.dq_d[k] - dq) + 100 * (run.q_d[k] - q)
        np.testing.assert_allclose(
            found.nominal[k], paper_m(q) @ a + paper_c(q, dq) @ dq + paper_g(q),
            rtol=1e-11, atol=1e-10)
        np.testing.assert_allclose(found.compensation[k], paper_c(q, dq) @ v, atol=1e-11)
        np.testing.assert_allclose(found.robust[k], 10.0 * np.sign(v))
        assert found.lyapunov[k] == pytest.approx(0.5 * v @ paper_m(q) @ v)
    np.testing.assert_allclose(
        found.tau, found.nominal - found.compensation - found.robust, atol=1e-9)


def test_samples_that_were_never_sent() -> None:
    """Check that the law went on by the stamps of the others, to the last bit."""
    config = dataclasses.replace(CONTROLLER, switching='implicit_observer')
    run = closed_loop.simulate(
        dataclasses.replace(PLANT, sample_loss=0.3), config, ReferenceConfig())
    assert 500 < len(run.t) < 900
    found = terms(run, [(0.0, config)])
    assert (found.tau == run.tau).all() and (found.v == run.v).all()
    assert found.t is run.t and found.origin is SignalOrigin.COMPUTED

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

"""The scripts of `examples/`, run as a user runs them; its law and its switching."""

from __future__ import annotations

from pathlib import Path
import re
import subprocess
import sys

from ctc_chattering import load_parameters
from ctc_chattering.analysis.result import simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.simulation.closed_loop import Run
from identified_bags import recorded_bag, short
from machine_code import compile_runs
import numpy as np
from oracles import paper_c, paper_g, paper_m
import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / 'examples'


def said(name: str, beside: Path, *arguments: object) -> str:
    """Return what a script prints; it runs in a directory of its own."""
    return subprocess.run(
        [sys.executable, EXAMPLES / f'{name}.py', *map(str, arguments)], cwd=beside, text=True,
        capture_output=True, check=True).stdout


@pytest.mark.slow
def test_the_paper_has_the_numbers_of_the_readme(tmp_path: Path) -> None:
    text = said('paper', tmp_path)
    assert re.findall(r'error ([\d.e-]+), ([\d.e-]+) rad', text) == [
        ('2.86e-03', '4.63e-02'), ('4.57e-05', '4.91e-04')]
    assert 'error of joint 2 by 94' in text
    assert {f'(figure {i} of the paper)' in text for i in range(2, 6)} == {True}
    assert (tmp_path / 'paper' / 'friction_chattering_tracking.svg').is_file()


def test_the_own_law_learns_what_the_law_without_memory_does_not(tmp_path: Path) -> None:
    errors = {law: (float(a), float(b)) for law, a, b in re.findall(
        r'^(\S+) +RMS error (\S+), (\S+) rad$', said('own_law', tmp_path), re.MULTILINE)}
    own, without = errors['__main__:LeakyIntegral'], errors['compensation']
    assert set(errors) == {'compensation', 'integral', '__main__:LeakyIntegral'}
    assert own[0] < 0.5 * without[0] and own[1] < 0.8 * without[1]


@pytest.mark.slow
def test_the_own_robot_passes_its_checks_and_is_moved(tmp_path: Path) -> None:
    text = said('own_robot', tmp_path)
    assert text.count('ok ') == 9 and 'FAILED' not in text
    (weak, strong) = [[float(x) for x in re.findall(r'([\d.e-]+) rad', line)]
                      for line in text.splitlines()[-2:]]
    assert all(b < 0.1 * a for a, b in zip(weak, strong))


@pytest.mark.slow
def test_a_bag_becomes_gains(tmp_path: Path) -> None:
    made = short()
    text = said('bag_to_gains', tmp_path, recorded_bag(tmp_path / 'run', made), 'two_link')
    found = [float(x) for x in re.findall(r'^Coulomb friction ([\d.]+)', text, re.MULTILINE)]
    assert found == pytest.approx(made.plant.coulomb_friction, rel=0.02)
    setup = load_parameters(tmp_path / 'gains' / 'identified.yaml')
    assert setup.plant.coulomb_friction == pytest.approx(found, rel=0.01)
    assert max(map(float, re.findall(r"'([\d.e-]+) rad'", text))) < 1e-2


@pytest.mark.slow
def test_polars_reads_the_map(tmp_path: Path) -> None:
    """Law (6) fails where Ka is below friction, and where the other law fails it need not."""
    text = said('map_polars', tmp_path)
    table = [[x.strip() for x in line.split('┆')] for line in text.splitlines() if '┆' in line]
    failed = {(row[0].strip('│ '), float(row[1])): float(row[3].strip('│ '))
              for row in table if row[0].strip('│ ') in ('chattering', 'compensation')}
    assert len(failed) == 8
    assert failed['compensation', 20.0] == 1.0 > failed['chattering', 20.0] > 0.0
    least = [float(row[1].strip('│ ')) for row in table if len(row) == 2 and row[1][0].isdigit()]
    assert least == sorted(least) and least[-1] >= 20.0


def test_every_example_is_in_the_list() -> None:
    text = (EXAMPLES / 'README.md').read_text(encoding='utf-8')
    assert set(re.findall(r'\[(\w+\.py)\]', text)) == {x.name for x in EXAMPLES.glob('*.py')}


@pytest.fixture(autouse=True)
def _found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))


@pytest.mark.slow
@pytest.mark.parametrize('values', [
    {'law': 'own_law:LeakyIntegral', 'ki': [400.0, 400.0]},
    {'law': 'chattering', 'switching': 'own_switching:Smooth'}])
def test_the_same_run_compiled(values: dict[str, object]) -> None:
    def run(values: dict[str, object], plain: bool = False) -> Run:
        setup = parameter_file.load(config_directory() / 'friction.yaml', {
            'plant': {'duration': 0.5, 'compiled': not plain},
            'controller': {**values, 'compiled': not plain}})
        compile_runs(setup)
        found = simulate(setup).run
        assert found.compiled != plain
        return found
    plain, found, without = run(values, True), run(values), run({'law': 'compensation'})
    np.testing.assert_allclose(found.tau, plain.tau, rtol=1e-9, atol=1e-9)
    assert np.abs(without.tau - found.tau).max() > 1.0


def test_the_terms_by_hand() -> None:
    rng = np.random.default_rng(1)
    q, dq, q_d, dq_d, ddq_d = rng.normal(size=(5, 2))
    M, C, G, h = paper_m(q), paper_c(q, dq), paper_g(q), 1e-3
    own = Controller(ControllerConfig(law='own_law:LeakyIntegral'))
    e, de = q_d - q, dq_d - dq
    N = M @ (ddq_d + 50.0 * de + 100.0 * e) + C @ dq + G
    np.testing.assert_allclose(own.step(q, dq, q_d, dq_d, ddq_d).tau, N)
    P = h * 100.0 * M @ (de + 2.0 * e)
    np.testing.assert_allclose(own.step(q, dq, q_d, dq_d, ddq_d).tau, N + P)
    smooth = Controller(ControllerConfig(switching='own_switching:Smooth'))
    np.testing.assert_allclose(smooth.step(q, dq, q_d, dq_d, ddq_d).tau,
                               N + C @ de - 10.0 * np.tanh(-de / 0.05))

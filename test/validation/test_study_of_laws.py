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

"""The study of the laws: its numbers, its table, and what is recommended."""

import csv
import io
import math
from pathlib import Path

from ctc_chattering.analysis.metrics import metrics
from ctc_chattering.runs.recommended import recommended_setup
from ctc_chattering.runs.score import Score
from ctc_chattering.simulation.closed_loop import simulate
from imperfections import Case, CaseOutcome, ratio, run_cases
from imperfections import EVERY_LAW as LAWS
from imperfections_page import OF_LAWS as LAW_KIND
from imperfections_page import to_markdown, write_study
import pytest

LAG = Case('2 ms', 'Drive lag', {
    'plant': {'duration': 1.0, 'actuator_lag': [2e-3, 2e-3], 'torque_rate_limit': [5e3, 1e3],
              'compiled': False},
    'controller': {'law': 'chattering', 'ka': [12.0, 12.0]}})


def made_up(law: str, first: float, second: float) -> CaseOutcome:
    """Return the outcome of a run that was not made."""
    return CaseOutcome(LAG, law, 1e-3, (12.0, 12.0), Score(
        rms=(first, second), variation=(1.0, 1.0)))


def test_the_numbers_are_those_of_the_simulation() -> None:
    """Check two laws against a simulation of their own, on drives that the law knows."""
    found = list(run_cases([LAG], ('compensation', 'observer_feedback')))
    setup = LAG.setup()
    errors = []
    for law in ({'law': 'compensation'}, {
            'law': 'observer_feedback', 'kp': [1e4, 1e4], 'kv': [200.0, 200.0],
            'estimator_bandwidth': 200.0, 'ka': found[1].ka, 'actuator_lag': [2e-3, 2e-3],
            'torque_rate_limit': [5e3, 1e3]}):
        run = simulate(setup.plant, setup.controller.changed(law), setup.reference, truth=True)
        errors.append(metrics(run, (0.5, 1.0))['rms_error_rad'])
    for o, error in zip(found, errors, strict=True):
        assert o.score.rms == pytest.approx(error, rel=5e-3)
    assert ratio(found[1], found[0]) == pytest.approx(
        max(a / b for a, b in zip(errors[1], errors[0])), rel=5e-3)


def test_what_is_worse_is_bold() -> None:
    failed = CaseOutcome(
        LAG, 'super_twisting', 1e-3, (12.0, 12.0), Score(failure='diverged'))
    text = to_markdown(LAW_KIND, [
        made_up('compensation', 2.0, 4.0), made_up('integral', 1.0, 3.0),
        made_up('pd_gravity', 1.0, 5.0), failed])
    assert text.splitlines()[-1] == '| Drive lag: 2 ms | 0.75 | **1.2** | **inf** |'
    assert ratio(failed, failed) == math.inf


@pytest.mark.parametrize('h, lag, delay, pole', [
    (1e-3, 0.0, 0, 100.0), (1e-3, 2e-3, 1, 100.0), (1e-2, 0.0, 0, 40.0),
    (2e-3, 6e-3, 2, 100.0 / 3.0)])
def test_gains_follow_what_is_slow(h: float, lag: float, delay: int, pole: float) -> None:
    """Check p (T + h (1 + delay)) <= 0.4, and what is made of p."""
    case = Case('x', 'y', {'/**': {'control_period': h}, 'controller': {'input_delay': delay},
                           'plant': {'actuator_lag': [lag, lag], 'duration': 1.0}})
    config = recommended_setup(case.setup(), 'observer_feedback').controller
    assert (config.kp[0], config.kv[0]) == pytest.approx((pole ** 2, 2.0 * pole))
    assert config.estimator_bandwidth == pytest.approx(2.0 * pole)
    coarse = Case('x', 'y', {**case.overrides, 'plant': {
        **case.overrides['plant'], 'encoder_resolution': [1e-4, 0.0]}})
    assert recommended_setup(coarse.setup(), 'observer_feedback'
                             ).controller.estimator_bandwidth == pytest.approx(pole)
    setup = recommended_setup(case.setup(), 'integral')
    p = 0.6 * pole
    assert (setup.controller.kp[0], setup.controller.kv[0], setup.controller.ki[0]
            ) == pytest.approx((3.0 * p ** 2, 3.0 * p, p ** 3))
    assert setup.reference.start_duration == 2.0


def test_what_a_lab_knows_is_given() -> None:
    """Check friction, lag and rate, and that every law can be recommended."""
    for law in LAWS:
        config = recommended_setup(LAG.setup(), law).controller
        assert (config.law, config.actuator_lag) == (law, (2e-3, 2e-3))
        assert config.friction_level == (
            (9.9, 9.9) if law in ('slotine_li', 'friction_feedforward') else (0.0, 0.0))


def test_files_have_every_law(tmp_path: Path) -> None:
    write_study(list(run_cases([LAG], LAWS)), tmp_path)
    assert [x.name for x in (tmp_path / 'laws_figures').iterdir()] == ['imperfections.png']
    page = (tmp_path / 'laws.html').read_text(encoding='utf-8').replace('<wbr>', '')
    assert 'src="laws_figures/imperfections.png"' in page
    assert all(f'<th scope="col" class="n">{x}</th>' in page for x in LAWS[1:])
    assert '](laws_figures/imperfections.png)' in (tmp_path / 'laws.md').read_text()
    lines = list(csv.DictReader(io.StringIO((tmp_path / 'laws.csv').read_text(encoding='utf-8'))))
    assert [line['law'] for line in lines] == list(LAWS)
    heads = (tmp_path / 'laws.md').read_text(encoding='utf-8').splitlines()[4]
    assert heads == '| case | ' + ' | '.join(x for x in LAWS if x != 'compensation') + ' |'

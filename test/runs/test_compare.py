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

"""Laws and cases on robots, joint by joint: their tables, figures and page."""

from __future__ import annotations

from functools import partial
from pathlib import Path
import re
from typing import Any

from ctc_chattering import compare
from ctc_chattering.analysis.result import Result, simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Overrides, Setup
from ctc_chattering.configuration.package_share import config_directory, find_config
from ctc_chattering.control.controller import LAWS
from ctc_chattering.control.controller_config import RIVALS, SWITCHINGS
from ctc_chattering.errors import CtcError
from ctc_chattering.runs import compare_page
from ctc_chattering.runs.compare import (
    BASE,
    evaluate,
    Outcome,
    RECOMMENDED,
    setups,
    Task,
    tasks,
    Variant,
    variants,
)
from ctc_chattering.runs.compare_page import write_parameters
from ctc_chattering.runs.conditions import (
    condition,
    CONDITIONS,
    held_out,
    LOST,
    read_cases,
)
from ctc_chattering.runs.pool import processes
from ctc_chattering.runs.recommended import by_rule, recommended
from ctc_chattering.runs.score import over_simulation, Runner, Score, score
from ctc_commands import ctc, refused
from mujoco_plant import simulated_by_mujoco
import numpy as np
from processes import CONFIG
import pytest
from urdfs import PANDA, UR5

#: Effort limits of the URDFs [N·m].
LIMITS = {'panda': (87.0,) * 4 + (12.0,) * 3, 'ur5': (150.0,) * 3 + (28.0,) * 3}
NAMES = {'panda': PANDA, 'ur5': UR5}
#: What runs a setup, by the plant that moves the robot.
PLANTS: dict[str, Runner] = {
    'builtin': over_simulation, 'mujoco': lambda setup: simulated_by_mujoco(setup, truth=True)}


def compared_robot(robot: str, plant: str) -> None:
    """Run all laws on a robot with the file's gains; every claim about it holds."""
    todo = tasks([CONFIG / f'{robot}.yaml'], [''])
    outcomes = list(map(partial(evaluate, run=PLANTS[plant]), todo))
    assert [x.task.variant for x in outcomes] == variants()
    for outcome in outcomes:
        assert (outcome.experiment, outcome.joints) == (robot, NAMES[robot])
        assert (np.array(measured(outcome).peak) < LIMITS[robot]).all()  # Nothing is cut off.
    assert_gains(outcomes)
    assert_documented(outcomes, 0.05 if plant == 'mujoco' else 0.1)


def assert_gains(outcomes: list[Outcome]) -> None:
    """Check by how much the switchings, and what is recommended, are better than the original."""
    original = measured(outcomes[0])
    for outcome in outcomes:
        variant = outcome.task.variant
        if variant.law == 'chattering' or variant.settings == RECOMMENDED:
            least = min(a / b for a, b in zip(original.rms, measured(outcome).rms))
            claimed = (500.0 if variant.settings == RECOMMENDED else
                       1000.0 if variant.switching == 'implicit_observer' else 10.0)
            assert least >= claimed, outcome


def measured(outcome: Outcome) -> Score:
    assert not outcome.score.failure
    return outcome.score


def simulated_with(path: Path, overrides: Overrides) -> Result:
    return over_simulation(parameter_file.load(path, overrides))


@pytest.mark.slow
@pytest.mark.parametrize(('robot', 'plant'), [
    ('panda', 'mujoco'), ('ur5', 'mujoco'), ('panda', 'builtin'), ('ur5', 'builtin')])
def test_every_switching_wins_ten_times_on_every_joint(robot: str, plant: str) -> None:
    """The claims themselves are in `compared_robot`."""
    compared_robot(robot, plant)


def assert_documented(outcomes: list[Outcome], tolerance: float) -> None:
    """Compare the columns of a robot in validation/README.md, which are of MuJoCo's plant."""
    page = (CONFIG.parent / 'validation' / 'README.md').read_text(encoding='utf-8')
    table = page[page.index('| law | switching |'):].split('\n\n')[0].replace('`', '')
    rows = {tuple(row[:3]): row[3:] for row in map(cells, table.splitlines()[2:])}
    assert list(rows) == variants([law for law in LAWS if law not in RIVALS])
    first = 3 * list(NAMES).index(outcomes[0].experiment)
    original = measured(outcomes[0]).rms
    for outcome in outcomes:
        found = measured(outcome)
        least = min(a / b for a, b in zip(original, found.rms))
        if outcome.task.variant in rows:
            shown = rows[outcome.task.variant][first:first + 3]
            assert [float(x.strip('×')) for x in shown] == pytest.approx(
                [max(found.rms), least, max(found.peak)], rel=tolerance)


def cells(line: str) -> list[str]:
    return [x.strip() for x in line.strip().strip('|').split('|')]


def test_every_variant_is_run() -> None:
    seen: list[Setup] = []
    file = CONFIG / 'friction.yaml'
    result = simulate(parameter_file.load(file))

    def run(setup: Setup) -> Result:
        seen.append(setup)
        return result

    outcomes = list(map(partial(evaluate, run=run), tasks([file], [''])))
    assert [x.runs[0]['controller'] for x in outcomes[:-1]] == [
        {'law': law, **({'switching': switching} if switching else {})}
        for law in LAWS for switching in (SWITCHINGS if law == 'chattering' else [''])]
    assert outcomes[-1].runs[0]['controller'] == recommended(parameter_file.load(file))
    assert [x.controller for x in seen] == [
        parameter_file.load(file, x.runs[0]).controller for x in outcomes]
    assert not any('plant' in x.runs[0] for x in outcomes)
    assert [x.controller for x in setups(tasks([file], ['']))] == [x.controller for x in seen]


def made_up(variant: Variant, rms: float, variation: float, failure: str = '') -> Outcome:
    """Return the outcome of a made-up run of the two-link arm."""
    found = Score((rms, 2.0 * rms), (), (variation, 50.0), (1.0, 2.0), (1e3, 2e3), (9.0, 3.0))
    task = Task(CONFIG / 'friction.yaml', condition(''), variant)
    return Outcome(task, 'friction', ('joint1', 'joint2'), ({},),
                   Score(failure=failure) if failure else found)


def test_the_smallest_of_a_column_is_bold_whoever_has_it() -> None:
    """Check it among numbers that look the same as well, and one that diverged."""
    text = compare_page.to_markdown([
        made_up(BASE, 1e-2, 100.0), made_up(Variant('integral', '', 'file'), 1.0001e-3, 300.0),
        made_up(Variant('pd_gravity', '', 'file'), 1e-3, 200.0),
        made_up(Variant('slotine_li', '', 'file'), 1e-9, 1.0, 'the motion diverged')])
    rows = {cells(line)[0]: cells(line)[3:] for line in text.splitlines()[:9] if '|' in line}
    changes = {cells(line)[0]: cells(line)[3:] for line in text.splitlines()[9:] if '|' in line}
    assert rows['compensation'] == ['1.0e-02', '2.0e-02', '', '**9**']
    assert rows['integral'] == ['1.0e-03', '2.0e-03', '10×', '**9**']
    assert rows['pd_gravity'] == ['**1.0e-03**', '**2.0e-03**', '**10×**', '**9**']
    assert rows['slotine_li'] == ['diverged'] * 4
    assert changes['compensation'] == ['**100** / **1** / **1000**', '**50** / **2** / **2000**']
    assert changes['integral'][0] == '300 / **1** / **1000**'
    assert changes['slotine_li'] == ['diverged'] * 2


@pytest.fixture(scope='module')
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the two-link arm at a coarse step, for little time."""
    file = tmp_path_factory.mktemp('arm') / 'arm.yaml'
    text = (CONFIG / 'friction.yaml').read_text()
    assert 'control_period: 0.001' in text
    assert 'duration: 10.0' in text
    file.write_text(text.replace('control_period: 0.001', 'control_period: 0.01').replace(
        'duration: 10.0', 'duration: 5.2\n    compiled: false'))
    return file


def test_a_condition_has_the_worst_of_its_runs(arm: Path) -> None:
    outcome = evaluate(Task(arm, CONDITIONS['model_error'], Variant('integral', '', 'file')))
    made = [parameter_file.load(arm, x) for x in outcome.runs]
    assert [x.controller.inertia_scale for x in made] == [0.9, 1.1]
    assert outcome.score.rms == tuple(map(max, zip(*(score(x).rms for x in made))))


@pytest.mark.slow
def test_the_number_of_processes_changes_nothing(arm: Path) -> None:
    todo = tasks([arm], ['clean'], ['compensation', 'integral'], RECOMMENDED)
    outcomes = list(map(evaluate, todo))
    with processes(2) as each:
        assert list(each(evaluate, todo)) == outcomes
    assert [x.task.variant.settings for x in outcomes] == ['file', RECOMMENDED, RECOMMENDED]
    for outcome in outcomes:
        again = simulated_with(arm, outcome.runs[0]).metrics()
        assert tuple(again['rms_error_rad']) == measured(outcome).rms


def test_files_of_parameters_give_the_same_run(arm: Path, tmp_path: Path) -> None:
    task = Task(arm, CONDITIONS['real_arm'], Variant('slotine_li', '', RECOMMENDED))
    outcome = evaluate(task)
    write_parameters([outcome], tmp_path)
    paths = sorted(tmp_path.iterdir())
    assert [x.name for x in paths] == [
        f'friction_real_arm_slotine_li_recommended_model_{x}.yaml' for x in ('0.9', '1.1')]
    for path, run in zip(paths, outcome.runs):
        one, other = simulated_with(path, {}).run, simulated_with(arm, run).run
        assert (one.tau == other.tau).all()


def test_held_out_conditions_have_the_gains_of_the_rule_there(arm: Path) -> None:
    """Check what survives, medians with a lost run as the worst, and the gains of each draw."""
    result = over_simulation(parameter_file.load(arm))

    def run(setup: Setup) -> Result:
        if setup.controller.error_limit[0] == LOST:
            seen.append(setup)
            if setup.controller.law == 'integral' and len(seen) == 4:
                raise CtcError('the motion diverged')
        return result

    seen: list[Setup] = []
    todo = tasks([arm], ['clean'], ['integral'], RECOMMENDED, 3, 3)
    outcomes = list(map(partial(evaluate, run=run), todo))
    mine = [x for x in outcomes if x.task.variant.law == 'integral'][1:]
    assert [x.task.condition for x in mine] == list(held_out(3, 3))
    assert [x.score.failure for x in mine] == ['', 'the motion diverged', '']
    own = [x for x in seen if x.controller.law == 'integral']
    for outcome, setup in zip(mine, own, strict=True):
        rule, (made,) = by_rule(setup), outcome.runs
        assert {name: made['controller'][name] for name in rule} == rule
        assert setup.plant.actuator_lag == tuple(made['plant']['actuator_lag'])
    text = compare_page.to_markdown(outcomes)
    (row,) = [cells(x) for x in text.splitlines() if '2 of 3' in x]
    assert row[:5] == ['integral', '', RECOMMENDED, '2 of 3', 'lost']
    assert float(row[5]) == pytest.approx(
        sorted(x.score.error for x in mine)[1], rel=0.06)
    lines = compare_page.to_csv(outcomes).splitlines()
    assert sum(',held_out_3_' in x for x in lines) == 2 * (len(outcomes) - 2)


def test_a_run_that_ends_too_early_is_refused(tmp_path: Path) -> None:
    file = tmp_path / 'short.yaml'
    file.write_text('plant: {ros__parameters: {duration: 0.01}}')
    with pytest.raises(CtcError, match=r'short\.yaml: fewer than two samples from 5 s to 10 s'):
        evaluate(tasks([file], [''])[0])


def test_the_command_prints_the_table_and_writes_it_once(arm: Path, tmp_path: Path) -> None:
    """With files, figures and a page; the same table from the same seed."""
    out = tmp_path / 'out'
    arguments = ('compare', arm, '--condition', 'clean', '--condition', 'lag', '--laws',
                 'pd_gravity', '--gains', 'recommended', '--jobs', '1')
    result = ctc(*arguments, '--out', out)
    assert result.returncode == 0, result.stderr
    text = (out / 'compare.md').read_text(encoding='utf-8')
    assert text in result.stdout
    assert result.stdout.endswith(f'\nopen {out / "index.html"}\n')
    assert '\r' not in result.stderr
    assert '**friction, lag**' in text
    rows = [line.count('|') for line in text.splitlines() if '|' in line]
    assert rows == ([8] * 4 + [6] * 4) * 2
    assert len((out / 'compare.csv').read_text().splitlines()) == 1 + 2 * 2 * 2
    assert {x.name for x in (out / 'figures').iterdir()} == {'friction.svg'}
    assert len(list((out / 'parameters').iterdir())) == 4
    page = (out / 'index.html').read_text(encoding='utf-8')
    assert page.count('<img ') == 1
    assert page.count('<table>') == 4
    numbers = page[page.index('<h2>Numbers'):]
    assert re.findall(r'<b>(.*?)</b>', numbers) == re.findall(r'\*\*(.*?)\*\*', text)
    assert text in ctc(*arguments).stdout
    refused(ctc(*arguments, '--out', out), 'compare.md', '--overwrite')


@pytest.mark.parametrize(('arguments', 'words'), [
    (['nowhere.yaml'], ['nowhere.yaml', 'no such file']),
    (['friction', '--condition', 'rain'], ['no condition is called rain', 'real_arm']),
    (['friction', '--laws', 'integral,sliding'], ["'sliding' is not allowed", 'slotine_li']),
    (['friction', '--held-out', '-1'], ['held_out: -1', '>= 0']),
    (['friction', '--gains', 'good'], ['--gains', 'good', 'recommended'])])
def test_what_cannot_be_compared_is_refused_in_one_line(
        arguments: list[object], words: list[str]) -> None:
    result = ctc('compare', *arguments)
    assert result.returncode in (1, 2)
    *_, last = result.stderr.splitlines()
    assert last.startswith('ctc compare: ')
    assert [word for word in words if word not in last] == []
    assert 'Traceback' not in result.stderr


CASES = """
overrides:
  plant: {duration: 6.0, compiled: false}
cases:
  Drive lag:
    2 ms: {x: 2, plant: {actuator_lag: [2.0e-3, 2.0e-3]}}
  Sample period:
    5 ms: {'/**': {control_period: 5.0e-3}, plant: {duration: 7.0}}
"""


def test_a_case_is_above_what_all_have_and_that_above_the_file(tmp_path: Path) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text(CASES)
    found = compare(['friction'], ['compensation'], cases=file)
    assert [x.task.condition.name for x in found] == [
        'Drive lag: 2 ms', 'Sample period: 5 ms']
    given: tuple[dict[str, Any], ...] = (
        {'plant': {'duration': 6.0, 'compiled': False, 'actuator_lag': [2e-3, 2e-3]}},
        {'/**': {'control_period': 5e-3}, 'plant': {'duration': 7.0, 'compiled': False}})
    for outcome, values in zip(found, given, strict=True):
        setup = parameter_file.load(config_directory() / 'friction.yaml',
                                    {**values, 'controller': {'law': 'compensation'}})
        assert outcome.score == score(setup)


@pytest.mark.parametrize('old, new, words', [
    ('actuator_lag', 'actuator_lags', 'actuator_lags.*did you mean'),
    ('overrides', 'override', 'override.*did you mean overrides'),
    ("'/**'", 'robot', '5 ms.*robot.*controller'), ('cases:', 'cases: 3\nx:', 'x'),
    ('    2 ms: {x: 2, plant: {actuator_lag: [2.0e-3, 2.0e-3]}}', '    2 ms: 3', '2 ms.*3')])
def test_what_is_wrong_is_named_before_anything_runs(
        old: str, new: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text(CASES.replace(old, new))
    with pytest.raises(CtcError, match=words):
        compare(['friction'], ['compensation'], cases=file)


def test_the_cases_of_the_package_are_allowed() -> None:
    cases = read_cases(find_config('imperfections', folder='cases'))
    assert len({case.name for case in cases}) == len(cases) == 81
    for case in cases:
        parameter_file.load(config_directory() / 'friction.yaml', case.values)
    with pytest.raises(CtcError, match='did you mean imperfections'):
        compare(['friction'], cases='imperfection')

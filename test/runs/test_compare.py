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

import json
from pathlib import Path
import re
import shutil
import subprocess
import sys
import time
from typing import Any

from ctc_chattering import compare
from ctc_chattering.analysis.metrics import metrics, WINDOW
from ctc_chattering.analysis.result import Result, simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.package_share import config_directory, find_config
from ctc_chattering.control.laws.registry import LAWS, SWITCHINGS
from ctc_chattering.errors import CtcError
from ctc_chattering.output_files import finite
from ctc_chattering.output_folder import LIST
from ctc_chattering.runs import compare_page
from ctc_chattering.runs.compare import ComparisonRuns, ComparisonSpec
from ctc_chattering.runs.compare_page import Outcome, outcomes, write_parameters
from ctc_chattering.runs.conditions import LOST_ERROR_RAD, read_cases
from ctc_chattering.runs.recommended import (
    BASELINE,
    FILE,
    gains_by_rule,
    LawSettings,
    RECOMMENDED,
)
from ctc_chattering.runs.score import PER_JOINT, Runner, score, simulate_truth
from ctc_commands import ctc, refused
from map_specs import compared
from mujoco_plant import simulated_by_mujoco
import numpy as np
import pandas  # type: ignore[import-untyped]
from processes import CONFIG
import pytest
from urdfs import PANDA, UR5

#: Effort limits of the URDFs [N·m].
LIMITS = {'panda': (87.0,) * 4 + (12.0,) * 3, 'ur5': (150.0,) * 3 + (28.0,) * 3}
NAMES = {'panda': PANDA, 'ur5': UR5}
#: What runs a setup, by the plant that moves the robot.
PLANTS: dict[str, Runner] = {
    'builtin': simulate_truth, 'mujoco': lambda setup: simulated_by_mujoco(setup, truth=True)}

#: Laws that the page leaves out, since their gains must be searched first.
RIVALS = ('pid_kalman', 'extended_state_observer')


def evaluated(made: ComparisonRuns, run: Runner = simulate_truth) -> list[Outcome]:
    """Return the outcomes of a comparison, each run made by `run`, here."""
    return outcomes(pandas.DataFrame([made.row(k, run) for k in range(len(made))]))


def compared_robot(robot: str, plant: str) -> None:
    """Run all laws on a robot with the file's gains; every claim about it holds."""
    spec = ComparisonSpec([CONFIG / f'{robot}.yaml'])
    found = evaluated(ComparisonRuns(spec.runs()), PLANTS[plant])
    assert [x.law for x in found] == spec.law_settings
    for x in found:
        assert (x.experiment, tuple(x.joints)) == (robot, NAMES[robot])
        assert not x.score.failure
        assert (np.array(x.score.peak) < LIMITS[robot]).all()  # Nothing is cut off.
    assert_gains(found)
    assert_documented(found, 0.05 if plant == 'mujoco' else 0.1)


def assert_gains(found: list[Outcome]) -> None:
    """Check by how much the switchings, and what is recommended, are better than the original."""
    for x in found:
        if x.law.law == 'chattering' or x.law.is_recommended:
            least = min(a / b for a, b in zip(found[0].score.rms, x.score.rms))
            claimed = (500.0 if x.law.is_recommended else
                       1000.0 if x.law.switching == 'implicit_observer' else 10.0)
            assert least >= claimed, x


@pytest.mark.slow
@pytest.mark.parametrize(('robot', 'plant'), [
    ('panda', 'mujoco'), ('ur5', 'mujoco'), ('panda', 'builtin'), ('ur5', 'builtin')])
def test_every_switching_wins_ten_times_on_every_joint(robot: str, plant: str) -> None:
    """The claims themselves are in `compared_robot`."""
    compared_robot(robot, plant)


def assert_documented(found: list[Outcome], tolerance: float) -> None:
    """Compare the columns of a robot in validation/README.md, which are of MuJoCo's plant."""
    page = (CONFIG.parent / 'validation' / 'README.md').read_text(encoding='utf-8')
    table = page[page.index('| law | switching |'):].split('\n\n')[0].replace('`', '')
    rows = {tuple(row[:3]): row[3:] for row in map(cells, table.splitlines()[2:])}
    documented = ComparisonSpec(['friction'], [law for law in LAWS if law not in RIVALS])
    assert list(rows) == [tuple(law.columns.values()) for law in documented.law_settings]
    first = 3 * list(NAMES).index(found[0].experiment)
    for x in found:
        least = min(a / b for a, b in zip(found[0].score.rms, x.score.rms))
        law = tuple(x.law.columns.values())
        if law in rows:
            shown = rows[law][first:first + 3]
            assert [float(text.strip('×')) for text in shown] == pytest.approx(
                [max(x.score.rms), least, max(x.score.peak)], rel=tolerance)


def cells(line: str) -> list[str]:
    return [x.strip() for x in line.strip().strip('|').split('|')]


def test_every_law_and_switching_is_run() -> None:
    seen: list[Setup] = []
    file = CONFIG / 'friction.yaml'
    result = simulate(parameter_file.load(file))

    def run(setup: Setup) -> Result:
        seen.append(setup)
        return result

    made = ComparisonRuns(ComparisonSpec([file]).runs())
    given = [json.loads(x.controller) for x in evaluated(made, run)]
    assert given[:-1] == [
        {'law': law, **({'switching': switching} if switching else {})}
        for law in LAWS for switching in (SWITCHINGS if law == 'chattering' else [''])]
    assert given[-1] == finite({
        'law': 'observer_feedback',
        **gains_by_rule(parameter_file.load(file), 'observer_feedback')})
    assert [x.controller for x in seen] == [
        parameter_file.load(file, {'controller': x}).controller for x in given]
    assert {x.plant for x in seen} == {parameter_file.load(file).plant}
    assert list(made.examples()) == seen


def test_the_smallest_number_of_a_column_is_bold() -> None:
    """Check it among numbers that look the same as well, and one that diverged."""
    one, other, lost = (LawSettings(x) for x in ('integral', 'pd_gravity', 'slotine_li'))
    text = compare_page.to_markdown(compared(
        'friction', (BASELINE, 1e-2, 100.0, ''), (one, 1.0001e-3, 300.0, ''),
        (other, 1e-3, 200.0, ''), (lost, 1e-9, 1.0, 'the motion diverged')))
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
    for line, coarse in (
            ('control_period: 0.001', 'control_period: 0.01'),
            ('integration_step: 0.001', 'integration_step: 0.01'),
            ('duration: 10.0', 'duration: 5.2\n    compiled: false')):
        assert text.count(line) == 1
        text = text.replace(line, coarse)
    file.write_text(text)
    return file


def of_law(law: str, gains: str = FILE, *, arm: Path, condition: str) -> ComparisonRuns:
    """Return the runs of one law under a condition."""
    spec = ComparisonSpec([arm], [law], [condition], gains)
    return ComparisonRuns(run for run in spec.runs()
                          if (run.columns['law'], run.columns['settings']) == (law, gains))


def test_a_condition_has_the_worst_of_its_runs(arm: Path) -> None:
    made = of_law('integral', arm=arm, condition='model_error')
    assert [x.controller.inertia_scale for _, x in made.listed] == [0.9, 1.1]
    (found,) = evaluated(made)
    scores = [score(x) for _, x in made.listed]
    for name in PER_JOINT:
        runs = zip(*(getattr(x, name) for x in scores))
        assert getattr(found.score, name) == tuple(map(max, runs))
    assert found.score.error == max(x.error for x in scores)


@pytest.mark.parametrize('lost', [0, 1])
def test_a_condition_fails_with_any_of_its_runs(arm: Path, lost: int) -> None:
    def run(setup: Setup) -> Result:
        if setup == made.setup(lost):
            raise CtcError('the motion diverged')
        return simulate_truth(setup)

    made = of_law('integral', arm=arm, condition='model_error')
    (found,) = evaluated(made, run)
    assert (found.score.failure, found.score.rms) == ('the motion diverged', ())


@pytest.mark.slow
def test_the_number_of_processes_changes_nothing(arm: Path) -> None:
    arguments: dict[str, Any] = {'laws': ['compensation', 'integral'], 'conditions': ['clean'],
                                 'gains': RECOMMENDED, 'show': lambda _: None}
    one, two = (compare([arm], **arguments, jobs=jobs) for jobs in (1, 2))
    assert one.equals(two)
    assert list(one['settings']) == ['file', RECOMMENDED, RECOMMENDED]
    runs = ComparisonSpec([arm], arguments['laws'], ['clean'], RECOMMENDED).runs()
    for x, (_, setup) in zip(outcomes(one), runs):
        again = metrics(simulate(setup, truth=True).run, WINDOW)
        assert tuple(again['rms_error_rad']) == x.score.rms


def test_written_parameter_files_give_the_same_runs(arm: Path, tmp_path: Path) -> None:
    made = of_law('compensation', RECOMMENDED, arm=arm, condition='real_arm')
    write_parameters(made, tmp_path)
    paths = sorted(tmp_path.iterdir())
    assert [x.name for x in paths] == [
        f'friction_real_arm_compensation_recommended_model_{x}.yaml' for x in ('0.9', '1.1')]
    for path, (_, setup) in zip(paths, made.listed):
        one, other = simulate_truth(parameter_file.load(path)).run, simulate_truth(setup).run
        assert (one.tau == other.tau).all()


def test_held_out_conditions_have_gains_by_rule_of_their_own(arm: Path) -> None:
    """Check what survives, medians with a lost run as the worst, and the gains of each draw."""
    result = simulate_truth(parameter_file.load(arm))

    def run(setup: Setup) -> Result:
        if setup.controller.error_limit[0] == LOST_ERROR_RAD:
            seen.append(setup)
            if setup.controller.law == 'integral' and len(seen) == 4:
                raise CtcError('the motion diverged')
        return result

    seen: list[Setup] = []
    spec = ComparisonSpec([arm], ['integral'], ['clean'], RECOMMENDED, held_out=3, seed=3)
    found = evaluated(ComparisonRuns(spec.runs()), run)
    mine = [x for x in found if x.law.law == 'integral'][1:]
    assert [x.condition for x in mine] == [f'held_out_3_{k}' for k in range(3)]
    assert [x.score.failure for x in mine] == ['', 'the motion diverged', '']
    own = [x for x in seen if x.controller.law == 'integral']
    for outcome, setup in zip(mine, own, strict=True):
        rule = json.loads(json.dumps(gains_by_rule(setup)))
        controller = json.loads(outcome.controller)
        assert {name: controller[name] for name in rule} == rule
    text = compare_page.to_markdown(found)
    (row,) = [cells(x) for x in text.splitlines() if '2 of 3' in x]
    assert row[:5] == ['integral', '', RECOMMENDED, '2 of 3', 'lost']
    assert float(row[5]) == pytest.approx(sorted(x.score.error for x in mine)[1], rel=0.06)
    lines = compare_page.to_csv(found).splitlines()
    assert sum(',held_out_3_' in x for x in lines) == 2 * (len(found) - 2)


def test_a_run_that_ends_too_early_is_refused(tmp_path: Path) -> None:
    file = tmp_path / 'short.yaml'
    file.write_text('plant: {ros__parameters: {duration: 0.01}}')
    with pytest.raises(CtcError, match=r'short\.yaml: fewer than two samples from 5 s to 10 s'):
        compare([file], laws=['compensation'])


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
    assert {x.name for x in out.iterdir()} == {
        LIST, 'compare.parquet', 'compare.json', 'compare.csv', 'compare.md', 'figures',
        'index.html', 'parameters', 'shards'}
    assert len(list((out / 'parameters').iterdir())) == 4
    page = (out / 'index.html').read_text(encoding='utf-8')
    assert page.count('<img ') == 1
    assert page.count('<table>') == 4
    numbers = page[page.index('<h2>Numbers'):]
    assert re.findall(r'<b>(.*?)</b>', numbers) == re.findall(r'\*\*(.*?)\*\*', text)
    assert text in ctc(*arguments).stdout
    (out / 'compare.csv').write_text('mine')
    refused(ctc(*arguments, '--out', out), 'compare.csv: was changed since ctc compare wrote it')
    assert (out / 'compare.csv').read_text() == 'mine'
    (out / 'compare.csv').unlink()
    again = ctc(*arguments, '--out', out)
    assert '4 runs in 4 chunks, 4 of them computed' in again.stderr
    assert len((out / 'compare.csv').read_text().splitlines()) == 1 + 2 * 2 * 2
    refused(ctc(*arguments, '--seed', 3, '--held-out', 1, '--out', out),
            'there is output of ctc compare for another spec or version', '--overwrite')


@pytest.mark.slow
def test_a_killed_comparison_continues(arm: Path, tmp_path: Path) -> None:
    """Kill the command in the middle; what is left is computed, to the same bytes."""
    names = [x for name in ('clean', 'lag', 'delay', 'encoder') for x in ('--condition', name)]
    words = ['compare', arm, *names, '--laws', 'pd_gravity,integral', '--jobs', 1, '--out']
    whole, out = tmp_path / 'whole', tmp_path / 'out'
    assert ctc(*words, whole).returncode == 0
    with subprocess.Popen([sys.executable, '-m', 'ctc_chattering.cli.ctc', *map(str, words), out],
                          stderr=subprocess.DEVNULL) as process:
        while len(list(out.glob('shards/*.parquet'))) < 3:
            assert process.poll() is None
            time.sleep(0.01)
        process.kill()
    there = {x: x.stat().st_mtime_ns for x in out.glob('shards/*.parquet')}
    assert 3 <= len(there) < 12
    result = ctc(*words, out)
    assert f'12 runs in 12 chunks, {len(there)} of them computed' in result.stderr
    assert {x: x.stat().st_mtime_ns for x in there} == there
    for name in ('compare.parquet', 'compare.csv', 'compare.md'):
        assert (out / name).read_bytes() == (whole / name).read_bytes()


#: Laws and options of a quick comparison with two passes.
PASSES: dict[str, Any] = {'laws': ['pd_gravity'], 'passes': 2, 'show': lambda _: None}


@pytest.fixture(scope='module')
def learned(arm: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the output of laws that learned."""
    out = tmp_path_factory.mktemp('learned')
    compare([arm], **PASSES, out=out)
    return out


def test_passes_are_evaluated_one_by_one(learned: Path) -> None:
    """Check errors from the sinusoid itself, in passes between which the correction changes."""
    table = pandas.read_csv(learned / 'compare.csv')
    assert list(table['law']) == 3 * ['compensation'] + 3 * ['pd_gravity']
    assert list(table['pass']) == 2 * [0, 1, 2]
    assert {x.partition(',')[0] for x in table['learning']} == {'learning'}
    settled, period, change = 3.0, 1.0, 0.75  # [s]
    for law, rows in table.groupby('law'):
        (file,) = (learned / 'parameters').glob(f'*_{law}_*')
        setup = parameter_file.load(file)
        assert setup.plant.duration == settled + 3 * (period + change)
        result = simulate(setup, truth=True)
        reference = setup.reference
        angle = 2.0 * np.pi * np.outer(result.t, reference.frequency) + reference.phase
        e = np.array(reference.center) + np.array(reference.amplitude) * np.sin(angle) - result.q
        for k, (_, row) in enumerate(rows.iterrows()):
            begin = settled + k * (period + change)
            first, last = np.rint(np.array([begin, begin + period]) / 0.01).astype(int)
            errors = np.sqrt((e[first:last + 1] ** 2).mean(axis=0))
            assert row['rms_error'] == pytest.approx(errors.max(), rel=1e-9)
            steps = np.abs(np.diff(result.tau[first:last + 1], axis=0)).sum(axis=0)
            assert row['torque_variation_per_s'] == pytest.approx(steps.max() / period, rel=1e-9)
        errors = rows['rms_error'].to_numpy()
        assert errors[2] < 0.8 * errors[0]


def test_the_table_of_passes_has_errors_before_and_after(learned: Path) -> None:
    table = pandas.read_csv(learned / 'compare.csv')
    text = (learned / 'compare.md').read_text(encoding='utf-8').replace('**', '')
    heads, _, *rows = [cells(line) for line in text.splitlines() if '|' in line]
    assert heads[3:] == ['learning', 'error before', 'after 2 passes', 'then, without learning',
                         'ratio', 'variation before', 'after 2 passes']
    for row in rows:
        of_law = table[table['law'] == row[0]]
        errors = of_law['rms_error'].to_numpy()
        without = of_law['rms_error_without_learning'].to_numpy()
        assert without[0] == pytest.approx(errors[0], rel=1e-9)
        assert without[-1] > 1.5 * errors[-1]
        assert row[3].startswith('learning')
        assert row[4:8] == [f'{errors[0]:.1e}', f'{errors[-1]:.1e}', f'{without[-1]:.1e}',
                            f'{errors[-1] / without[-1]:.2g}']
    assert (learned / 'figures' / 'friction_error_by_pass.svg').exists()
    page = (learned / 'index.html').read_text(encoding='utf-8')
    assert page.count('<img ') == page.count('<table>') == 1


def test_a_comparison_with_passes_continues(arm: Path, learned: Path, tmp_path: Path) -> None:
    out = tmp_path / 'out'
    shutil.copytree(learned, out)
    lost = min(out.glob('shards/*.parquet'))
    lost.unlink()
    lines: list[str] = []
    compare([arm], **{**PASSES, 'show': lines.append}, out=out)
    assert lines[0] == '2 runs in 2 chunks, 1 of them computed'
    assert (out / 'compare.csv').read_bytes() == (learned / 'compare.csv').read_bytes()
    for other in (0, 3):
        with pytest.raises(CtcError, match='for another spec or version'):
            compare([arm], **{**PASSES, 'passes': other}, out=out)


def test_the_end_of_learning_is_told_in_words(arm: Path) -> None:
    reason = 'learning: no cut-off frequency converges'

    def run(setup: Setup) -> Result:
        if setup.controller.law == 'integral':
            raise CtcError(reason)
        result = simulate_truth(setup)
        if setup.controller.law == 'pd_gravity' and result.learner is not None:
            result.learner.problem = 'the corrected motion is beyond the limits'
        return result

    spec = ComparisonSpec([arm], ['integral', 'pd_gravity'], passes=1)
    found = evaluated(ComparisonRuns(spec.runs()), run)
    text = compare_page.to_markdown(found)
    words = {cells(line)[0]: cells(line)[3:] for line in text.splitlines() if '|' in line}
    assert words['compensation'][0].startswith('learning')
    assert words['pd_gravity'][0].endswith(': the corrected motion is beyond the limits')
    assert words['integral'] == [reason, *6 * ['']]
    assert f',integral,,file,0,,,,{reason},' in compare_page.to_csv(found)
    ((_, figure, _),) = compare_page.figures(found)
    errors, variation = figure.axes
    drawn = [[[numbers[k] for numbers in x.passes] for x in found if x.passes] for k in range(3)]
    lines = [[np.asarray(line.get_ydata()).tolist() for line in ax.lines]
             for ax in (errors, variation)]
    assert (lines[0][::2], lines[1], lines[0][1::2]) == tuple(drawn)
    assert [x.get_text() for x in figure.legends[0].get_texts()] == [
        'compensation, file', 'pd_gravity, file']


def test_a_condition_has_the_worst_of_its_passes(arm: Path) -> None:
    spec = ComparisonSpec([arm], ['compensation'], ['model_error'], passes=1)
    made = ComparisonRuns(spec.runs())
    (found,) = evaluated(made)
    runs = [json.loads(made.row(k)['passes_of_run']) for k in range(2)]
    assert found.passes == [tuple(map(max, zip(*numbers))) for numbers in zip(*runs)]


@pytest.mark.parametrize('lines, words', [
    ('frequency: [0.9403154, 1.17858]', 'no common period of up to 60 s'),
    ('amplitude: [0.0, 0.0]', 'no joint moves'),
    ('speed_scaling: 0.5', 'speed_scaling 1'),
    (f'trajectory_file: {CONFIG / "trajectories" / "waypoints.yaml"}', 'trajectory_file')])
def test_passes_of_a_motion_that_does_not_repeat_are_refused(
        lines: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text(f'plant: {{ros__parameters: {{duration: 5.0}}}}\n'
                    f'reference: {{ros__parameters: {{{lines}}}}}')
    with pytest.raises(CtcError, match=rf'mine\.yaml: .*{words}'):
        compare([file], passes=2)


@pytest.mark.parametrize(('arguments', 'words'), [
    *((['friction', '--passes', x], ['--passes', x, '>= 1 and <= 100'])
      for x in ('0', '-1', '1000', 'two')),
    (['friction', '--passes', '2', '--held-out', '1'], ['held_out_26_0', 'no common period']),
    ([CONFIG / 'maps' / 'gains.yaml', '--passes', '2'], ['spec of ctc map']),
    (['nowhere.yaml'], ['nowhere.yaml', 'no such file']),
    (['friction', '--condition', 'rain'], ['no condition is called rain', 'real_arm']),
    (['friction', '--laws', 'integral,sliding'], ["'sliding' is not allowed", 'slotine_li']),
    (['friction', '--held-out', '-1'], ['held_out: -1', '>= 0']),
    (['friction', '--gains', 'good'], ['--gains', 'good', 'recommended'])])
def test_an_argument_that_is_not_allowed_is_refused_in_one_line(
        arguments: list[object], words: list[str]) -> None:
    result = ctc('compare', *arguments)
    assert result.returncode in (1, 2)
    *_, last = result.stderr.splitlines()
    assert last.startswith('ctc compare: ')
    assert [word for word in words if word not in last] == []
    assert 'Traceback' not in result.stderr


CASES = """
overrides:
  plant: {duration: 6.0, coulomb_friction: [8.0, 8.0]}
cases:
  Drive lag:
    2 ms: {x: 2, plant: {actuator_lag: [2.0e-3, 2.0e-3]}}
  Sample period:
    5 ms: {'/**': {control_period: 5.0e-3}, plant: {duration: 7.0}}
"""


def test_a_case_overrides_common_values_and_these_the_file(tmp_path: Path) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text(CASES)
    found = outcomes(compare(['friction'], laws=['compensation'], cases=file))
    assert [x.condition for x in found] == [
        'Drive lag: 2 ms', 'Sample period: 5 ms']
    common = {'coulomb_friction': [8.0, 8.0]}
    given: tuple[dict[str, Any], ...] = (
        {'plant': {'duration': 6.0, **common, 'actuator_lag': [2e-3, 2e-3]}},
        {'/**': {'control_period': 5e-3}, 'plant': {'duration': 7.0, **common}})
    for outcome, values in zip(found, given, strict=True):
        setup = parameter_file.load(config_directory() / 'friction.yaml',
                                    {**values, 'controller': {'law': 'compensation'}})
        expected = score(setup)
        assert [getattr(outcome.score, name) for name in PER_JOINT] == [
            getattr(expected, name) for name in PER_JOINT]


@pytest.mark.parametrize('old, new, words', [
    ('actuator_lag', 'actuator_lags', 'actuator_lags.*did you mean'),
    ('overrides', 'override', 'override.*did you mean overrides'),
    ("'/**'", 'robot', '5 ms.*robot.*controller'), ('cases:', 'cases: 3\nx:', 'x'),
    ('plant: {duration: 6.0, coulomb_friction: [8.0, 8.0]}', 'plant: 3', 'overrides: plant: 3 is'),
    ('plant: {actuator_lag: [2.0e-3, 2.0e-3]}', 'plant: [1]', 'lag: 2 ms: plant: .1. is'),
    ('  Drive lag:\n', '  other: 3\n  Drive lag:\n', 'other: 3 is not .*; allowed: a mapping'),
    ('cases:\n', 'cases: [1]\nx:\n', "'x' is not allowed"),
    ('duration: 6.0', 'duration: 0.0', r'duration: 0\.0 is not allowed; allowed: a number > 0'),
    ('    2 ms: {x: 2, plant: {actuator_lag: [2.0e-3, 2.0e-3]}}', '    2 ms: 3', '2 ms.*3')])
def test_an_error_in_a_file_of_cases_is_named_before_any_run(
        old: str, new: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text(CASES.replace(old, new))
    with pytest.raises(CtcError, match=words):
        compare(['friction'], laws=['compensation'], cases=file)


def test_the_cases_of_the_package_are_allowed() -> None:
    cases = read_cases(find_config('imperfections', folder='cases'))
    assert len({case.title for case in cases}) == len(cases) == 81
    for case in cases:
        parameter_file.load(config_directory() / 'friction.yaml', case.overrides)
    with pytest.raises(CtcError, match='did you mean imperfections'):
        compare(['friction'], cases='imperfection')

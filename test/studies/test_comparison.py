"""All laws on robots that are not the paper's, joint by joint, and the table of it."""

from __future__ import annotations

from collections.abc import Iterator
import dataclasses
from pathlib import Path
import re

from commands import ctc, refused
import numpy as np
from processes import CONFIG
import pytest
from urdfs import PANDA, UR5

from ctc_chattering.analysis.result import Result, simulated
from ctc_chattering.control.switching import SWITCHINGS
from ctc_chattering.errors import CtcError
from ctc_chattering.experiment import parameter_file
from ctc_chattering.experiment.parameter_file import Overrides
from ctc_chattering.studies import comparison
from ctc_chattering.studies.comparison import Outcome, over_simulation, run_variants, VARIANTS

#: Effort limits of the URDFs [N·m].
LIMITS = {'panda': (87.0,) * 4 + (12.0,) * 3, 'ur5': (150.0,) * 3 + (28.0,) * 3}
NAMES = {'panda': PANDA, 'ur5': UR5}


class Recorder:
    """Simulates as `ctc compare` does, and keeps what came of it."""

    def __init__(self) -> None:
        self.results: list[Result] = []

    def __call__(self, path: Path, overrides: Overrides) -> Result:
        self.results.append(over_simulation(path, overrides))
        return self.results[-1]


def compared(robot: str, backend: str) -> list[Outcome]:
    """Run everything on a robot; every claim about it holds."""
    run = Recorder()
    outcomes = list(run_variants(CONFIG / f'{robot}.yaml', backend, run))
    assert [(x.law, x.switching) for x in outcomes] == list(VARIANTS)
    original = outcomes[0]
    proposed = [x for x in outcomes if x.law == 'chattering']
    for outcome, result in zip(outcomes, run.results):
        assert (outcome.experiment, outcome.backend) == (robot, backend)
        assert outcome.joints == NAMES[robot]
        window = (result.run.t >= 5.0) & (result.run.t <= 10.0)
        error = (result.run.q_d - result.run.q)[window]
        assert window.sum() == 5001
        assert outcome.rms == pytest.approx(np.sqrt((error ** 2).mean(axis=0)), rel=1e-9)
        assert outcome.peak == np.abs(result.run.tau).max()
        assert (np.abs(result.run.tau).max(axis=0) < LIMITS[robot]).all()  # Nothing is cut off.
    for outcome in proposed:
        least = min(a / b for a, b in zip(original.rms, outcome.rms))
        assert least >= 10.0, outcome
    assert min(a / b for a, b in zip(original.rms, proposed[-1].rms)) >= 1000.0
    return outcomes


@pytest.fixture(scope='module')
def outcomes() -> Iterator[list[Outcome]]:
    """Yield what becomes of the Panda, moved by MuJoCo."""
    yield compared('panda', 'mujoco')


def test_every_switching_wins_ten_times_on_every_joint(outcomes: list[Outcome]) -> None:
    """The claims themselves are in `compared`."""
    assert [x.experiment for x in outcomes] == ['panda'] * len(VARIANTS)


@pytest.mark.slow
@pytest.mark.parametrize(('robot', 'backend'), [
    ('ur5', 'mujoco'), ('panda', 'builtin'), ('ur5', 'builtin')])
def test_so_it_does_on_the_other_robot_and_in_the_other_plant(robot: str, backend: str) -> None:
    assert_documented(compared(robot, backend))


def test_the_table_says_what_was_measured(outcomes: list[Outcome]) -> None:
    """One table a robot, a row a run; the worst joint's gain is that of the row."""
    outcomes = [*outcomes, *(dataclasses.replace(x, experiment='other') for x in outcomes)]
    text = comparison.to_markdown(outcomes)
    tables = text.split('\n\n**')
    assert len(tables) == 2
    for robot, table in zip(('panda', 'other'), tables):
        mine = [x for x in outcomes if x.experiment == robot]
        title, empty, head, line, *rows = table.strip().splitlines()
        assert title.strip('*').startswith(f'{robot}, plant mujoco')
        assert not empty
        assert cells(head) == ['law', 'switching', *PANDA, 'least', 'peak torque [N·m]']
        assert cells(line) == ['---'] * (len(PANDA) + 4)
        assert len(rows) == len(mine)
        for outcome, row in zip(mine, rows):
            law, switching, *rms, least, peak = cells(row)
            assert [float(x) for x in rms] == pytest.approx(outcome.rms, rel=5e-3)
            assert float(peak) == pytest.approx(outcome.peak, abs=0.5)
            assert switching in SWITCHINGS if law == 'chattering' else switching == ''
            if law == 'compensation':
                assert least == ''
            else:
                gains = [a / b for a, b in zip(mine[0].rms, outcome.rms)]
                assert float(least.rstrip('×')) == pytest.approx(min(gains), abs=0.5)


def test_the_page_says_what_was_measured(outcomes: list[Outcome]) -> None:
    assert_documented(outcomes)


def assert_documented(outcomes: list[Outcome]) -> None:
    """Compare the tables of docs/robots.md with outcomes."""
    page = (CONFIG.parent / 'docs' / 'robots.md').read_text(encoding='utf-8')
    fresh = comparison.to_markdown(outcomes)
    for title in re.findall(r'^\*\*\w+, plant \w+\*\*', fresh, re.MULTILINE):
        tables = [text[text.index(title):].split('\n\n')[1] for text in (page, fresh)]
        old, new = ([cells(line) for line in table.splitlines()] for table in tables)
        assert [row[:2] for row in old] == [row[:2] for row in new]
        assert old[0] == new[0]
        for was, now in zip(old[2:], new[2:]):
            assert [float(x.strip('×') or 0) for x in was[2:]] == pytest.approx(
                [float(x.strip('×') or 0) for x in now[2:]], rel=0.05)


def cells(line: str) -> list[str]:
    return [x.strip() for x in line.strip().strip('|').split('|')]


def test_every_variant_is_run_and_a_backend_left_out_is_the_file_s() -> None:
    seen: list[Overrides] = []
    file = CONFIG / 'friction.yaml'
    result = simulated(parameter_file.load(file))

    def run(path: Path, overrides: Overrides) -> Result:
        assert path == file
        seen.append(overrides)
        return result

    assert {x.backend for x in run_variants(file, None, run)} == {'builtin'}
    assert [dict(x['controller']) for x in seen] == [
        {'law': law, **({'switching': switching} if switching else {})}
        for law, switching in VARIANTS]
    assert not any(x['plant'] for x in seen)


def test_a_run_that_ends_too_early_is_refused(tmp_path: Path) -> None:
    file = tmp_path / 'short.yaml'
    file.write_text('plant: {ros__parameters: {duration: 0.01}}')
    with pytest.raises(CtcError, match='the run ends before the evaluated interval, 5 s to 10 s'):
        next(run_variants(file, None, over_simulation))


def test_the_command_prints_the_table_and_writes_it_once(tmp_path: Path) -> None:
    """With two plants of the two-link arm at a coarse step, in the order of the options."""
    file = tmp_path / 'arm.yaml'
    file.write_text((CONFIG / 'friction.yaml').read_text().replace(
        'control_period: 0.001', 'control_period: 0.01'))
    assert 'control_period: 0.01' in file.read_text()
    result = ctc('compare', file, '--out', tmp_path / 'out')
    assert result.returncode == 0, result.stderr
    text = (tmp_path / 'out' / 'compare.md').read_text(encoding='utf-8')
    assert text in result.stdout
    assert '**friction, plant builtin**' in text
    rows = [line.count('|') for line in text.splitlines() if '|' in line]
    assert rows == [7] * (2 + len(VARIANTS))
    refused(ctc('compare', file, '--out', tmp_path / 'out'), 'compare.md', '--overwrite')


@pytest.mark.parametrize(('arguments', 'words'), [
    (['nowhere.yaml'], ['nowhere.yaml', 'No such file']),
    ([CONFIG / 'panda.yaml', '--backend', 'gazebo'], ["plant_backend: 'gazebo'", 'mujoco']),
    ([CONFIG / 'friction.yaml', '--backend', 'mujoco'], ['plant_backend mujoco', 'description'])])
def test_what_cannot_be_compared_is_refused_in_one_line(
        arguments: list[object], words: list[str]) -> None:
    result = ctc('compare', *arguments)
    assert result.returncode == 1
    *_, last = result.stderr.splitlines()
    assert last.startswith('ctc compare: ')
    assert [word for word in words if word not in last] == []
    assert 'Traceback' not in result.stderr

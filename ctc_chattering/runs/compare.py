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

"""All laws on any robot and plant, under conditions, with gains of the file or by rule."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ctc_chattering.analysis.compilation import compile_setups
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Overrides, Setup
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.control.controller import ControllerConfig, LAWS
from ctc_chattering.control.controller_config import SWITCHINGS
from ctc_chattering.errors import CtcError, near, ParameterError
from ctc_chattering.parameters import whole
from ctc_chattering.runs.conditions import chosen, Condition, held_out, HeldOut, read_cases, SEED
from ctc_chattering.runs.pool import processes
from ctc_chattering.runs.recommended import by_rule
from ctc_chattering.runs.score import over_simulation, Runner, Score, score, worst

#: Where gains come from.
GAINS = FILE, RECOMMENDED = 'file', 'recommended'


class Variant(NamedTuple):
    """A law with its switching, '' for one without, and where its gains come from."""

    law: str
    switching: str
    settings: str

    @property
    def values(self) -> dict[str, Any]:
        """Return what names the law, as parameters of the controller."""
        return {'law': self.law, **({'switching': self.switching} if self.switching else {})}


#: That to which all others are compared.
BASE = Variant('compensation', '', FILE)
#: That whose torque variation is the measure of all others'.
BEST = Variant('observer_feedback', '', RECOMMENDED)


def variants(laws: Sequence[str] = LAWS, gains: str = FILE) -> list[Variant]:
    """Return the rows of a table: `BASE`, all laws and switchings, and what is recommended."""
    found = [Variant(law, switching, gains) for law in LAWS if law in laws for switching in (
        SWITCHINGS if ControllerConfig(law=law).takes('switching') else ('',))]
    if 'observer_feedback' in laws:
        found.append(BEST)
    return list(dict.fromkeys([BASE, *found]))


class Task(NamedTuple):
    """One row of a table: a law on the robot of a file under a condition."""

    path: Path
    condition: Condition
    variant: Variant

    @property
    def held_out(self) -> bool:
        """Return whether nothing was chosen for the condition."""
        return isinstance(self.condition, HeldOut)


def tasks(paths: Sequence[Path], conditions: Sequence[str],
          laws: Sequence[str] = LAWS, gains: str = FILE, others: int = 0, seed: int = SEED,
          cases: Sequence[Condition] = ()
          ) -> list[Task]:
    """
    Return what to run: every variant on every robot under every condition.

    Parameters
    ----------
    paths : sequence of Path
        Parameter files.
    conditions : sequence of str
        Names, `ALL` for each that the robot can have, '' for the robot as it is in the file.
    laws, gains
        As `variants` has them.
    others, seed : int
        How many held-out conditions, and the seed of their draws.
    cases : sequence of Condition
        Further conditions.

    """
    return [Task(path, condition, variant) for path in paths
            for condition in (*chosen(conditions, parameter_file.load(path)), *cases,
                              *held_out(others, seed))
            for variant in variants(laws, gains)]


class Outcome(NamedTuple):
    """
    What came of a task.

    Attributes
    ----------
    task : Task
        What was run.
    experiment : str
        Its name.
    joints : tuple of str, shape (n,)
        Names.
    runs : tuple of mapping
        The overrides of each run.
    score : Score
        The worst of the runs, joint by joint.

    """

    task: Task
    experiment: str
    joints: tuple[str, ...]
    runs: tuple[Overrides, ...]
    score: Score

    @property
    def name(self) -> str:
        """Return robot and condition."""
        return ', '.join(filter(None, (self.experiment, self.task.condition.name)))


def runs_of(task: Task) -> tuple[Overrides, ...]:
    """Return the overrides of each run of a task, with the file's gains or those by rule."""
    under = task.condition.overrides(parameter_file.load(task.path))
    runs = tuple(merged(x, {'controller': task.variant.values}) for x in under)
    if task.variant.settings == RECOMMENDED:
        gains = by_rule(parameter_file.load(task.path, runs[0]))
        runs = tuple(merged(x, {'controller': gains}) for x in runs)
    return runs


def setups(todo: Sequence[Task]) -> Iterator[Setup]:
    """Yield what runs of every task that is not held out: these are refused nothing."""
    for task in todo:
        for run in () if task.held_out else runs_of(task):
            yield parameter_file.load(task.path, run)


def evaluate(task: Task, run: Runner = over_simulation) -> Outcome:
    """
    Run a task, by `run`.

    Raises
    ------
    CtcError
        If parameters are not allowed, or `BASE` has no numbers.

    """
    runs = runs_of(task)
    loaded = [parameter_file.load(task.path, x) for x in runs]
    found = worst(score(x, run=run) for x in loaded)
    if task.variant == BASE and found.failure and not task.held_out:
        raise CtcError(f'{task.path}: {found.failure}')
    plant = loaded[0].plant
    return Outcome(task, plant.experiment, plant.joint_names, runs, found)


def merged(*parts: Overrides) -> Overrides:
    """Return overrides by node and parameter; later ones win."""
    nodes = dict.fromkeys(node for part in parts for node in part)
    return {node: {name: value for part in parts for name, value in part.get(node, {}).items()}
            for node in nodes}


def compare(files: Sequence[str | Path], laws: Sequence[str] = LAWS,
            conditions: Sequence[str] = (), gains: str = FILE, held_out: int = 0,
            seed: int = SEED, jobs: int = 1,
            show: Callable[[str], None] = print,
            progress: Callable[[int, int], None] | None = None, cases: str | Path = ''
            ) -> list[Outcome]:
    """
    Run parameter files with every law and, under law chattering, every switching.

    Parameters
    ----------
    files : sequence of str or Path
        Parameter files, or names of those of the package.
    laws : sequence of str
        Laws to run.
    conditions : sequence of str
        Drives, sensors and model error in place of those of the files; ``all`` for each that the
        robot can have.
    gains : {'file', 'recommended'}
        Gains of the file, or of each law by its rule in what the controller knows.
    held_out : int
        Further conditions, drawn, in which all laws are judged.
    seed : int
        Of these.
    jobs : int
        Processes; with more than 1 a script needs ``if __name__ == '__main__'``.
    show : callable
        Takes lines about what is compiled.
    progress : callable, optional
        Called with the number of outcomes that are there, and of all.
    cases : str or Path
        File of further conditions, or the name of one in the package, ``imperfections``.

    Returns
    -------
    list of Outcome
        One a law, file and condition, each with ``task`` and ``score``; for `write_comparison`.

    Raises
    ------
    CtcError
        If an argument is not allowed, before anything is run; or if the law to which all others
        are compared has no numbers.

    """
    for name in laws:
        if name not in LAWS:
            raise ParameterError('laws', name, ' | '.join(LAWS) + near(name, LAWS))
    if gains not in GAINS:
        raise ParameterError('gains', gains, ' | '.join(GAINS))
    held_out, seed, jobs = whole('held_out', held_out, 0), whole('seed', seed, 0), whole(
        'jobs', jobs, 1)
    paths = [find_config(x) if isinstance(x, str) else x for x in files]
    more = read_cases(find_config(str(cases), folder='cases')) if str(cases) else ()
    todo = tasks(paths, conditions or ([] if more else ['']), laws, gains, held_out, seed, more)
    compile_setups(setups(todo), show)
    found: list[Outcome] = []
    with processes(min(jobs, len(todo))) as each:
        for outcome in each(evaluate, todo):
            found.append(outcome)
            if progress is not None:
                progress(len(found), len(todo))
    return found

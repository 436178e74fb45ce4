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


"""Laws compared on parameter files: from names to outcomes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from ctc_chattering.analysis.compilation import compile_setups
from ctc_chattering.arguments import check_each, checked, whole
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.control.controller_config import LAWS
from ctc_chattering.errors import near, ParameterError
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.studies import comparison
from ctc_chattering.studies.comparison import FILE, GAINS, Outcome
from ctc_chattering.studies.conditions import check_conditions
from ctc_chattering.studies.score import over_simulation, Runner


@checked(**dict.fromkeys(('files', 'laws', 'conditions', 'backends'), Sequence), gains=str,
         runner=Callable, show=Callable, progress=(Callable, type(None)))
def compare(files: Sequence[str | Path], laws: Sequence[str] = LAWS,
            conditions: Sequence[str] = (), backends: Sequence[str] = (), gains: str = FILE,
            held_out: int = 0, seed: int = 0, jobs: int = 1,
            runner: Runner = over_simulation, show: Callable[[str], None] = print,
            progress: Callable[[int, int], None] | None = None) -> list[Outcome]:
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
    backends : sequence of {'builtin', 'mujoco'}
        Plants in place of those of the files.
    gains : {'file', 'recommended'}
        Gains of the file, or of each law by its rule in what the controller knows.
    held_out : int
        Further conditions, drawn, in which all laws are judged.
    seed : int
        Of these.
    jobs : int
        Processes; with more than 1 a script needs ``if __name__ == '__main__'``.
    runner : callable
        Runs a `Setup`: the simulation, or `studies.over_ros.over_ros`.
    show : callable
        Takes lines about what is compiled.
    progress : callable, optional
        Called with the number of outcomes that are there, and of all.

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
    for kind, values in (('files', files), ('laws', laws), ('backends', backends)):
        check_each(kind, values, (str, Path) if kind == 'files' else str)
    for name in laws:
        if name not in LAWS:
            raise ParameterError('laws', name, ' | '.join(LAWS) + near(name, LAWS))
    check_conditions(conditions)
    for name in backends:
        PlantConfig.parameters()['plant_backend'].check(name, 0)
    if gains not in GAINS:
        raise ParameterError('gains', gains, ' | '.join(GAINS))
    held_out, seed, jobs = whole('held_out', held_out, 0), whole('seed', seed, 0), whole(
        'jobs', jobs, 1)
    paths = [find_config(x) if isinstance(x, str) else x for x in files]
    todo = comparison.tasks(paths, backends or [None], conditions or [None], laws, gains,
                            held_out, seed)
    runs = comparison.compare(todo, jobs, runner)
    if runner is over_simulation:
        compile_setups(comparison.setups(todo), show)
    found: list[Outcome] = []
    for outcome in runs:
        found.append(outcome)
        if progress is not None:
            progress(len(found), len(todo))
    return found

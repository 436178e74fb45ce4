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


"""From a spec, or what was identified, to gains."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from numbers import Real
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.compilation import compile_setups
from ctc_chattering.arguments import checked, whole
from ctc_chattering.configuration.yaml_file import read_yaml
from ctc_chattering.errors import ParameterError
from ctc_chattering.robustness.spec import errors_of
from ctc_chattering.robustness.tuning import runs
from ctc_chattering.robustness.tuning.identified import identified_spec
from ctc_chattering.robustness.tuning.runs import Evaluation, Tuning
from ctc_chattering.robustness.tuning.spec import parse_tune, TuneSpec
from ctc_chattering.studies.pool import processes
from ctc_chattering.studies.search import require_optuna

Progress = Callable[[int, int], None]


def tune_spec(spec: TuneSpec | Mapping[str, Any] | str | Path,
              identified: str | Path | None = None) -> TuneSpec:
    """Return what is tuned; arguments and errors as of `tune`."""
    if isinstance(spec, TuneSpec):
        return spec
    if isinstance(spec, Mapping):
        if identified is not None:
            return identified_spec(Path(identified), spec)
        return parse_tune(dict(spec), Path(Path(str(spec.get('params_file', 'friction'))).name))
    with errors_of(Path(spec)):
        return parse_tune(read_yaml(Path(spec)), Path(spec))


@checked(spec=(TuneSpec, Mapping, str, Path), percentile=Real, identified=(str, Path, type(None)),
         show=Callable, progress=(Callable, type(None)))
def tune(spec: TuneSpec | Mapping[str, Any] | str | Path, trials: int = 200,
         percentile: float = 95.0, identified: str | Path | None = None, jobs: int = 1,
         show: Callable[[str], None] = print, progress: Progress | None = None) -> Tuning:
    """
    Search for gains for a robot that is known within ranges, within limits of its torque.

    Parameters
    ----------
    spec : mapping, str or Path
        What is tuned, as docs/tuning.md has it, or the path of a file with it; such as
        ``{'params_file': 'panda', 'repeats': 32, 'tune': {'law': 'observer_feedback'}}``.
    trials : int
        Gains to try.
    percentile : float
        Part of the draws that error and torque variation do not exceed [%]; 100 for the worst.
    identified : str or Path, optional
        Directory that `write_identified` has written: the robot, uncertain within its
        intervals. `spec` is then a mapping of further keys.
    jobs : int
        Processes; with more than 1 a script needs ``if __name__ == '__main__'``.
    show : callable
        Takes lines about what is compiled.
    progress : callable, optional
        Called with the number of runs that are done, and of all: first of the search, then of
        the validation.

    Returns
    -------
    Tuning
        The ``points`` of the front of error against torque variation, each with ``values``, the
        parameters of the controller; ``best`` is the recommended one, None if none keeps the
        limits. For `write_tuning`.

    Raises
    ------
    CtcError
        If something in the spec, or an argument, is not allowed, before anything is run.

    """
    require_optuna('tune')
    trials, jobs = whole('trials', trials, 1), whole('jobs', jobs, 1)
    if not 0.0 < percentile <= 100.0:
        raise ParameterError('percentile', percentile, 'a number > 0 and <= 100')
    found = tune_spec(spec, identified)
    compile_setups(runs.setups(found), show)
    count = trials + len(runs.references(found))
    with _map(jobs, count * found.repeats.repeats, progress) as each:
        return runs.tune(Evaluation(found, percentile, each), trials, found.repeats.seed)


@contextmanager
def _map(jobs: int, total: int, progress: Progress | None) -> Iterator[Callable[..., Any]]:
    """Yield a map over processes that tells how many of the runs are done, after them anew."""
    with processes(jobs) as each:
        done = 0

        def counted(function: Callable[[Any], list[Any]], tasks: list[list[Any]]
                    ) -> Iterator[list[Any]]:
            nonlocal done, total
            if done == total:
                done, total = 0, sum(map(len, tasks))
            for found in each(function, tasks):
                done += len(found)
                if progress is not None:
                    progress(done, total)
                yield found
        yield counted

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

"""`ctc tune`: options, and from a robot and its uncertainty to gains."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TYPE_CHECKING

from ctc_chattering.analysis.output import prepare
from ctc_chattering.cli.options import add_format, add_jobs, add_output, check, number_of_jobs
from ctc_chattering.cli.presentation import print_page
from ctc_chattering.control.controller import LAWS
from ctc_chattering.control.switching import SWITCHINGS
from ctc_chattering.errors import CtcError, given_by_user, ParameterError, UsageError

if TYPE_CHECKING:
    from ctc_chattering.robustness.tuning.spec import TuneSpec

DETAILS = ('Search for them over draws of what is uncertain, within limits of the torque and its '
           'rate, and validate them on fresh draws. Write tuned.yaml, a parameter file; all other '
           'best compromises, figures and index.html.')
#: Options that are keys of the spec, and of its section `tune`.
_KEYS = {'duration': 'duration', 'draws': 'repeats', 'seed': 'seed'}
_OF_TUNE = {'law': 'law', 'switching': 'switching', 'torque_limit': 'torque_limit',
            'torque_rate': 'torque_rate_limit'}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc tune`."""
    robot = parser.add_mutually_exclusive_group(required=True)
    robot.add_argument('spec', nargs='?', type=Path, metavar='SPEC.yaml',
                       help='robot, what is uncertain, limits and ranges: docs/tuning.md')
    robot.add_argument('--params-file', metavar='F',
                       help='parameter file, or the name of one of the package, such as panda; '
                            'with a default uncertainty')
    robot.add_argument('--identified', type=Path, metavar='DIR',
                       help='what ctc identify has written; uncertain within its intervals')
    for name, values in (('law', LAWS), ('switching', SWITCHINGS)):
        parser.add_argument(f'--{name}', metavar='X', help=(
            'chattering by default, ' if name == 'law' else 'implicit_observer by default, ')
            + f"or the spec's: {' | '.join(values)}")
    for name, text in (('torque-limit', 'largest torque [N·m]'),
                       ('torque-rate', 'largest change of the torque sent [N·m/s]')):
        parser.add_argument(f'--{name}', metavar='A,B,C',
                            help=f'{text}: a number per joint, or one for all; by default what '
                                 'the file and the description say')
    parser.add_argument('--trials', type=int, default=200, metavar='N',
                        help='gains to try, 200 by default')
    parser.add_argument('--percentile', type=float, default=95.0, metavar='P',
                        help='of the draws, that error and torque variation do not exceed, 95 by '
                             'default; 100 for the worst case')
    parser.add_argument('--draws', type=int, metavar='N',
                        help="draws of what is uncertain, 32 by default, or the spec's")
    parser.add_argument('--duration', type=float, metavar='S',
                        help="of a run, in place of the file's [s]")
    parser.add_argument('--seed', type=int, metavar='S',
                        help="seed of search and draws, 0 by default, or the spec's")
    add_jobs(parser, '; the result does not depend on it')
    add_format(parser)
    add_output(parser, 'tuned')


def run(options: argparse.Namespace) -> int:
    """Run `ctc tune`."""
    from ctc_chattering.analysis.compilation import compile_setups
    from ctc_chattering.robustness.tuning import report
    from ctc_chattering.robustness.tuning.files import NAMES, PAGE, TUNED, write_tuning
    from ctc_chattering.robustness.tuning.runs import Evaluation, setups, tune
    from ctc_chattering.studies.search import require_optuna

    require_optuna('ctc tune')
    check('--trials', options.trials, 1)
    if not 0.0 < options.percentile <= 100.0:
        raise UsageError(f'--percentile: {options.percentile} is not allowed; allowed: a number '
                         '> 0 and <= 100')
    jobs = number_of_jobs(options.jobs)
    with given_by_user(key for name, key in (_KEYS | _OF_TUNE).items()
                       if getattr(options, name) is not None):
        spec = _spec(options)
    out = prepare(options.out, NAMES, options.overwrite)
    compile_setups(setups(spec), partial(print, flush=True))
    with _map(jobs, options.trials * spec.repeats.repeats) as each:
        tuning = tune(Evaluation(spec, options.percentile, each), options.trials,
                      spec.repeats.seed)
    write_tuning(tuning, out, options.format, options.said)
    print(report.text(tuning))
    if tuning.knee is None:
        raise CtcError(f'no trial keeps the limits; {report.closest(tuning.trials)}; '
                       f'see {out / PAGE}')
    print()
    print_page(out / PAGE, f'ctc simulate --params-file {out / TUNED}')
    return 0


def _spec(options: argparse.Namespace) -> TuneSpec:
    """Return what is tuned, from a spec, a parameter file, or what was identified."""
    from ctc_chattering.configuration.yaml_file import read_yaml
    from ctc_chattering.robustness.spec import errors_of
    from ctc_chattering.robustness.tuning.identified import identified_spec
    from ctc_chattering.robustness.tuning.spec import parse_tune

    if options.identified:
        return identified_spec(options.identified, _given({}, options))
    if options.params_file:
        tree = {'params_file': options.params_file}
        return parse_tune(_given(tree, options), Path(Path(options.params_file).name))
    with errors_of(options.spec):
        return parse_tune(_given(read_yaml(options.spec), options), options.spec)


def _given(tree: Any, options: argparse.Namespace) -> Any:
    """Return a spec with the options in place of its values."""
    if not isinstance(tree, dict):
        return tree
    values = {key: x for name, key in _KEYS.items() if (x := getattr(options, name)) is not None}
    section = {key: x for name, key in _OF_TUNE.items()
               if (x := getattr(options, name)) is not None}
    for key in ('torque_limit', 'torque_rate_limit'):
        if key in section:
            section[key] = _numbers(key, section[key])
    return {**tree, **values, **({'tune': {**(tree.get('tune') or {}), **section}}
                                 if section else {})}


def _numbers(key: str, text: str) -> object:
    """Return the numbers of an option."""
    try:
        values = [float(word) for word in text.split(',')]
    except ValueError:
        raise ParameterError(f'tune.{key}', text, 'a number, or numbers A,B,C') from None
    return values if len(values) > 1 else values[0]


@contextmanager
def _map(jobs: int, runs: int) -> Iterator[Callable[..., Iterator[Any]]]:
    """Yield a map over processes that shows how many of the runs are done."""
    from ctc_chattering.cli.progress import progress_bar
    from ctc_chattering.studies.pool import processes

    with processes(jobs) as each, progress_bar(total=runs, desc='tune', unit='run') as bar:
        def counted(function: Callable[[Any], list[Any]], tasks: list[list[Any]]
                    ) -> Iterator[list[Any]]:
            bar.total = max(bar.total, bar.n + sum(map(len, tasks)))
            for found in each(function, tasks):
                bar.update(len(found))
                yield found
        yield counted

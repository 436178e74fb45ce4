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
from functools import partial
from pathlib import Path
from typing import Any, TYPE_CHECKING

from ctc_chattering.analysis.output import prepare
from ctc_chattering.cli.options import (
    add_format,
    add_jobs,
    add_output,
    check,
    find_file,
    number_of_jobs,
    numbers,
)
from ctc_chattering.cli.presentation import print_page
from ctc_chattering.control.controller import LAWS
from ctc_chattering.control.controller_config import SWITCHINGS
from ctc_chattering.errors import CtcError, given_by_user, UsageError

if TYPE_CHECKING:
    from ctc_chattering.runs.tune_spec import TuneSpec

DETAILS = ('The search runs on random draws of what is uncertain, within limits of torque and '
           'torque rate; results are validated on fresh draws. Write tuned.yaml, a parameter '
           'file, all other Pareto-optimal gains, figures and index.html.')
#: Options that are keys of the spec, and of its section `tune`.
_KEYS = {'duration': 'duration', 'draws': 'repeats', 'seed': 'seed'}
_OF_TUNE = {'law': 'law', 'switching': 'switching', 'torque_limit': 'torque_limit',
            'torque_rate': 'torque_rate_limit'}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc tune`."""
    robot = parser.add_mutually_exclusive_group(required=True)
    robot.add_argument('file', nargs='?', metavar='F',
                       help='parameter file, or the name of one in the package, such as panda, '
                            'with a default uncertainty; or a spec with robot, uncertainty, '
                            'limits and ranges: docs/tuning.md')
    robot.add_argument('--params-file', metavar='F', help='parameter file')
    robot.add_argument('--identified', type=Path, metavar='DIR',
                       help='output of ctc identify; its intervals are the uncertainty')
    for name, values in (('law', LAWS), ('switching', SWITCHINGS)):
        parser.add_argument(f'--{name}', metavar='X', help=(
            "default: the spec's, or " + (
                'observer_feedback' if name == 'law' else 'implicit_observer')
            + f"; {' | '.join(values)}"))
    for name, text in (('torque-limit', 'largest torque [N·m]'),
                       ('torque-rate', 'largest change of the torque sent [N·m/s]')):
        parser.add_argument(f'--{name}', metavar='A,B,C',
                            help=f'{text}: a number per joint, or one for all; default: those of '
                                 'the file and the description')
    parser.add_argument('--trials', type=int, default=200, metavar='N',
                        help='gains to try, default: 200')
    parser.add_argument('--percentile', type=float, default=95.0, metavar='P',
                        help='percentile of error and torque variation over the draws, '
                             'default: 95; 100 for the worst case')
    parser.add_argument('--draws', type=int, metavar='N',
                        help="draws of what is uncertain, default: the spec's, or 32")
    parser.add_argument('--duration', type=float, metavar='S',
                        help="duration of a run [s], instead of the file's")
    parser.add_argument('--seed', type=int, metavar='S',
                        help="seed of search and draws, default: the spec's, or 0")
    add_jobs(parser, '; the result does not depend on it')
    add_format(parser)
    add_output(parser, 'tuned')


def run(options: argparse.Namespace) -> int:
    """Run `ctc tune`."""
    from ctc_chattering.cli.progress import counting_bar
    from ctc_chattering.runs import tune_page
    from ctc_chattering.runs.search import require_optuna
    from ctc_chattering.runs.tune import tune
    from ctc_chattering.runs.tune_page import NAMES, PAGE, TUNED, write_tuning

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
    with counting_bar(desc='tune', unit='run') as progress:
        tuning = tune(spec, options.trials, options.percentile, jobs=jobs,
                      show=partial(print, flush=True), progress=progress)
    write_tuning(tuning, out, options.format, options.said)
    print(tune_page.text(tuning))
    if tuning.best is None:
        raise CtcError(f'no trial keeps the limits; {tune_page.closest(tuning.trials)}; '
                       f'see {out / PAGE}')
    print()
    print_page(out / PAGE, f'ctc simulate {out / TUNED}')
    return 0


def _spec(options: argparse.Namespace) -> TuneSpec:
    """Return what is tuned, from a spec, a parameter file, or what was identified."""
    from ctc_chattering.configuration.yaml_file import read_yaml
    from ctc_chattering.runs.spec import errors_of
    from ctc_chattering.runs.tune import tune_spec
    from ctc_chattering.runs.tune_spec import parse_tune

    params_file = options.params_file
    if options.file:
        spec = find_file(options.file)
        tree = read_yaml(spec)
        if 'ros__parameters' not in str(tree):
            with errors_of(spec):
                return parse_tune(_given(tree, options), spec)
        params_file = options.file
    tree = {'params_file': params_file} if params_file else {}
    return tune_spec(_given(tree, options), options.identified)


def _given(tree: Any, options: argparse.Namespace) -> Any:
    """Return a spec with the options in place of its values."""
    if not isinstance(tree, dict):
        return tree
    values = {key: x for name, key in _KEYS.items() if (x := getattr(options, name)) is not None}
    section = {key: x for name, key in _OF_TUNE.items()
               if (x := getattr(options, name)) is not None}
    for key in ('torque_limit', 'torque_rate_limit'):
        if key in section:
            limits = numbers(f'tune.{key}', section[key])
            section[key] = list(limits) if len(limits) > 1 else limits[0]
    return {**tree, **values, **({'tune': {**(tree.get('tune') or {}), **section}}
                                 if section else {})}

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

"""Arguments that several commands share."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from math import isfinite
import os
from pathlib import Path
from typing import Any

from ctc_chattering.cli.command_line import say
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loading import FROM_FILE, RECOMMENDED, with_gains
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.package_share import config_directory, find_config
from ctc_chattering.control.controller import LAWS
from ctc_chattering.control.controller_config import SWITCHINGS
from ctc_chattering.errors import given_by_user, UsageError
from ctc_chattering.parameters import Parameter

#: Options that override a parameter file, and the sections of their parameters.
_SECTIONS = {'law': 'controller', 'switching': 'controller', 'control_period': '/**',
             'duration': 'plant', 'pacing': 'plant'}


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that select a run: the file, and values that override it."""
    add_loop_options(parser)
    parser.add_argument('--switching', metavar='X',
                        help=f"instead of the file's: {' | '.join(SWITCHINGS)}")
    parser.add_argument('--duration', type=float, metavar='S', help="instead of the file's [s]")


def add_loop_options(parser: argparse.ArgumentParser) -> None:
    """Add the file, and the options of its law and period."""
    add_params_file(parser)
    parser.add_argument('--law', metavar='X', help=f"instead of the file's: {' | '.join(LAWS)}")
    parser.add_argument('--gains', choices=(FROM_FILE, RECOMMENDED),
                        help="the file's, or those recommended for observer_feedback; default: "
                             "the file's, but the recommended ones if --law chooses this law")
    parser.add_argument('--control-period', type=float, metavar='S',
                        help="instead of the file's [s]")


def add_params_file(parser: argparse.ArgumentParser) -> None:
    """Add the argument that names the parameter file, which is an option as well."""
    parser.set_defaults(params_file='friction')
    parser.add_argument(
        'params_file', nargs='?', metavar='F', default=argparse.SUPPRESS,
        help='parameter file, or the name of one in the package, such as panda; default: '
             "friction, the paper's first experiment")
    parser.add_argument('--params-file', metavar='F', default=argparse.SUPPRESS,
                        help='the same')


def add_urdf_options(parser: argparse.ArgumentParser, required: bool = False) -> None:
    """Add the options of a robot that a URDF describes."""
    parser.add_argument('--urdf', metavar='FILE', required=required,
                        help='URDF: a path or package://NAME/PATH')
    parser.add_argument('--joints', metavar='A,B,C',
                        help='joints in the order of the model; default: all that move')
    parser.add_argument('--gravity', type=float, default=9.81, metavar='G',
                        help='acceleration of gravity [m/s²], default: 9.81')


def add_bag(parser: argparse.ArgumentParser) -> None:
    """Add the argument that names a bag."""
    parser.add_argument('bag', type=Path, metavar='BAG', help='directory of the bag')


def add_own(parser: argparse.ArgumentParser) -> None:
    """Add the options of classes of one's own, which a bag only names."""
    for name in ('model', 'law', 'switching'):
        parser.add_argument(f'--{name}', default='', metavar='X',
                            help=f'your own {name}, package.module:Name, if a bag names one')


def own(options: argparse.Namespace) -> dict[str, str]:
    """Return the arguments of `read_bag` that `add_own` makes options of."""
    return {name: getattr(options, name) for name in ('model', 'law', 'switching')}


def add_output(parser: argparse.ArgumentParser, default: str | None = None) -> None:
    """Add the options of the directory to write into."""
    parser.add_argument(
        '--out', type=Path, metavar='DIR', default=default and Path(default),
        help=f'output directory, default: {default}' if default
        else 'output directory; without it, results are only printed')
    parser.add_argument('--overwrite', action='store_true',
                        help='replace the output of an earlier run of this command')


def add_format(parser: argparse.ArgumentParser, first: str = 'svg') -> None:
    """Add the option of a second format of all figures; the `first` is that of the page."""
    parser.add_argument('--format', choices=('svg', 'pdf', 'png'), default=first,
                        help=f'figures in this format as well; the page has them as {first}')


def add_jobs(parser: argparse.ArgumentParser, more: str = '') -> None:
    """Add the option of the number of processes; `more` is what its help says besides."""
    parser.add_argument('--jobs', type=int, metavar='N',
                        help=f'number of processes, default: one per processor{more}')


def find_file(text: str) -> Path:
    """Return the parameter file that `text` names: a path, or ``panda`` for the package's own."""
    return find_config(text)


def is_parameter_file(text: str) -> bool:
    """Return whether `text` names a parameter file, and no bag: one of the package, or YAML."""
    return Path(text).suffix == '.yaml' or (
        not Path(text).exists() and (config_directory() / f'{text}.yaml').exists())


def overrides(options: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Return the values that override the file's, as `parameter_file.load` takes them."""
    result: dict[str, dict[str, Any]] = {}
    for name, section in _SECTIONS.items():
        value = getattr(options, name, None)
        if value is not None:
            result.setdefault(section, {})[name] = value
    return result


def load_setup(options: argparse.Namespace, more: Mapping[str, Any] | None = None
               ) -> tuple[Path, Any, Setup]:
    """
    Return the parameter file, the values that override it, and both, checked.

    Values by node in `more` override those of the options. Gains that are taken beside those of
    the file are said in a line.
    """
    file, over = find_file(options.params_file), overrides(options)
    for node, values in (more or {}).items():
        over.setdefault(node, {}).update(values)
    with given_by_user({name for values in over.values() for name in values}):
        over, line = with_gains(file, over, getattr(options, 'gains', None))
        setup = parameter_file.load(file, over)
    if line:
        say(line)
    return file, over, setup


def check(option: str, value: float, minimum: float, exclusive: bool = False) -> None:
    """Raise `UsageError` unless the value of an option is finite and large enough."""
    with given_by_user([option]):
        Parameter(option, type(value).__name__, None, '', minimum=minimum,
                  exclusive=exclusive).check(value, 0)


def numbers(option: str, text: str, n: int = 0, allowed: str = '',
            is_allowed: Callable[[float], bool] = isfinite) -> tuple[float, ...]:
    """
    Return the numbers of an option; raise `UsageError` for others.

    These are n, one for each joint or one for all; where n is 0, as many as there are.
    """
    try:
        values = [float(x) for x in text.split(',')]
    except ValueError:
        values = []
    if len(values) not in (1, n or len(values) or 1) or not all(map(is_allowed, values)):
        shown = text if len(text) < 100 else f'{text[:100]}…'
        raise UsageError(f'{option}: {shown} is not allowed; allowed: a number{allowed}, or '
                         f'{n or "one for each joint,"} with commas')
    return tuple(values * n if n and len(values) == 1 else values)


def number_of_jobs(number: int | None) -> int:
    """Return the number of processes; by default all processors, or one without dask."""
    default = os.cpu_count() or 1 if find_spec('distributed') else 1
    jobs = default if number is None else number
    check('--jobs', jobs, 1)
    return jobs

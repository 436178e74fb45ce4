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

"""Arguments that several commands share; numbers are checked where they are read."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
import dataclasses
from importlib.util import find_spec
from math import isfinite
import os
from pathlib import Path
from typing import Any

from ctc_chattering.cli.command_line import say
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.configuration.parameter_file import FROM_FILE, RECOMMENDED, with_gains
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import as_usage_error, ParameterError, UsageError
from ctc_chattering.parameters import Parameter, unit_text
from ctc_chattering.simulation.plant_config import PlantConfig

#: Most processes of a command: each takes some 100 MB.
_MOST_JOBS = 1000
#: Options that override a parameter file, and the sections of their parameters.
_SECTIONS = {'law': 'controller', 'switching': 'controller', 'control_period': '/**',
             'duration': 'plant', 'pacing': 'plant'}
#: What makes the value of an option of its text.
_KINDS: dict[str, Callable[[str], Any]] = {
    'int': int, 'float': float, 'str': str,
    'float[]': lambda text: tuple(float(x) for x in text.split(','))}
_METAVARS = {'int': 'N', 'float': 'X', 'str': 'X', 'float[]': 'A,B,C'}


def value_of(spec: Parameter) -> Callable[[str], Any]:
    """Return what makes a value of text; it raises an error if the parameter refuses it."""
    def value(text: str) -> Any:
        try:
            made = _KINDS[spec.kind](text)
            spec.check(made, len(made) if isinstance(made, tuple) else 0)
        except ParameterError as error:
            raise UsageError(str(error)) from None
        except ValueError:
            raise argparse.ArgumentTypeError(
                f'{text[:100]!r} is not allowed; allowed: {spec.allowed}') from None
        return made
    return value


def add_declared(parser: argparse.ArgumentParser, spec: Parameter) -> None:
    """
    Add the option that a parameter declares: type, range, default, unit and description.

    Parameters
    ----------
    parser : ArgumentParser
        Of the command.
    spec : Parameter
        Without a default where that of another place counts.

    """
    name = spec.name.lstrip('-').replace('-', '_')
    text = spec.description.rstrip('.') + (f' [{unit_text(spec.unit)}]' if spec.unit else '')
    text += f': {" | ".join(spec.choices)}' if spec.choices else ''
    text += ', for each joint or one for all' if spec.shape == 'n' else ''
    if isinstance(spec.default, (int, float)) and isfinite(spec.default):
        text += f'; default: {spec.default:g}'
    parser.add_argument(
        f'--{name.replace("_", "-")}', type=value_of(spec), default=spec.default,
        metavar='S' if spec.unit == 's' else _METAVARS[spec.kind],
        help=text[0].lower() + text[1:])


def add_number(parser: argparse.ArgumentParser, flag: str, description: str, default: Any = None,
               kind: str = 'int', **limits: Any) -> None:
    """Add an option of one number; `limits` are those of a `Parameter`."""
    add_declared(parser, Parameter(flag, kind, default, description, **limits))


def add_overrides(parser: argparse.ArgumentParser, *names: str) -> None:
    """Add options of parameters of plant and controller, without a default."""
    declared = PlantConfig.parameters() | ControllerConfig.parameters()
    for name in names:
        add_declared(parser, dataclasses.replace(
            declared[name], description="instead of the file's", default=None))


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that select a run: the file, and values that override it."""
    add_loop_options(parser)
    add_overrides(parser, 'switching', 'duration')


def add_loop_options(parser: argparse.ArgumentParser) -> None:
    """Add the file, and the options of its law and period."""
    add_params_file(parser)
    add_overrides(parser, 'law', 'control_period')
    parser.add_argument('--gains', choices=(FROM_FILE, RECOMMENDED),
                        help="the file's, or those recommended for observer_feedback; default: "
                             "the file's, but the recommended ones if --law chooses this law")


def add_params_file(parser: argparse.ArgumentParser) -> None:
    """Add the argument that names the parameter file, which is an option as well."""
    parser.set_defaults(params_file='friction')
    parser.add_argument(
        'params_file', nargs='?', metavar='F', default=argparse.SUPPRESS,
        help='parameter file, or the name of one in the package, such as panda; default: '
             "friction, the paper's first experiment")
    parser.add_argument('--params-file', metavar='F', default=argparse.SUPPRESS,
                        help='the same')


def add_urdf_options(parser: argparse.ArgumentParser, required: bool = False,
                     default: str = 'all that move') -> None:
    """Add the options of a robot that a URDF describes; `default` says which joints it has."""
    parser.add_argument('--urdf', metavar='FILE', required=required,
                        help='URDF: a path or package://NAME/PATH')
    parser.add_argument('--joints', type=words, default=(), metavar='A,B,C',
                        help=f'joints in the order of the model; default: {default}')
    add_number(parser, '--gravity', 'acceleration of gravity', 9.81, 'float', unit='m/s^2',
               minimum=0.0)


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


def add_output(parser: argparse.ArgumentParser, default: str | None = None,
               figures: bool = True) -> None:
    """Add the options of the directory to write into, and of a second format of `figures`."""
    if figures:
        parser.add_argument('--format', choices=('svg', 'pdf', 'png'), default='svg',
                            help='figures in this format as well; the page has them as svg')
    parser.add_argument(
        '--out', type=Path, metavar='DIR', default=default and Path(default),
        help=f'output directory, default: {default}' if default
        else 'output directory; without it, results are only printed')
    parser.add_argument('--overwrite', action='store_true',
                        help='replace the output of an earlier run of this command')


def add_jobs(parser: Any) -> None:
    """Add the option of the number of processes: all processors, or one without dask."""
    parser.add_argument(
        '--jobs', metavar='N',
        type=value_of(Parameter('--jobs', 'int', None, '', minimum=1, maximum=_MOST_JOBS)),
        # Text, so that the same number given beside an option that excludes it is refused.
        default=str((os.cpu_count() or 1) if find_spec('distributed') else 1),
        help='number of processes, default: one per processor; no result depends on it')


def words(text: str) -> tuple[str, ...]:
    """Return the words between commas."""
    return tuple(filter(None, map(str.strip, text.split(','))))


def load_setup(options: argparse.Namespace, more: Mapping[str, Any] | None = None) -> Setup:
    """
    Return what the parameter file and the options say, checked.

    Values by node in `more` override those of the options. Gains that are taken beside those of
    the file are said in a line.
    """
    file, over = find_config(options.params_file), dict[str, dict[str, Any]]()
    for name, section in _SECTIONS.items():
        if getattr(options, name, None) is not None:
            over.setdefault(section, {})[name] = getattr(options, name)
    for node, values in (more or {}).items():
        over.setdefault(node, {}).update(values)
    with as_usage_error({name for values in over.values() for name in values}):
        over, line = with_gains(file, over, getattr(options, 'gains', None))
        setup = parameter_file.load(file, over)
    if line:
        say(line)
    return setup

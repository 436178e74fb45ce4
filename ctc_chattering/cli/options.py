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

"""Options that several commands share, and the parameter file that they select."""

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
from ctc_chattering.parameters import Parameter
from ctc_chattering.simulation.plant_config import PlantConfig

#: Options that override a parameter file, and the sections of their parameters.
_SECTIONS = {'law': 'controller', 'switching': 'controller', 'control_period': '/**',
             'duration': 'plant', 'pacing': 'plant'}
#: Converters of an option's text, by kind of parameter.
_CONVERTERS: dict[str, Callable[[str], Any]] = {
    'int': int, 'float': float, 'str': str,
    'float[]': lambda text: tuple(float(x) for x in text.split(','))}
#: Largest number of processes of a command. Each takes about 100 MB.
_MAX_JOBS = 1000
_METAVARS = {'int': 'N', 'float': 'X', 'str': 'X', 'float[]': 'A,B,C'}


def value_of(spec: Parameter) -> Callable[[str], Any]:
    """Return a function that converts an option's text to a value of this parameter."""
    def convert(text: str) -> Any:
        try:
            value = _CONVERTERS[spec.kind](text)
            spec.check(value, len(value) if isinstance(value, tuple) else 0)
        except ParameterError as error:
            raise UsageError(str(error)) from None
        except ValueError:
            raise argparse.ArgumentTypeError(
                f'{text[:100]!r} is not allowed; allowed: {spec.allowed}') from None
        return value
    return convert


def add_declared(parser: Any, spec: Parameter) -> None:
    """
    Add the option that a parameter declares, with unit, range and default in its help.

    Parameters
    ----------
    parser : ArgumentParser or group of options
        Parser of the command.
    spec : Parameter
        Declaration. Its default is None if the value comes from elsewhere.

    """
    name = spec.name.lstrip('-').replace('_', '-')
    description = spec.description.rstrip('.')
    sentences = [description[:1].upper() + description[1:]]
    if isinstance(spec.default, (int, float)) and isfinite(spec.default):
        sentences.append(f'Default: {spec.default:g}')
    facts = f' [{spec.facts}]' if spec.facts else ''
    parser.add_argument(
        f'--{name}', type=value_of(spec), default=spec.default,
        metavar='S' if spec.unit == 's' else _METAVARS[spec.kind],
        help=f'{". ".join(sentences)}.{facts}')


def add_number(parser: Any, flag: str, description: str, default: Any = None,
               kind: str = 'int', **limits: Any) -> None:
    """Add an option with one number; `limits` are attributes of `Parameter`."""
    add_declared(parser, Parameter(flag, kind, default, description, **limits))


def add_overrides(parser: argparse.ArgumentParser, *names: str) -> None:
    """Add options that override parameters of plant and controller."""
    declared = PlantConfig.parameters() | ControllerConfig.parameters()
    for name in names:
        spec = declared[name]
        add_declared(parser, dataclasses.replace(
            spec, default=None,
            description=f'{spec.description} Default: the value in the parameter file'))


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that select a run: the file, and values that override it."""
    add_loop_options(parser)
    add_overrides(parser, 'switching', 'duration')


def add_loop_options(parser: argparse.ArgumentParser) -> None:
    """Add the file, and the options of its law and period."""
    add_params_file(parser)
    add_overrides(parser, 'law', 'control_period')
    parser.add_argument('--gains', choices=(FROM_FILE, RECOMMENDED),
                        help='Gains of the parameter file, or the recommended gains of law '
                             'observer_feedback. Default: file, but gains that suit --law '
                             'if the file has those of another kind of law.')


def add_params_file(parser: argparse.ArgumentParser) -> None:
    """Add the parameter file as an argument, and as an option with the same meaning."""
    parser.set_defaults(params_file='friction')
    parser.add_argument(
        'params_file', nargs='?', metavar='F', default=argparse.SUPPRESS,
        help='Parameter file, or the name of one in the package, for example panda. Default: '
             "friction, the paper's first experiment.")
    parser.add_argument('--params-file', metavar='F', default=argparse.SUPPRESS,
                        help='The same parameter file, given as an option.')


def add_urdf_options(parser: argparse.ArgumentParser, required: bool = False,
                     default: str = 'all movable joints') -> None:
    """Add the options of a robot that a URDF describes; `default` says which joints it has."""
    parser.add_argument('--urdf', metavar='FILE', required=required,
                        help='URDF of the robot, as a path or package://NAME/PATH.')
    parser.add_argument('--joints', type=words, default=(), metavar='A,B,C',
                        help=f'Joints in the order of the model. Default: {default}.')
    add_number(parser, '--gravity', 'Acceleration of gravity', 9.81, 'float', unit='m/s^2',
               minimum=0.0)


def add_bag(parser: argparse.ArgumentParser) -> None:
    """Add the argument that names a bag."""
    parser.add_argument('bag', type=Path, metavar='BAG', help='Directory of the bag.')


def add_own(parser: argparse.ArgumentParser) -> None:
    """Add the options for a user's classes, which a bag only names."""
    for name in ('model', 'law', 'switching'):
        parser.add_argument(f'--{name}', default='', metavar='X',
                            help=f'Your own {name} as package.module:Name. It is needed if the '
                                 f'bag was recorded with a {name} of your own.')


def own(options: argparse.Namespace) -> dict[str, str]:
    """Return the arguments of `read_bag` that `add_own` declares."""
    return {name: getattr(options, name) for name in ('model', 'law', 'switching')}


def add_output(parser: argparse.ArgumentParser, default: str | None = None,
               figures: bool = True) -> None:
    """Add the options of the output directory, and of a second format of `figures`."""
    if figures:
        parser.add_argument('--format', choices=('svg', 'pdf', 'png'), default='svg',
                            help='Further format of the figures. The page always shows svg. '
                                 'Default: svg alone.')
    parser.add_argument(
        '--out', type=Path, metavar='DIR', default=default and Path(default),
        help=f'Output directory. Default: {default}.' if default
        else 'Output directory. Without it the command only prints its results.')
    add_overwrite(parser, 'the output of an earlier run of this command')


def add_overwrite(parser: argparse.ArgumentParser, what: str = 'an existing file') -> None:
    """Add the option that permits to replace output."""
    parser.add_argument('--overwrite', action='store_true', help=f'Replace {what}.')


def add_jobs(parser: Any) -> None:
    """Add the option of the number of processes: all processors, or one without dask."""
    parser.add_argument(
        '--jobs', metavar='N',
        type=value_of(Parameter('--jobs', 'int', None, '', minimum=1, maximum=_MAX_JOBS)),
        # Text, so that the same number given beside an option that excludes it is refused.
        default=str((os.cpu_count() or 1) if find_spec('distributed') else 1),
        help='Number of processes. The results do not depend on it. Default: one per processor. '
             f'[1 to {_MAX_JOBS}]')


def words(text: str) -> tuple[str, ...]:
    """Return the words between commas."""
    return tuple(filter(None, map(str.strip, text.split(','))))


def load_setup(options: argparse.Namespace, values: Mapping[str, Any] | None = None) -> Setup:
    """
    Return the checked setup of the parameter file and the options.

    `values` by node have precedence over the options. A remark on standard error says so if gains
    are recommended ones instead of those in the file.
    """
    file = find_config(options.params_file)
    overrides: dict[str, dict[str, Any]] = {}
    for name, section in _SECTIONS.items():
        if getattr(options, name, None) is not None:
            overrides.setdefault(section, {})[name] = getattr(options, name)
    for node, node_values in (values or {}).items():
        overrides.setdefault(node, {}).update(node_values)
    with as_usage_error({name for section in overrides.values() for name in section}):
        overrides, remark = with_gains(file, overrides, getattr(options, 'gains', None))
        setup = parameter_file.load(file, overrides)
    if remark:
        say(remark)
    return setup

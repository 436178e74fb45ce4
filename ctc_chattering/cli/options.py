"""Arguments that several commands share, and exit statuses."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from importlib.util import find_spec
import os
from pathlib import Path
import re
import sys
import tempfile
import traceback
from typing import Any, NoReturn

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.control.controller import LAWS
from ctc_chattering.control.switching import SWITCHINGS
from ctc_chattering.errors import CtcError, given_by_user, near, UsageError
from ctc_chattering.parameters import Parameter

#: Names for pip of modules that are called otherwise.
_PACKAGES = {'pinocchio': 'pin', 'yaml': 'PyYAML', 'dask': "'dask[distributed]'",
             'distributed': "'dask[distributed]'"}
#: Modules of ROS whose names do not end in _msgs.
_OF_ROS = ('builtin_interfaces', 'rcl_interfaces', 'rclpy', 'rpyutils', 'std_srvs')
#: Options that override a parameter file, and the sections of their parameters.
_SECTIONS = {'law': 'controller', 'switching': 'controller', 'control_period': '/**',
             'duration': 'plant', 'pacing': 'plant'}


class Parser(argparse.ArgumentParser):
    """A parser whose error message is one line."""

    def error(self, message: str) -> NoReturn:
        """Raise `UsageError`."""
        word, *known = re.findall(r"'([^']*)'", message) if 'invalid choice' in message else ['']
        raise UsageError(f'{message}{near(word, known)}; see {self.prog} --help')


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that select a run: the file, and values that override it."""
    add_params_file(parser)
    for name, values in (('law', LAWS), ('switching', SWITCHINGS)):
        parser.add_argument(f'--{name}', metavar='X',
                            help=f"in place of the file's: {' | '.join(values)}")
    for name in ('control-period', 'duration'):
        parser.add_argument(
            f'--{name}', type=float, metavar='S', help="in place of the file's [s]")


def add_params_file(parser: argparse.ArgumentParser) -> None:
    """Add the option that names the parameter file."""
    parser.add_argument(
        '--params-file', default='friction', metavar='F',
        help='parameter file, or the name of one of the package, such as panda; friction, the '
             "paper's first experiment, by default")


def add_engine_option(parser: argparse.ArgumentParser) -> None:
    """Add the option that chooses what simulates."""
    parser.add_argument('--engine', choices=('batch', 'reference'),
                        help='the compiled loop, the default if numba is installed, where it can '
                             'run what is asked for; or the loop of ctc simulate')


def chosen_engine(options: argparse.Namespace) -> str | None:
    """Return what simulates, None for what there is; raise `UsageError` if it is not there."""
    from ctc_chattering.analysis.engine import available

    engine: str | None = options.engine
    available(engine)
    return engine


def find_file(text: str) -> Path:
    """Return the parameter file that `text` names: a path, or ``panda`` for the package's own."""
    return find_config(text)


def overrides(options: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Return the values that override the file's, as `parameter_file.load` takes them."""
    result: dict[str, dict[str, Any]] = {}
    for name, section in _SECTIONS.items():
        value = getattr(options, name, None)
        if value is not None:
            result.setdefault(section, {})[name] = value
    return result


def load_setup(options: argparse.Namespace) -> tuple[Path, Any, parameter_file.Setup]:
    """Return the parameter file, the values that override it, and both, checked."""
    file, over = find_file(options.params_file), overrides(options)
    with given_by_user(name for values in over.values() for name in values):
        return file, over, parameter_file.load(file, over)


def check(option: str, value: float, minimum: float, exclusive: bool = False) -> None:
    """Raise `UsageError` unless the value of an option is finite and large enough."""
    with given_by_user([option]):
        Parameter(option, type(value).__name__, None, '', minimum=minimum,
                  exclusive=exclusive).check(value, 0)


def number_of_jobs(number: int | None) -> int:
    """Return the number of processes; by default all processors, or one without dask."""
    default = os.cpu_count() or 1 if find_spec('distributed') else 1
    jobs = default if number is None else number
    check('--jobs', jobs, 1)
    return jobs


def guarded(name: str, command: Callable[[], int]) -> int:
    """
    Run a command; a `CtcError`, or too little memory, becomes one line.

    The status is then 1, or 2 if the command line is wrong or a package is missing. Any other
    exception is a defect of this package: it becomes one line, too, and its traceback a file.
    """
    try:
        return command()
    except CtcError as error:
        print(f'{name}: {error}', file=sys.stderr, flush=True)
        return 2 if isinstance(error, UsageError) else 1
    except MemoryError as error:
        print(f'{name}: too little memory: {error}'.rstrip(': '), file=sys.stderr, flush=True)
        return 1
    except KeyboardInterrupt as stop:
        print(f'{name}: {str(stop) or "stopped"}', file=sys.stderr, flush=True)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as error:  # Whatever else comes must not reach a user as a traceback.
        missing = _how_to_install(error) if isinstance(error, ModuleNotFoundError) else ''
        print(f'{name}: {missing or _defect(error)}', file=sys.stderr, flush=True)
        return 2 if missing else 1


def _how_to_install(error: ModuleNotFoundError) -> str:
    """Return how to install a missing package; '' if it is one of this package."""
    module = (error.name or '').split('.')[0]
    if module in _OF_ROS or module.endswith('_msgs'):
        return (f'ROS 2 is missing (no module {module}): source its setup file, or install the '
                "wheels from the checkout: pip install '.[ros]'")
    if module == 'ctc_chattering':
        return ''
    return f'{module} is missing: pip install {_PACKAGES.get(module, module)}'


def _defect(error: Exception) -> str:
    """Write the traceback of a defect into a file; return the line that names it."""
    text = ' '.join(f'{type(error).__name__}: {error}'.split())
    with tempfile.NamedTemporaryFile('w', prefix='ctc_chattering-', suffix='.txt', delete=False,
                                     encoding='utf-8') as file:
        traceback.print_exception(error, file=file)
    return f'{text}. This is a defect of ctc_chattering: please report it with {file.name}'

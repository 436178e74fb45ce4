"""Arguments that several commands share, and exit statuses."""

from __future__ import annotations

import argparse
from collections.abc import Callable
import os
from pathlib import Path
import sys
from typing import Any, NoReturn

from ctc_chattering.control.controller import LAWS
from ctc_chattering.control.switching import SWITCHINGS
from ctc_chattering.errors import CtcError, UsageError
from ctc_chattering.experiment.package_share import config_directory

#: Packages that may be missing: module, and name for pip.
_PACKAGES = {'matplotlib': 'matplotlib', 'mcap': 'mcap', 'mujoco': 'mujoco', 'numpy': 'numpy',
             'pinocchio': 'pin', 'rosbags': 'rosbags', 'tqdm': 'tqdm', 'yaml': 'PyYAML'}
#: Modules of ROS whose names do not end in _msgs.
_OF_ROS = ('builtin_interfaces', 'rcl_interfaces', 'rclpy', 'rpyutils', 'std_srvs')


class Parser(argparse.ArgumentParser):
    """A parser whose error message is one line."""

    def error(self, message: str) -> NoReturn:
        """Raise `UsageError`."""
        raise UsageError(f'{message}; see --help')


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that select a run: the file, and values that override it."""
    parser.add_argument(
        '--params-file', type=parameter_file, metavar='F',
        help='parameter file, or the name of one of the package, such as panda; friction, the '
             "paper's first experiment, by default")
    for name, values in (('law', LAWS), ('switching', SWITCHINGS)):
        parser.add_argument(f'--{name}', metavar='X',
                            help=f"in place of the file's: {' | '.join(values)}")
    parser.add_argument(
        '--control-period', type=float, metavar='S', help="in place of the file's [s]")
    parser.add_argument(
        '--duration', type=float, metavar='S', help="in place of the file's [s]")


def parameter_file(text: str) -> Path:
    """Return the parameter file that `text` names: a path, or ``panda`` for the package's own."""
    installed = config_directory() / f'{text}.yaml'
    return installed if Path(text).name == text and installed.exists() else Path(text)


def params_file(options: argparse.Namespace) -> Path:
    """Return the parameter file asked for, or that of the first experiment."""
    given: Path | None = options.params_file
    return given or parameter_file('friction')


def overrides(options: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Return what `add_run_options` read, as `params.load` takes it."""
    law = {name: getattr(options, name) for name in ('law', 'switching')
           if getattr(options, name) is not None}
    result: dict[str, dict[str, Any]] = {'controller': law} if law else {}
    if options.duration is not None:
        result['plant'] = {'duration': options.duration}
    if options.control_period is not None:
        result['/**'] = {'control_period': options.control_period}
    return result


def guarded(name: str, command: Callable[[], int]) -> int:
    """
    Run a command; a `CtcError` becomes one line.

    The status is then 1, or 2 if the command line is wrong or a package is missing.
    """
    try:
        return command()
    except CtcError as error:
        print(f'{name}: {error}', file=sys.stderr, flush=True)
        return 2 if isinstance(error, UsageError) else 1
    except ModuleNotFoundError as error:
        print(f'{name}: {_how_to_install(error)}', file=sys.stderr, flush=True)
        return 2
    except KeyboardInterrupt:
        print(f'{name}: stopped', file=sys.stderr, flush=True)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1


def _how_to_install(error: ModuleNotFoundError) -> str:
    """Return how to install a missing package; raise an error that has another cause."""
    module = (error.name or '').split('.')[0]
    if module in _OF_ROS or module.endswith('_msgs'):
        return (f'ROS 2 is missing (no module {module}): source its setup file, or install the '
                "wheels from the checkout: pip install '.[ros]'")
    if module not in _PACKAGES:
        raise error
    return f'{module} is missing: pip install {_PACKAGES[module]}'

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

"""Parser, exit statuses and one-line errors that all command lines share."""

from __future__ import annotations

import argparse
from collections.abc import Callable
import os
import sys
import traceback
from typing import Any, NoReturn

from ctc_chattering.errors import CtcError, suggest, UsageError


class Parser(argparse.ArgumentParser):
    """A parser whose error message is one line."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(add_help=False, **settings)
        self.add_argument('-h', '--help', action='help', help='Print this help and exit.')

    def error(self, message: str) -> NoReturn:
        """Raise `UsageError`."""
        raise UsageError(f'{message}; see {self.prog} --help')

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse a value that is no choice, and suggest a similar choice."""
        if action.choices is not None and value not in action.choices:
            choices = list(action.choices)
            raise argparse.ArgumentError(
                action, f'{value!r} is not allowed; allowed: {" | ".join(choices)}'
                f'{suggest(value, choices)}')


def say(line: str) -> None:
    """Print a remark on standard error, apart from the results."""
    print(line, file=sys.stderr, flush=True)


def guarded(name: str, command: Callable[[], int]) -> int:
    """
    Run a command and return its exit status.

    A `CtcError` or a lack of memory is printed as one line. The status is then 1, or 2 if the
    command line is wrong or a package is missing. Any other exception is a defect of this package
    and is printed with its traceback. From Python 3.11 on, processes that the command starts
    import nothing from the current directory.
    """
    os.environ.setdefault('PYTHONSAFEPATH', '1')
    try:
        return command()
    except CtcError as error:
        say(f'{name}: {error}')
        return 2 if isinstance(error, UsageError) else 1
    except MemoryError as error:
        say(f'{name}: the memory does not suffice: {error}'.rstrip(': '))
        return 1
    except KeyboardInterrupt as stop:
        say(f'{name}: {str(stop) or "stopped"}')
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as error:
        module = (getattr(error, 'name', None) or '').split('.')[0]
        if isinstance(error, ModuleNotFoundError) and module != 'ctc_chattering':
            say(f'{name}: the Python package {module} is missing; install it (docs/install.md)')
            return 2
        traceback.print_exc()
        say(f'{name}: this is a defect of ctc_chattering; please report the lines above')
        return 1

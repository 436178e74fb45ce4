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

"""What every command line has: errors of one line, and exit statuses."""

from __future__ import annotations

import argparse
from collections.abc import Callable
import os
import re
import sys
import traceback
from typing import NoReturn

from ctc_chattering.errors import CtcError, suggest, UsageError


class Parser(argparse.ArgumentParser):
    """A parser whose error message is one line."""

    def error(self, message: str) -> NoReturn:
        """Raise `UsageError`."""
        word, *known = re.findall(r"'([^']*)'", message) if 'invalid choice' in message else ['']
        raise UsageError(f'{message}{suggest(word, known)}; see {self.prog} --help')


def say(line: str) -> None:
    """Print a line that is no result."""
    print(line, file=sys.stderr, flush=True)


def guarded(name: str, command: Callable[[], int]) -> int:
    """
    Run a command; a `CtcError`, or too little memory, becomes one line.

    The status is then 1, or 2 if the command line is wrong or a package is missing. Any other
    exception is a defect of this package, and shown with its traceback.
    From Python 3.11 on, no process that it starts imports what lies in the current directory.
    """
    os.environ.setdefault('PYTHONSAFEPATH', '1')
    try:
        return command()
    except CtcError as error:
        say(f'{name}: {error}')
        return 2 if isinstance(error, UsageError) else 1
    except MemoryError as error:
        say(f'{name}: too little memory: {error}'.rstrip(': '))
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
            say(f'{name}: {module} is missing; docs/install.md says what to install')
            return 2
        traceback.print_exc()
        say(f'{name}: a defect of ctc_chattering; please report the lines above')
        return 1

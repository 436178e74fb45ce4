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

"""The package's exceptions: one base class, so that a caller catches all of them at once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
import difflib

#: Characters of a value in a message.
_LONGEST = 400


class CtcError(Exception):
    """Base of every error this package raises on purpose; its text is one line for a user."""


class UsageError(CtcError):
    """A command line that means nothing; the program ends with status 2."""


class MachineError(CtcError):
    """What the machine or its installation could not do: it says nothing of any numbers."""


class ParameterError(CtcError, ValueError):
    """
    A parameter whose value is not allowed.

    Parameters
    ----------
    name : str
        The parameter's name as in the YAML file.
    value : object
        The refused value.
    allowed : str
        What is allowed instead.

    """

    def __init__(self, name: str, value: object, allowed: str) -> None:
        super().__init__(name, value, allowed)
        self.name, self.value, self.allowed = name, value, allowed

    def __str__(self) -> str:
        """Return the line for a user, with as much of the value as fits in it."""
        shown = list(self.value) if isinstance(self.value, tuple) else self.value
        text = ' '.join(repr(shown).split())
        text = text if len(text) <= _LONGEST else f'{text[:_LONGEST]}…'
        return f'{self.name}: {text} is not allowed; allowed: {self.allowed}'


class RejectedMessage(CtcError):
    """
    A message that is not used.

    Parameters
    ----------
    kind : str
        One word, under which it is counted.
    reason : str
        What is wrong and what is allowed; empty where the count says enough.

    """

    def __init__(self, kind: str, reason: str = '') -> None:
        super().__init__(reason)
        self.kind = kind


def near(value: object, known: Iterable[str]) -> str:
    """Return "; did you mean NAME?" with the known name most like a wrong one; '' for none."""
    names = {name.lower(): name for name in known if name != value}
    found = difflib.get_close_matches(str(value).lower(), names, 1)
    return f'; did you mean {names[found[0]]}?' if found else ''


def shortened(names: Sequence[str], most: int = 12) -> str:
    """Return the first of some names, with commas, and how many more there are."""
    more = f', … ({len(names)} in all)' if len(names) > most else ''
    return ', '.join(name[:_LONGEST // most] for name in names[:most]) + more


@contextmanager
def given_by_user(names: Iterable[str]) -> Iterator[None]:
    """
    Turn the refusal of a value that stands on the command line into a `UsageError`.

    Parameters
    ----------
    names : iterable of str
        The parameters that stand there.

    """
    try:
        yield
    except ParameterError as error:
        if any(error.name == x or error.name.endswith((f' {x}', f'.{x}')) for x in names):
            raise UsageError(str(error)) from None
        raise


@contextmanager
def prefixed(prefix: str) -> Iterator[None]:
    """Put the file, the node or the key in front of the name of a parameter that is refused."""
    try:
        yield
    except ParameterError as error:
        raise ParameterError(prefix + error.name, error.value, error.allowed) from None


@contextmanager
def refused_as(what: str) -> Iterator[None]:
    """
    Turn whatever code that is not ours raises into a `CtcError` of one line.

    Parameters
    ----------
    what : str
        Beginning of the line.

    Raises
    ------
    MachineError
        If memory, a file or a module is missing.
    CtcError
        For everything else.

    """
    try:
        yield
    except CtcError:
        raise
    except (MemoryError, OSError, ImportError) as error:
        raise MachineError(f'{what}: {_line(error)}') from error
    except Exception as error:  # Libraries raise what they like.
        raise CtcError(f'{what}: {_line(error)}') from error


def _line(error: Exception) -> str:
    return ' '.join(f'{type(error).__name__}: {error}'.split()).removesuffix(':')

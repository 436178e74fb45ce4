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

"""
Exceptions of the package, and translators to them.

All exceptions have one base class, so that a caller catches all of them at once. A message is one
line for a user: what happened, and what is allowed instead.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
import difflib

#: Characters of a value, or of a list of names, in a message.
_MAX_LENGTH = 400


class CtcError(Exception):
    """Base of the errors that this package raises."""


class UsageError(CtcError):
    """A wrong command line, which ends with status 2."""


class MachineError(CtcError):
    """A failure of the machine or installation, not of the computation."""


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
        Values that are allowed instead.

    """

    def __init__(self, name: str, value: object, allowed: str) -> None:
        super().__init__(name, value, allowed)
        self.name = name
        self.value = value
        self.allowed = allowed

    def __str__(self) -> str:
        """Return the line for a user."""
        value = list(self.value) if isinstance(self.value, tuple) else self.value
        text = _one_line(repr(value))
        if len(text) > _MAX_LENGTH:
            text = f'{text[:_MAX_LENGTH]}…'
        return f'{self.name}: {text} is not allowed; allowed: {self.allowed}'


class RejectedMessage(CtcError):
    """
    A message that is not used.

    Parameters
    ----------
    kind : str
        One word, under which it is counted.
    reason : str
        What is wrong and what is allowed. Empty where the count says enough.

    """

    def __init__(self, kind: str, reason: str = '') -> None:
        super().__init__(reason)
        self.kind = kind


def suggest(value: object, names: Iterable[str]) -> str:
    """Return a question for the name that was meant."""
    candidates = {name.lower(): name for name in names if name != value}
    matches = difflib.get_close_matches(str(value).lower(), candidates, 1)
    return f'; did you mean {candidates[matches[0]]}?' if matches else ''


def shorten(names: Sequence[str], count: int = 12) -> str:
    """Return the first names of a list."""
    text = ', '.join(name[:_MAX_LENGTH // count] for name in names[:count])
    return text if len(names) <= count else f'{text}, … ({len(names)} in all)'


@contextmanager
def prefixed(prefix: str) -> Iterator[None]:
    """Put a prefix before the message of a `CtcError`."""
    try:
        yield
    except ParameterError as error:
        raise ParameterError(prefix + error.name, error.value, error.allowed) from None
    except MachineError as error:
        raise MachineError(f'{prefix}{error}') from None
    except CtcError as error:
        raise CtcError(f'{prefix}{error}') from None


@contextmanager
def as_usage_error(names: Collection[str]) -> Iterator[None]:
    """Turn the refusal of these parameters into a `UsageError`."""
    try:
        yield
    except ParameterError as error:
        endings = tuple(mark + name for mark in ' .' for name in names)
        if f' {error.name}'.endswith(endings):
            raise UsageError(str(error)) from None
        raise


@contextmanager
def as_file_error(summary: str) -> Iterator[None]:
    """Turn an error of the file system into a `CtcError`."""
    try:
        yield
    except OSError as error:
        raise CtcError(f'{summary}: {error.strerror or error}') from None


@contextmanager
def as_ctc_error(summary: str) -> Iterator[None]:
    """
    Turn exceptions of foreign code into a `CtcError`.

    Parameters
    ----------
    summary : str
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
        raise MachineError(f'{summary}: {_describe(error)}') from error
    except Exception as error:  # Libraries raise what they like.
        raise CtcError(f'{summary}: {_describe(error)}') from error


def _describe(error: Exception) -> str:
    return _one_line(f'{type(error).__name__}: {error}').removesuffix(':')


def _one_line(text: str) -> str:
    return ' '.join(text.split())

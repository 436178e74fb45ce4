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

"""Parameter files of a few sections, and refusals in one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.errors import CtcError
import pytest


def section(node: str, body: str) -> str:
    """Return the section of a node as YAML."""
    return f'"{node}":\n  ros__parameters:\n' + ''.join(
        f'    {line}\n' for line in body.splitlines())


def loaded(file: Path, *sections: tuple[str, str]) -> Setup:
    """Write sections into a file, and load it."""
    file.write_text(''.join(section(*x) for x in sections), encoding='utf-8')
    return parameter_file.load(file)


def refused(call: Callable[[], object], *words: str) -> None:
    """Assert that `call` raises one line with all `words` in it."""
    with pytest.raises(CtcError) as error:
        call()
    text = str(error.value)
    assert len(text.splitlines()) == 1
    assert [word for word in words if word not in text] == []

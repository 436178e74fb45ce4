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

"""Machine code that a test runs, compiled where it is not yet."""

from __future__ import annotations

from ctc_chattering.compiled.build import build
from ctc_chattering.configuration.compilation import compile_setups
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.controller import Controller


def compile_step(law: Controller) -> None:
    """Compile the steps of a controller until its next change."""
    step = law.compiled_step()
    assert step is not None
    for code in step.codes:
        if not code.compiled:
            build(code)
    law.memories = law.memories  # From now on, it is used.


def compile_runs(*setups: Setup) -> None:
    """Compile what these need."""
    compile_setups(setups, lambda _: None)

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

"""What machine code is worth: its time beside that of plain Python in the same run, and memory."""

from __future__ import annotations

from ctc_chattering.configuration import parameter_file
from ctc_chattering.control.controller import Controller
from ctc_commands import python
from machine_code import compile_step

#: What a process prints: peak of its memory [MB], whether it runs machine code, and has numba.
MEMORY = """
import sys
from ctc_chattering.control.controller import Controller, ControllerConfig
law = Controller(ControllerConfig(compiled={compiled}))
x = [0.1, 0.2]
law.step(x, x, x, x, x)
peak = next(line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM'))
print(int(peak) / 1024, law.compiled, 'numba' in sys.modules)
"""


def test_memory() -> None:
    """A process that runs machine code has LLVM in memory, and nothing else of a compiler."""
    compile_step(Controller(parameter_file.load(None).controller))
    found = [python('-c', MEMORY.format(compiled=x)).stdout.split() for x in (False, True)]
    print(found)
    assert [words[1:] for words in found] == [['False', 'False'], ['True', 'False']]
    assert float(found[1][0]) < 160.0

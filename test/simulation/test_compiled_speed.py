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

from collections.abc import Callable
import time
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.control.controller import Controller
from ctc_chattering.simulation.closed_loop import simulate
from ctc_commands import python
from machine_code import compile_runs, compile_step
import pytest

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


def least(call: Callable[[], Any], count: int, repeats: int) -> float:
    """Return the least computing time of `count` calls [s]; what else runs makes it longer."""
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        for _ in range(count):
            call()
        times.append(time.process_time() - begin)
    return min(times)


def step_of(law: str, compiled: bool) -> Callable[[], Any]:
    controller = Controller(parameter_file.load(None, {
        'controller': {'law': law, 'compiled': compiled}}).controller)
    if compiled:
        compile_step(controller)
    x, y = [3.0, 1.5], [0.1, 0.2]
    controller.step(x, y, x, y, y)
    assert controller.compiled == compiled
    return lambda: controller.step(x, y, x, y, y)


@pytest.mark.slow  # A busy machine would make it fail.
def test_a_step() -> None:
    """That of the law with most equations is none longer than the shortest of plain Python."""
    plain = least(step_of('compensation', False), 200, 30)
    for law, share in (('observer_feedback', 1.0), ('chattering', 0.5)):
        ratio = least(step_of(law, True), 200, 30) / plain
        print(f'{law}: {ratio:.2f} of the plain step of compensation, {1e6 * plain / 200:.1f} us')
        assert ratio < share


@pytest.mark.slow
def test_a_simulation() -> None:
    """10 s at 1 kHz take less than 0.05 s where plain Python takes 1 s."""
    times = []
    for compiled, repeats in ((False, 3), (True, 10)):
        setup = parameter_file.load(None, {
            'plant': {'duration': 10.0, 'compiled': compiled},
            'controller': {'compiled': compiled}})
        compile_runs(setup)
        run = setup.plant, setup.controller, setup.reference
        assert simulate(*run).compiled == compiled
        times.append(least(lambda: simulate(*run), 1, repeats))
    print(f'{times[0]:.3f} s of plain Python, {times[1]:.3f} s of machine code')
    assert times[1] < 0.05 * times[0]


def test_memory() -> None:
    """A process that runs machine code has LLVM in memory, and nothing else of a compiler."""
    compile_step(Controller(parameter_file.load(None).controller))
    found = [python('-c', MEMORY.format(compiled=x)).stdout.split() for x in (False, True)]
    print(found)
    assert [words[1:] for words in found] == [['False', 'False'], ['True', 'False']]
    assert float(found[1][0]) < 160.0

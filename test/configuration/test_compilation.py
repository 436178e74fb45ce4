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

"""Machine code for parameter files: what can be compiled, what is missing, and without numba."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import json
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.result import simulate
from ctc_chattering.compiled import machine_code
from ctc_chattering.compiled.machine_code import Code
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.compilation import (
    compile_setups,
    required_codes,
    uncompiled_codes,
)
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation import closed_loop
from ctc_commands import python
from machine_code import compile_runs
import numpy as np
import pytest

ELASTIC = {'joint_stiffness': [1e4, 1e4], 'joint_damping': [10.0, 10.0],
           'motor_inertia': [1.0, 0.1]}


def setup(plant: dict[str, Any] | None = None, **controller: Any) -> Setup:
    return parameter_file.load(None, {
        'plant': {'duration': 0.2, 'experiment': 'trial', **(plant or {})},
        'controller': {'switching': 'implicit_observer', **controller}})


def test_what_can_be_compiled() -> None:
    compile_runs(setup())
    assert required_codes(setup()) and not uncompiled_codes([setup()])
    for other in (
            setup(ELASTIC), setup({'compiled': False}), setup(compiled=False),
            parameter_file.load(find_config('switch'))):
        assert not required_codes(other)


def test_the_same_result() -> None:
    """Check states, metrics and terms; encoders make the measured states others."""
    sensor: dict[str, Any] = {'encoder_resolution': [0.01, 0.01]}
    compile_runs(setup(sensor))
    one, other = (simulate(made) for made in (
        setup({**sensor, 'compiled': False}, compiled=False), setup(sensor)))
    assert (one.run.compiled, other.run.compiled) == (False, True)
    for name, x in vars(one.run).items():
        if name not in ('compiled', 'correction'):
            np.testing.assert_allclose(x, vars(other.run)[name], rtol=1e-6, atol=1e-9)
    on_grid = np.abs(one.run.q / 0.01 - np.round(one.run.q / 0.01)).max() < 1e-9
    assert on_grid
    plain, compiled = (json.loads(
        json.dumps({**x.metrics(), 'notes': []}), parse_float=lambda text: f'{float(text):.9g}')
        for x in (one, other))
    assert plain == compiled
    assert (one.experiment, one.description) == (other.experiment, other.description)
    np.testing.assert_allclose(other.terms.tau, other.run.tau, rtol=1e-9, atol=1e-6)


def test_each_function_is_compiled_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Check what is said and made, with a compiler that only notes what it is asked for."""
    monkeypatch.setattr(machine_code, 'cache_directory', lambda: tmp_path)
    monkeypatch.setattr(closed_loop, '_LOOPS', {})
    said: list[str] = []
    made: list[str] = []

    def noted(todo: Sequence[Code]) -> Iterator[str]:
        made.extend(code.name for code in todo)
        yield from made

    monkeypatch.setattr('ctc_chattering.compiled.build.build_all', noted)
    assert compile_setups([setup(ELASTIC), setup(compiled=False)], said.append) == 0
    assert said == [] == [*tmp_path.iterdir()]
    names = ['dynamics-2', 'mass-2', 'control-chattering-2', 'plant-2', 'loop-2']
    assert [code.name for code in uncompiled_codes([setup(), setup()])] == names
    assert compile_setups([setup(), setup(ELASTIC), setup(kp=[1.0, 2.0])], said.append) == 5
    assert said == ['compiling 5 functions, once for this version ...', *(
        f'compiled {name} ({i} of 5)' for i, name in enumerate(names, 1))]
    assert made == names


def test_what_fails_in_a_process_that_compiles_is_said_once(
        monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
        ) -> None:
    """As on a full disk: the process says nothing, and this one raises the error."""
    def fail(code: Code) -> None:
        raise CtcError(f'cannot write {code.name}')

    monkeypatch.setattr(machine_code, 'cache_directory', lambda: tmp_path)
    monkeypatch.setattr(closed_loop, '_LOOPS', {})
    monkeypatch.setattr('ctc_chattering.compiled.build.build', fail)
    with pytest.raises(CtcError, match=r'^cannot write dynamics-2$'):
        compile_setups([setup()], lambda _: None)
    assert capfd.readouterr() == ('', '')


def test_without_numba_plain_python_runs(tmp_path: Path) -> None:
    """Check it in a process where an import fails, and whose user has nothing compiled."""
    reason = 'Numba needs NumPy 2.4 or less'
    (tmp_path / 'numba.py').write_text(f'raise ImportError({reason!r})\n')
    found = python('-c', (
        f'import os; os.environ["HOME"] = {str(tmp_path)!r}\n'
        'from ctc_chattering.configuration.compilation import compile_setups\n'
        'from ctc_chattering.analysis.result import simulate\n'
        'from ctc_chattering.configuration import parameter_file\n'
        'setup = parameter_file.load(None, {"plant": {"duration": 0.01}})\n'
        'made = compile_setups([setup], print)\n'
        'run = simulate(setup).run\n'
        'print(made, len(run.t), run.compiled)\n'), path=tmp_path)
    assert found.stdout.splitlines() == [
        'numba cannot be used, so the law runs in plain Python, 20 times slower: '
        f'{reason}. Install it: pip install numba', '0 11 False'], found.stderr


@pytest.mark.slow
def test_a_script_without_a_main_guard_compiles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch
                                                ) -> None:
    """Check that processes that compile do not run the user's script again."""
    monkeypatch.setenv('HOME', str(tmp_path))
    script = tmp_path / 'script.py'
    script.write_text('from ctc_chattering import compile_setup, load_parameters\n'
                      'print("begun")\n'
                      'setup = load_parameters()\n'
                      'print(compile_setup(setup), compile_setup(setup))\n')
    found = python(script, timeout=600.0)
    assert found.returncode == 0, found.stderr
    assert found.stdout.count('begun') == 1
    assert found.stdout.endswith('5 0\n')

"""What simulates a run, why, and that both engines give the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ctc_chattering.analysis.engine import (
    available,
    BATCH,
    compile_loop,
    engine_of,
    engine_text,
    ENGINES,
    REFERENCE,
    simulated_by,
)
from ctc_chattering.analysis.result import simulated
from ctc_chattering.batch import compiler
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.configuration.parameter_file import Setup
from ctc_commands import python
import numpy as np
import pytest

ELASTIC = {'joint_stiffness': [1e4, 1e4], 'joint_damping': [10.0, 10.0],
           'motor_inertia': [1.0, 0.1]}


def setup(plant: dict[str, Any] | None = None) -> Setup:
    return parameter_file.load(None, {
        'plant': {'duration': 0.2, 'experiment': 'trial', **(plant or {})},
        'controller': {'switching': 'implicit'}})


def test_the_compiled_loop_runs_what_it_can() -> None:
    assert available() == available(BATCH) == (BATCH, '')
    for engine in (None, BATCH):
        assert engine_of(setup(), engine) == (BATCH, '')
        assert engine_of(setup(ELASTIC), engine) == (REFERENCE, 'elastic joints')
    assert engine_text(setup()) == 'batch'
    assert engine_text(setup(ELASTIC)) == 'reference (elastic joints)'
    panda = parameter_file.load(find_config('panda'), {'plant': {'plant_backend': 'mujoco'}})
    assert engine_text(panda) == 'reference (plant_backend mujoco)'
    assert engine_text(parameter_file.load(find_config('switch'))) == 'reference (events)'


def test_the_reference_runs_what_it_is_asked_for() -> None:
    assert available(REFERENCE) == (REFERENCE, '')
    for made in (setup(), setup(ELASTIC)):
        assert engine_text(made, REFERENCE) == 'reference'


@pytest.mark.parametrize('truth', [True, False])
def test_both_engines_give_the_same_result(truth: bool) -> None:
    """Check states, metrics and terms; encoders make the measured states others."""
    made = setup({'encoder_resolution': [0.01, 0.01]})
    one, other = (simulated_by(made, engine, truth) for engine in ENGINES)
    assert one.run.q is not other.run.q
    for name, x in vars(one.run).items():
        np.testing.assert_allclose(x, vars(other.run)[name], rtol=1e-6, atol=1e-9)
    on_grid = np.abs(one.run.q / 0.01 - np.round(one.run.q / 0.01)).max() < 1e-9
    assert on_grid == (not truth)
    assert {**one.metrics(), 'notes': []} == {**other.metrics(), 'notes': []}
    assert (one.experiment, one.configs, one.description) == (
        other.experiment, other.configs, other.description)
    if not truth:
        np.testing.assert_allclose(one.terms.tau, one.run.tau, rtol=1e-9, atol=1e-6)


def test_the_reference_is_that_of_ctc_simulate() -> None:
    for made, engine in ((setup(), REFERENCE), (setup(ELASTIC), BATCH)):
        assert (simulated_by(made, engine).run.tau == simulated(made).run.tau).all()


def test_it_is_compiled_once_and_only_if_it_is_used(
        monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Check the line, with a directory in which it seems that nothing was compiled."""
    monkeypatch.setattr(compiler, 'cache_directory', lambda: tmp_path)
    said: list[str] = []
    compile_loop([setup(), setup()], REFERENCE, said.append)
    compile_loop([setup(ELASTIC)], None, said.append)
    assert said == [] and not compiler.is_compiled(2)
    compile_loop([setup(), setup(ELASTIC), setup()], None, said.append)
    assert len(said) == 1 and 'compiled for 2 joints first' in said[0]
    assert compiler.is_compiled(2)
    compile_loop([setup()], None, said.append)
    assert len(said) == 1


@pytest.mark.parametrize(('error', 'reason'), [
    ("ModuleNotFoundError('no', name='numba')", 'numba is not installed: pip install numba'),
    ("ModuleNotFoundError('no', name='llvmlite')",
     'llvmlite is not installed: pip install llvmlite'),
    ("ImportError('Numba needs NumPy 2.4 or less')", 'numba: Numba needs NumPy 2.4 or less')])
def test_without_numba_the_reference_runs(tmp_path: Path, error: str, reason: str) -> None:
    """Check it in a process where the import of numba fails."""
    (tmp_path / 'numba.py').write_text(f'raise {error}\n')
    found = python('-c', (
        'from ctc_chattering.analysis.engine import available, engine_text, simulated_by\n'
        'from ctc_chattering.errors import UsageError\n'
        'from ctc_chattering.configuration import parameter_file\n'
        'setup = parameter_file.load(None, {"plant": {"duration": 0.01}})\n'
        'print(engine_text(setup), len(simulated_by(setup).run.t), available("reference"))\n'
        'try:\n'
        '    available("batch")\n'
        'except UsageError as error:\n'
        '    print(error)\n'), path=tmp_path)
    assert found.stdout.splitlines() == [
        f"reference ({reason}) 11 ('reference', '')", f'--engine batch: {reason}'], found.stderr

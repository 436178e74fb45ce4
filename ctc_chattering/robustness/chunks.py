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

"""Chunks of runs that are computed together, and keys of all that their results depend on."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
import dataclasses
from functools import cache
import hashlib
import importlib.metadata
import json
from pathlib import Path
import sys
from typing import Any

import ctc_chattering
from ctc_chattering.analysis.compilation import compile_setups
from ctc_chattering.analysis.output import finite
from ctc_chattering.errors import CtcError, MachineError
from ctc_chattering.robustness import columns
from ctc_chattering.robustness.evaluation import evaluate, refused
from ctc_chattering.robustness.runs import Runs
from ctc_chattering.robustness.spec import MapSpec
import pyarrow

#: Control steps of a chunk, with the step of the file, times the square of the number of joints:
#: a second of work, half a minute where it is plain Python.
_STEPS = 4e6
#: Number of chunks, where there are as many runs, so that as many workers have work.
_FEWEST = 64
#: Packages whose versions are noted with the results.
_PACKAGES = ('numpy', 'scipy', 'numba', 'pyarrow', 'distributed')
#: What computes a row, relative to the package.
_SOURCES = ('errors.py', 'parameters.py', 'numerics', 'dynamics', 'trajectory', 'control',
            'simulation', 'configuration', 'analysis/metrics.py',
            'analysis/result.py', 'studies/recommended.py', 'studies/score.py',
            'robustness/chunks.py', 'robustness/columns.py', 'robustness/evaluation.py',
            'robustness/quantity.py', 'robustness/refinement.py', 'robustness/runs.py')


@cache
def version() -> str:
    """Return the version of the package and a word that changes with the text of what computes."""
    package, text = Path(ctc_chattering.__file__).parent, hashlib.sha256()
    for name in _SOURCES:
        path = package / name
        for file in sorted(path.rglob('*.py')) if path.is_dir() else [path]:
            text.update(file.read_bytes())
    return f'{ctc_chattering.__version__}+{text.hexdigest()[:12]}'


def schema(spec: MapSpec) -> pyarrow.Schema:
    """Return the columns of the results, with the unit of each that has one."""
    units = {quantity.name: quantity.unit for quantity in (*spec.axes, *spec.uncertain)}
    kinds = columns.of_map(list(units), len(spec.setup.controller.joint_names))
    return pyarrow.schema([
        pyarrow.field(name, pyarrow.type_for_alias(kind), metadata={'unit': unit} if (
            unit := units.get(name, columns.unit_of(name))) else None)
        for name, kind in kinds.items()])


def contents(runs: Runs) -> dict[str, Any]:
    """Return all that the results of a map depend on, besides the code, as JSON has it."""
    spec, setup = runs.spec, runs.spec.setup
    quantities = {kind: [{
        'name': x.name, 'parameters': [f'{node}.{spec.name}' for node, spec in x.targets],
        'factor': x.factor} for x in found]
        for kind, found in (('axes', spec.axes), ('uncertain', spec.uncertain))}
    for tree, axis in zip(quantities['axes'], spec.axes):
        tree['values'] = axis.values
    for tree, x, draws in zip(quantities['uncertain'], spec.uncertain, runs.draws.T):
        tree.update({x.distribution: x.numbers, 'draws': draws.tolist()})
    return {
        'parameters': dict(setup.values), 'route': setup.route,
        'descriptions': {node: hashlib.sha256(text.encode()).hexdigest()
                         for node, text in setup.descriptions.items()}, 'window': spec.window,
        'laws': [dataclasses.asdict(variant) for variant in spec.variants], **quantities,
        **spec.repeats.as_mapping(), 'failure': spec.failure.as_mapping(),
        **({'coarse': spec.coarse} if spec.refined else {})}


def about(runs: Runs) -> dict[str, Any]:
    """Return what a map is of, as `Directory` takes it."""
    versions = {'ctc_chattering': version(), 'python': sys.version.split()[0]}
    for name in _PACKAGES:
        with suppress(importlib.metadata.PackageNotFoundError):
            versions[name] = importlib.metadata.version(name)
    return {'key': map_key(runs), 'spec': finite(contents(runs)),
            'versions': versions}


def map_key(runs: Runs) -> str:
    """Return a word that changes with everything that the results of a map depend on."""
    return _key([contents(runs), version()])


def chunk_key(key: str, chunk: Sequence[int]) -> str:
    """Return the name of a chunk of the map with the given key."""
    return _key([key, chunk.start, chunk.stop] if isinstance(chunk, range) else [key, *chunk])


def _key(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:32]


def chunks(runs: Runs, some: Sequence[int] | None = None) -> list[Sequence[int]]:
    """
    Return all runs of a map, or some, in chunks of so many steps each, fewer of few runs.

    Their size depends on nothing but the spec and the number of runs.
    """
    spec = runs.spec
    numbers: Sequence[int] = range(len(runs)) if some is None else some
    n, plant = len(spec.setup.controller.joint_names), spec.setup.plant
    steps = plant.duration / min(plant.control_period, plant.integration_step)
    size = max(1, min(int(_STEPS / (n ** 2 * steps)), -(-len(numbers) // _FEWEST)))
    return [numbers[k:k + size] for k in range(0, len(numbers), size)]


def compute(runs: Runs, made_by: str, chunk: Sequence[int]) -> pyarrow.Table:
    """
    Return the rows of a chunk; what they need is compiled first, if it is not on this machine.

    Parameters
    ----------
    runs : Runs
        The map.
    made_by : str
        `version` of the process that asks.
    chunk : sequence of int
        Numbers of the runs.

    Raises
    ------
    CtcError
        If this process has another version of the package.

    """
    if made_by != version():
        raise CtcError(f'a worker has version {version()} of ctc_chattering, not {made_by}; '
                       'install the same one everywhere')
    compile_setups(map(runs.example, range(len(runs.spec.variants))), lambda _: None)
    return pyarrow.Table.from_pylist([row(runs, run) for run in chunk], schema(runs.spec))


def row(runs: Runs, run: int) -> dict[str, Any]:
    """Return the row of a run."""
    which = runs.columns(run)
    try:
        setup = runs.setup(run)
    except MachineError:
        raise
    except CtcError as error:
        return {**which, **refused(len(runs.spec.setup.controller.joint_names), error)}
    return {**which, **evaluate(setup, runs.spec.window, runs.spec.failure)}

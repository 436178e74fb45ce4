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
Numbered runs of a table: columns, setups, rows and order.

`ctc compare` lists its runs in a `RunList`. `ctc map` and `tune` number theirs by `MapRuns`: point
of the grid, law and draw. `store` computes rows of either in chunks.

Of a refined grid, every 2ᴸth value of its axes is run first. A cell of points that were run, of
any size, is mixed if some points in it or on its sides fail and others do not. Mixed cells are
halved along all axes until their points are neighbours in the grid. A point on the side that
two cells share counts for both. So a boundary is followed from cell to cell once a point of
the coarse grid is on each side of it. A boundary within a cell, or one that reaches into it
between points that were run, stays unseen if all of these agree.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
import hashlib
from itertools import product
import json
from math import ceil, isfinite, log2
from typing import Any, NamedTuple

from ctc_chattering.analysis.metrics import WINDOW
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.errors import CtcError, MachineError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.runs.recommended import LawSettings, recommended_setup
from ctc_chattering.runs.score import (
    COLUMN_TYPES,
    OVERALL,
    PER_JOINT,
    result_columns,
    Runner,
    Score,
    score,
    simulate_truth,
)
from ctc_chattering.runs.spec import Failure, MapSpec, Quantity, Repeats, set_quantities, Uncertain
import numpy as np
import numpy.typing as npt


def draw_quantities(uncertain: Sequence[Uncertain], repeats: Repeats) -> Array:
    """
    Return the drawn numbers, shape (repeats, m).

    Parameters
    ----------
    uncertain : sequence of Uncertain
        m quantities.
    repeats : Repeats
        Number, method and seed. With `sobol` and `random` a larger number of repeats begins with
        the draws of a smaller one.

    """
    u = draw_unit_cube(repeats.sampling, repeats.repeats, len(uncertain), repeats.seed)
    for column, quantity in zip(u.T, uncertain):
        column[:] = quantile(quantity, column)
    return u


def draw_unit_cube(method: str, n: int, m: int, seed: int) -> Array:
    """Return draws from the unit cube, shape (n, m)."""
    rng = np.random.default_rng(seed)
    if method == 'random' or m == 0:
        return rng.random((n, m))
    if method == 'saltelli':
        # A, B, and A with each column of B in turn, shape ((m + 2) n, m).
        A, B = np.hsplit(draw_unit_cube('sobol', n // (m + 2), 2 * m, seed), 2)
        return np.vstack([A, B, *(np.where(column, B, A) for column in np.eye(m, dtype=bool))])
    # Imported here, since workers need no draws and start twice as fast without.
    from scipy.stats import qmc  # type: ignore[import-untyped]
    if method == 'latin_hypercube':
        return np.asarray(qmc.LatinHypercube(m, rng=rng).random(n))
    # A Sobol sequence has its balance at powers of two.
    return np.asarray(qmc.Sobol(m, rng=rng).random_base2(ceil(log2(n))))[:n]


def quantile(quantity: Uncertain, u: Array) -> Array:
    """Return quantiles at the probabilities `u`, shape (n,)."""
    values = np.array(quantity.numbers)
    if quantity.distribution == 'uniform':
        return np.asarray(values[0] + (values[1] - values[0]) * u)
    if quantity.distribution == 'log_uniform':
        return np.asarray(values[0] * (values[1] / values[0]) ** u)
    if quantity.distribution == 'normal':
        from scipy.stats import norm
        margin = 2.0 ** -53  # At 0 and 1 a normal distribution is infinite.
        return np.asarray(norm.ppf(np.clip(u, margin, 1.0 - margin), *values))
    return np.asarray(values[(u * len(values)).astype(int)])


class ListedRun(NamedTuple):
    """A run with its columns, `held_out` among them."""

    columns: dict[str, Any]
    setup: Setup


class RunList:
    """
    Runs with numbers from 0, each a row of a table.

    Parameters
    ----------
    listed : iterable of ListedRun
        The runs in their order.

    Attributes
    ----------
    command : str
        The subcommand of `ctc` that makes them.
    window : (float, float)
        Evaluated interval [s].
    failure : Failure
        Limits from which a run is a failure.
    units : mapping
        Units of the columns that tell the runs.
    robot : Setup
        A setup with as many joints as the table has columns for.
    contents : mapping
        All inputs of the rows besides the text of the package, as JSON takes it.

    """

    command = 'compare'
    window: tuple[float, float] = WINDOW
    failure = Failure()
    units: Mapping[str, str] = {}

    def __init__(self, listed: Iterable[ListedRun]) -> None:
        self.listed = tuple(listed)
        self.robot = max((run.setup for run in self.listed),
                         key=lambda setup: len(setup.plant.joint_names))
        text = json.dumps([[columns, describe(setup)] for columns, setup in self.listed],
                          sort_keys=True, default=str)
        self.contents: Mapping[str, Any] = {
            'runs': len(self), 'sha256': hashlib.sha256(text.encode()).hexdigest()}

    def __len__(self) -> int:
        """Return the number of runs."""
        return len(self.listed)

    def columns(self, run: int) -> dict[str, Any]:
        """Return the columns that tell a run."""
        return {'run': run, **self.listed[run].columns}

    def setup(self, run: int) -> Setup:
        """
        Return the setup of a run.

        Raise `CtcError` if it is not allowed.
        """
        return self.listed[run].setup

    def examples(self) -> Iterator[Setup]:
        """
        Yield setups that need the code of all runs.

        They are those not held out.
        """
        return (setup for columns, setup in self.listed if not columns['held_out'])

    @property
    def joint_count(self) -> int:
        """Largest number of joints, for which the table has columns."""
        return len(self.robot.controller.joint_names)

    @property
    def types(self) -> dict[str, tuple[str, str]]:
        """Names of the columns with types and units."""
        columns = {name: (COLUMN_TYPES[type(x)], self.units.get(name, ''))
                   for name, x in self.columns(0).items()}
        return columns | result_columns(self.joint_count)

    def next_runs(self, table: Any) -> npt.NDArray[np.int64]:
        """
        Return the next runs, ascending.

        There are none once all that count are there.

        Parameters
        ----------
        table : pyarrow.Table
            The rows of earlier runs, in any order.

        """
        return np.arange(0 if len(table) else len(self))

    def row(self, run: int, runner: Runner = simulate_truth) -> dict[str, Any]:
        """
        Return the row of a run.

        Raise `MachineError` if the machine cannot run it.
        """
        try:
            setup = self.setup(run)
        except MachineError:
            raise
        except CtcError as error:
            result, failure_kind = Score(failure=str(error)), 'refused'
        else:
            result, failure_kind = score(setup, self.window, runner), 'diverged'
        return self.columns(run) | result_row(
            result, self.joint_count, self.failure, failure_kind)


class GridIndex(NamedTuple):
    """Indices of a run: axes, law and draw."""

    axes: tuple[int, ...]
    law: int
    repeat: int


class MapRuns(RunList):
    """
    Runs of a spec: point of the grid, law and draw.

    A parameter is that of the file, then of the law, then of the axes, then of the draw. Gains by
    rule suit the values of those axes that the controller knows.

    Parameters
    ----------
    spec : MapSpec
        The map.

    Attributes
    ----------
    spec : MapSpec
        The same.
    shape : tuple of int
        Number of values of each axis, of laws, and of draws.
    draws : ndarray, shape (repeats, m)
        Number of each uncertain quantity in each repeat.

    """

    command = 'map'

    def __init__(self, spec: MapSpec) -> None:
        self.spec = spec
        self.robot = spec.setup
        self.window = spec.window
        self.failure = spec.failure
        self.shape = (*spec.shape, len(spec.variants), spec.repeats.repeats)
        self.draws = draw_quantities(spec.uncertain, spec.repeats)
        #: Setup of each law at values of the axes that it knows.
        self._law_setups: dict[tuple[int, tuple[float, ...]], Setup] = {}
        quantities = (*spec.axes, *spec.uncertain)
        self.units = {x.name: x.unit for x in quantities}
        self.contents = {
            **spec.tree, **describe(spec.setup), 'window': spec.window,
            'order': [x.name for x in quantities], 'draws': self.draws.tolist()}

    def __len__(self) -> int:
        """Return the number of runs."""
        return self.spec.runs

    def index(self, run: int) -> GridIndex:
        """Return the indices of a run."""
        *axes, law, repeat = map(int, np.unravel_index(run, self.shape))
        return GridIndex(tuple(axes), law, repeat)

    def columns(self, run: int) -> dict[str, Any]:
        """Return the columns that tell a run."""
        index = self.index(run)
        law = self.spec.variants[index.law]
        return {'run': run, 'point': run // (self.shape[-2] * self.shape[-1]),
                'repeat': index.repeat, 'seed': self._seed(index.repeat), 'variant': law.name,
                'law': law.law, 'switching': law.switching,
                **{quantity.name: x for quantity, x in self._numbers(index)}}

    def setup(self, run: int) -> Setup:
        """
        Return the setup of a run.

        Raises
        ------
        CtcError
            If values of axes or draws contradict each other, or a draw is not allowed.

        """
        index = self.index(run)
        numbers = self._numbers(index)
        axes = numbers[:len(index.axes)]
        known_values = tuple(x for quantity, x in axes if quantity.known_to_controller)
        law_setup = self._law_setup(index.law, known_values)
        return set_quantities(law_setup, numbers, self._seed(index.repeat))

    def _seed(self, repeat: int) -> int:
        """
        Return the seed of the noise.

        It is the same for all repeats if their differences count.
        """
        repeats = self.spec.repeats
        return repeats.seed + (0 if repeats.sampling == 'saltelli' else repeat)

    def examples(self) -> Iterator[Setup]:
        """
        Yield a setup of every law.

        It is that of the first run, if that is allowed.
        """
        for k, law in enumerate(self.spec.variants):
            try:
                yield self.setup(k * self.shape[-1])
            except CtcError:
                yield self.spec.setup.changed({'controller': law.parameters})

    def next_runs(self, table: Any) -> npt.NDArray[np.int64]:
        """
        Return the next runs.

        Without a coarse grid they are all runs.
        """
        laws, repeats = self.shape[-2:]
        states = np.full((laws, *self.spec.shape), UNKNOWN, np.int8)
        cells, index = np.unique(np.asarray(table['run']) // repeats, return_inverse=True)
        failures = np.bincount(index, np.asarray(table['failure']) != '')
        point, law = np.divmod(cells, laws)
        states.reshape(laws, -1)[law, point] = np.where(2 * failures >= repeats, FAILS, PASSES)
        next_cells = [np.flatnonzero(next_points(state, self.spec.coarse)) * laws + k
                      for k, state in enumerate(states)]
        first_runs = repeats * np.sort(np.concatenate(next_cells))
        runs: npt.NDArray[np.int64] = (first_runs[:, np.newaxis] + np.arange(repeats)).ravel()
        return runs

    def _numbers(self, index: GridIndex) -> list[tuple[Quantity, float]]:
        """Return the quantities of a run with their numbers."""
        axes = [(axis, axis.values[i]) for axis, i in zip(self.spec.axes, index.axes)]
        return [*axes, *zip(self.spec.uncertain, self.draws[index.repeat].tolist())]

    def _law_setup(self, law_index: int, known_values: tuple[float, ...]) -> Setup:
        """Return a law's setup at the values that it knows."""
        law = self.spec.variants[law_index]
        key = (law_index, known_values if law.is_recommended else ())
        if key not in self._law_setups:
            setup = self.spec.setup
            if law.is_recommended:
                setup = setup.changed(self._values_by_rule(law, known_values))
            self._law_setups[key] = setup.changed({'controller': law.parameters})
        return self._law_setups[key]

    def _values_by_rule(self, law: LawSettings, known_values: tuple[float, ...]
                        ) -> dict[str, dict[str, Any]]:
        """Return a rule's values that no known axis sets."""
        axes = [axis for axis in self.spec.axes if axis.known_to_controller]
        set_by_axes = {(node, spec.name) for axis in axes for node, spec in axis.targets}
        by_rule = recommended_setup(
            set_quantities(self.spec.setup, zip(axes, known_values)), law.law)
        return {node: {name: x for name, x in getattr(by_rule, node).as_mapping().items()
                       if (node, name) not in set_by_axes and name != 'joint_names'}
                for node in ('controller', 'reference')}


def describe(setup: Setup) -> dict[str, Any]:
    """Return the contents of a setup as JSON takes them."""
    return {'parameters': dict(setup.values), 'route': setup.route, 'descriptions': {
        node: hashlib.sha256(text.encode()).hexdigest()
        for node, text in setup.descriptions.items()}}


def result_row(result: Score, n: int, failure: Failure, failure_kind: str = 'diverged'
               ) -> dict[str, Any]:
    """
    Return the results of a run as columns.

    They are those of `result_columns`, with None where there is no number.

    Parameters
    ----------
    result : Score
        Numbers of the run.
    n : int
        Number of joints that the table has columns for.
    failure : Failure
        Limits from which a run is a failure.
    failure_kind : str
        Kind of a failure without numbers.

    """
    row = {**dict.fromkeys(result_columns(n)), 'engine': result.engine, 'failure': failure_kind,
           'reason': result.failure}
    if result.failure:
        return row
    for name, (column, _) in PER_JOINT.items():
        for i, x in enumerate(getattr(result, name), 1):
            row[f'{column}_{i}'] = x
    for name, (column, _) in OVERALL.items():
        row[column] = getattr(result, name)
    row['error'] = result.error
    row['error_share'] = result.error_share
    row['variation'] = max(result.variation)
    row['saturated'] = result.saturated
    row['slips'] = max(result.slips)
    row['failure'], row['reason'] = _judge(row, failure)
    return {name: x if isinstance(x, str) or (x is not None and isfinite(x)) else None
            for name, x in row.items()}


def _judge(row: Mapping[str, Any], failure: Failure) -> tuple[str, str]:
    """Return kind and reason of a failure, or empty texts."""
    if row['error_share'] > failure.error_share_above:
        return 'error', (f'{100.0 * row["error_share"]:.3g} % of the amplitude of the motion > '
                         f'{100.0 * failure.error_share_above:g} %')
    for column, limit in (('error', failure.error_above), ('saturated', failure.saturated_above),
                          ('slips', failure.slips_above)):
        if row[column] > limit:
            return column, f'{row[column]:.3g} > {limit:g}'
    if failure.not_reached and row['reaching_time_s'] is None:
        return 'not reached', 'v never stays within its band'
    return '', ''


Mask = npt.NDArray[np.bool_]
#: State of a point that has not been run.
UNKNOWN = -1
#: State of a point of which less than half of the runs fail.
PASSES = 0
#: State of a point of which half of the runs or more fail.
FAILS = 1


def next_points(state: npt.NDArray[np.int8], coarse: tuple[int, ...]) -> Mask:
    """
    Return the next points of a grid.

    There are none once the boundary is known.

    Parameters
    ----------
    state : array
        `UNKNOWN`, `PASSES` or `FAILS` of each point.
    coarse : tuple of int
        Of each axis, the step of the coarse grid, 1 or the same power of two.

    """
    wanted: Mask = np.zeros(state.shape, bool)
    unknown: Mask = state == UNKNOWN
    wanted[tuple(slice(None, None, step) for step in coarse)] = True
    while max(coarse, default=1) > 1 and not (wanted & unknown).any():
        finer = tuple(max(step // 2, 1) for step in coarse)
        corners = tuple(slice(None, None, step) for step in coarse)
        halves = tuple(slice(None, None, step) for step in finer)
        widths = [step + (step > 1) for step in coarse]  # Both sides belong to a cell.
        firsts = [range(0, n - (step > 1), step) for n, step in zip(state.shape, coarse)]
        for first in product(*firsts):
            cell = tuple(slice(a, a + width) for a, width in zip(first, widths))
            states = state[cell]
            is_mixed = (states == PASSES).any() and (states == FAILS).any()
            if is_mixed and (states[corners] != UNKNOWN).all():
                wanted[cell][halves] = True
        coarse = finer
    return wanted & unknown

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
What a table has a row of: runs of any kind, those of a map, their setups, and which come next.

A run of a map is a point of the grid, a law and a draw.

Of a refined grid, every 2ᴸth value of its axes is run first. A cell of points that were run, of
any size, is mixed if some of the points in it or on its sides fail and others do not; mixed cells
are halved along all axes until their points are neighbours in the grid. A point on the side that
two cells share counts for both, so that a boundary is followed from cell to cell once a point of
the coarse grid is on each side of it. What lies within a cell, or reaches into it between points
that were run, is not found if all of these agree.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
import hashlib
from itertools import product
import json
from math import ceil, isfinite, log2
from typing import Any

from ctc_chattering.analysis.metrics import WINDOW
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.errors import CtcError, MachineError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.runs.recommended import recommended_setup
from ctc_chattering.runs.score import (
    of_results,
    over_simulation,
    OVERALL,
    PER_JOINT,
    Runner,
    Score,
    score,
    TYPES,
)
from ctc_chattering.runs.spec import applied, Failure, MapSpec, Quantity, Repeats, Uncertain
import numpy as np
import numpy.typing as npt

#: Distance from 0 and 1 that a draw keeps: there a normal distribution is infinite.
_OPEN = 2.0 ** -53


def draws(uncertain: Sequence[Uncertain], repeats: Repeats) -> Array:
    """
    Return the drawn numbers, shape (repeats, m).

    Parameters
    ----------
    uncertain : sequence of Uncertain
        m quantities.
    repeats : Repeats
        How many, how, and the seed. With `sobol` and `random` a larger number of repeats begins
        with the draws of a smaller one.

    """
    u = unit_draws(repeats.sampling, repeats.repeats, len(uncertain), repeats.seed)
    for column, x in zip(u.T, uncertain):
        column[:] = quantile(x, column)
    return u


def unit_draws(method: str, n: int, m: int, seed: int) -> Array:
    """Return draws from the unit cube of m dimensions, shape (n, m)."""
    rng = np.random.default_rng(seed)
    if method == 'random' or m == 0:
        return rng.random((n, m))
    if method == 'saltelli':
        # A, B, and A with each column of B in turn, shape ((m + 2) n, m).
        A, B = np.hsplit(unit_draws('sobol', n // (m + 2), 2 * m, seed), 2)
        return np.vstack([A, B, *(np.where(mine, B, A) for mine in np.eye(m, dtype=bool))])
    # Here, for the workers, which need no draws, to start twice as fast.
    from scipy.stats import qmc  # type: ignore[import-untyped]
    if method == 'latin_hypercube':
        return np.asarray(qmc.LatinHypercube(m, rng=rng).random(n))
    # A Sobol sequence has its balance at powers of two.
    return np.asarray(qmc.Sobol(m, rng=rng).random_base2(ceil(log2(n))))[:n]


def quantile(x: Uncertain, u: Array) -> Array:
    """Return the quantiles of `x` at probabilities `u`, shape (n,)."""
    values = np.array(x.numbers)
    if x.distribution == 'uniform':
        return np.asarray(values[0] + (values[1] - values[0]) * u)
    if x.distribution == 'log_uniform':
        return np.asarray(values[0] * (values[1] / values[0]) ** u)
    if x.distribution == 'normal':
        from scipy.stats import norm
        return np.asarray(norm.ppf(np.clip(u, _OPEN, 1.0 - _OPEN), *values))
    return np.asarray(values[(u * len(values)).astype(int)])


class Points:
    """
    Runs with numbers from 0, of each of which a table has a row; here they are listed.

    Parameters
    ----------
    listed : iterable of (mapping, Setup)
        Of each run, which it is, as its row says, whether it is `held_out` among it; what is run.

    Attributes
    ----------
    kind : str
        The subcommand of `ctc` that makes them.
    window : (float, float)
        Evaluated interval [s].
    failure : Failure
        What counts as one.
    units : mapping
        Units of columns that say which run it is.
    robot : Setup
        One with as many joints as the table has columns for.
    contents : mapping
        All that the rows depend on besides the text of the package, as JSON takes it.

    """

    kind = 'compare'
    window: tuple[float, float] = WINDOW
    failure = Failure()
    units: Mapping[str, str] = {}

    def __init__(self, listed: Iterable[tuple[dict[str, Any], Setup]]) -> None:
        self.listed = tuple(listed)
        self.robot = max((x for _, x in self.listed), key=lambda x: len(x.plant.joint_names))
        text = json.dumps([[which, described(x)] for which, x in self.listed],
                          sort_keys=True, default=str)
        self.contents: Mapping[str, Any] = {
            'runs': len(self), 'sha256': hashlib.sha256(text.encode()).hexdigest()}

    def __len__(self) -> int:
        """Return the number of runs."""
        return len(self.listed)

    def columns(self, run: int) -> dict[str, Any]:
        """Return which run it is, as its row of the results says."""
        return {'run': run, **self.listed[run][0]}

    def setup(self, run: int) -> Setup:
        """Return what is run; raise `CtcError` if that is not allowed."""
        return self.listed[run][1]

    def examples(self) -> Iterator[Setup]:
        """Yield setups that need as machine code what all runs need: those not held out."""
        return (setup for which, setup in self.listed if not which['held_out'])

    @property
    def types(self) -> dict[str, tuple[str, str]]:
        """Return name, type and unit of the columns of the table, in order."""
        which = {name: (TYPES[type(x)], self.units.get(name, ''))
                 for name, x in self.columns(0).items()}
        return {**which, **of_results(len(self.robot.controller.joint_names))}

    def next_runs(self, table: Any) -> npt.NDArray[np.int64]:
        """
        Return the next runs, ascending; none if all that count are there.

        Parameters
        ----------
        table : pyarrow.Table
            The rows of those before, in any order.

        """
        return np.arange(0 if len(table) else len(self))

    def row(self, run: int, runner: Runner = over_simulation) -> dict[str, Any]:
        """Return the row of a run; raise `MachineError` if the machine cannot run it."""
        which, n = self.columns(run), len(self.robot.controller.joint_names)
        try:
            setup = self.setup(run)
        except MachineError:
            raise
        except CtcError as error:
            return {**which, **row_of(Score(failure=str(error)), n, self.failure, 'refused')}
        return {**which, **row_of(score(setup, self.window, runner), n, self.failure)}


class Runs(Points):
    """
    Numbers, columns and setups of the runs of a spec: point of the grid, law and draw.

    A parameter is that of the file, then of the law, then of the axes, then of the draw. What is
    recommended for a law is so for the values of the axes that the controller knows.

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

    kind = 'map'

    def __init__(self, spec: MapSpec) -> None:
        self.spec, self.robot, self.window, self.failure = (
            spec, spec.setup, spec.window, spec.failure)
        self.shape = (*spec.shape, len(spec.variants), spec.repeats.repeats)
        self.draws = draws(spec.uncertain, spec.repeats)
        #: Setup of each law at values of the axes that it knows.
        self._of_laws: dict[tuple[int, tuple[float, ...]], Setup] = {}
        quantities = (*spec.axes, *spec.uncertain)
        self.units = {x.name: x.unit for x in quantities}
        self.contents = {
            **spec.tree, **described(spec.setup), 'window': spec.window,
            'order': [x.name for x in quantities], 'draws': self.draws.tolist()}

    def __len__(self) -> int:
        """Return the number of runs."""
        return self.spec.runs

    def place(self, run: int) -> tuple[tuple[int, ...], int, int]:
        """Return where a run is: indices of the axes, of the law, and of the draw."""
        *indices, variant, repeat = map(int, np.unravel_index(run, self.shape))
        return tuple(indices), variant, repeat

    def columns(self, run: int) -> dict[str, Any]:
        """Return which run it is, as its row of the results says."""
        indices, k, repeat = self.place(run)
        variant = self.spec.variants[k]
        return {'run': run, 'point': run // (self.shape[-2] * self.shape[-1]), 'repeat': repeat,
                'seed': self._seed(repeat), 'variant': variant.name,
                'law': variant.law, 'switching': variant.switching,
                **{quantity.name: x for quantity, x in self._settings(indices, repeat)}}

    def setup(self, run: int) -> Setup:
        """
        Return what is run.

        Raises
        ------
        CtcError
            If values of axes or draws contradict each other, or a draw is not allowed.

        """
        indices, variant, repeat = self.place(run)
        settings = self._settings(indices, repeat)
        known = tuple(x for quantity, x in settings[:len(indices)] if quantity.known)
        return applied(self._of_law(variant, known), settings, self._seed(repeat))

    def _seed(self, repeat: int) -> int:
        """Return the seed of the noise; the same for all repeats if differences count."""
        repeats = self.spec.repeats
        return repeats.seed + (0 if repeats.sampling == 'saltelli' else repeat)

    def examples(self) -> Iterator[Setup]:
        """Yield a setup of every law: that of its first run, if it is allowed."""
        for k, variant in enumerate(self.spec.variants):
            try:
                yield self.setup(k * self.shape[-1])
            except CtcError:
                yield self.spec.setup.changed({'controller': variant.values})

    def next_runs(self, table: Any) -> npt.NDArray[np.int64]:
        """Return the next runs; without a coarse grid all at once."""
        laws, repeats = self.shape[-2:]
        state = np.full((laws, *self.spec.shape), UNKNOWN, np.int8)
        place, index = np.unique(np.asarray(table['run']) // repeats, return_inverse=True)
        failed = np.bincount(index, np.asarray(table['failure']) != '')
        point, variant = np.divmod(place, laws)
        state.reshape(laws, -1)[variant, point] = np.where(2 * failed >= repeats, FAILS, PASSES)
        firsts = np.sort(np.concatenate([
            (np.flatnonzero(wanted(each, self.spec.coarse)) * laws + v) * repeats
            for v, each in enumerate(state)]))
        found: npt.NDArray[np.int64] = (firsts[:, np.newaxis] + np.arange(repeats)).ravel()
        return found

    def _settings(self, indices: tuple[int, ...], repeat: int) -> list[tuple[Quantity, float]]:
        """Return the numbers of all quantities at a place, in the order in which they are set."""
        axes = [(axis, axis.values[i]) for axis, i in zip(self.spec.axes, indices)]
        return [*axes, *zip(self.spec.uncertain, self.draws[repeat].tolist())]

    def _of_law(self, index: int, known: tuple[float, ...]) -> Setup:
        """
        Return the setup of a law at the values of the axes that the controller knows.

        What is recommended for it does not win over what such an axis sets.
        """
        variant, setup = self.spec.variants[index], self.spec.setup
        key = (index, known if variant.recommended else ())
        if key not in self._of_laws:
            if variant.recommended:
                axes = [axis for axis in self.spec.axes if axis.known]
                by_axes = {(node, spec.name) for axis in axes for node, spec in axis.targets}
                made = recommended_setup(applied(setup, zip(axes, known)), variant.law)
                setup = setup.changed({
                    node: {name: x for name, x in getattr(made, node).as_mapping().items()
                           if (node, name) not in by_axes and name != 'joint_names'}
                    for node in ('controller', 'reference')})
            self._of_laws[key] = setup.changed({'controller': variant.values})
        return self._of_laws[key]


def described(setup: Setup) -> dict[str, Any]:
    """Return all that a setup has from files, as JSON takes it."""
    return {'parameters': dict(setup.values), 'route': setup.route, 'descriptions': {
        node: hashlib.sha256(text.encode()).hexdigest()
        for node, text in setup.descriptions.items()}}


def row_of(found: Score, n: int, failure: Failure, without: str = 'diverged') -> dict[str, Any]:
    """
    Return the columns of a run's results, `of_results`; None where there is no number.

    Parameters
    ----------
    found : Score
        Of the run.
    n : int
        Number of joints that the table has columns for.
    failure : Failure
        What counts as one.
    without : str
        Kind of a failure without numbers.

    """
    row = {**dict.fromkeys(of_results(n)), 'engine': found.engine, 'failure': without,
           'reason': found.failure}
    if found.failure:
        return row
    row.update({f'{key}_{i}': x for name, (key, _) in PER_JOINT.items()
                for i, x in enumerate(getattr(found, name), 1)})
    row.update({key: getattr(found, name) for name, (key, _) in OVERALL.items()})
    row.update(error=found.error, error_share=found.error_share, variation=max(found.variation),
               saturated=found.saturated, slips=max(found.slips))
    row['failure'], row['reason'] = _judged(row, failure)
    return {name: x if isinstance(x, str) or (x is not None and isfinite(x)) else None
            for name, x in row.items()}


def _judged(row: Mapping[str, Any], failure: Failure) -> tuple[str, str]:
    """Return kind and reason of a failure; empty for none."""
    if row['error_share'] > failure.error_share_above:
        return 'error', (f'{100.0 * row["error_share"]:.3g} % of the amplitude of the motion > '
                         f'{100.0 * failure.error_share_above:g} %')
    for kind, most in (('error', failure.error_above), ('saturated', failure.saturated_above),
                       ('slips', failure.slips_above)):
        if row[kind] > most:
            return kind, f'{row[kind]:.3g} > {most:g}'
    if failure.not_reached and row['reaching_time_s'] is None:
        return 'not reached', 'v never stays within its band'
    return '', ''


Mask = npt.NDArray[np.bool_]
#: Of a point: not run yet, less than half of its runs fail, half or more.
UNKNOWN, PASSES, FAILS = -1, 0, 1


def wanted(state: npt.NDArray[np.int8], coarse: tuple[int, ...]) -> Mask:
    """
    Return which points of a grid to run next; none when the boundary is found.

    Parameters
    ----------
    state : array
        `UNKNOWN`, `PASSES` or `FAILS` of each point.
    coarse : tuple of int
        Of each axis, the step of the coarse grid, 1 or the same power of two.

    """
    found: Mask = np.zeros(state.shape, bool)
    unknown: Mask = state == UNKNOWN
    found[tuple(slice(None, None, step) for step in coarse)] = True
    while max(coarse, default=1) > 1 and not (found & unknown).any():
        corners, halves = (tuple(slice(None, None, max(step // k, 1)) for step in coarse)
                           for k in (1, 2))
        for first in product(*(range(0, n - (step > 1), step)
                               for n, step in zip(state.shape, coarse))):
            cell = tuple(slice(a, a + step + (step > 1)) for a, step in zip(first, coarse))
            known = state[cell]
            if (known[corners] != UNKNOWN).all() and (known == PASSES).any() and (
                    known == FAILS).any():
                found[cell][halves] = True
        coarse = tuple(max(step // 2, 1) for step in coarse)
    return np.logical_and(found, unknown)

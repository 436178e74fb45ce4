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
The runs of a map: point of the grid, law and draw; their setups and rows, and which come next.

Of a refined grid, every 2ᴸth value of its axes is run first. A cell of points that were run, of
any size, is mixed if some of the points in it or on its sides fail and others do not; mixed cells
are halved along all axes until their points are neighbours in the grid. A point on the side that
two cells share counts for both, so that a boundary is followed from cell to cell once a point of
the coarse grid is on each side of it. What lies within a cell, or reaches into it between points
that were run, is not found if all of these agree.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import ceil, isfinite, log2, nan
from typing import Any, NamedTuple

from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.errors import CtcError, near, ParameterError, UsageError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.runs.recommended import recommended_setup
from ctc_chattering.runs.score import of_results, OVERALL, PER_JOINT, Score, score
from ctc_chattering.runs.spec import (
    applied,
    Axis,
    Failure,
    LawSettings,
    MapSpec,
    Quantity,
    Repeats,
    Uncertain,
)
from ctc_chattering.simulation.plant import make_plant
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
        return _saltelli(unit_draws('sobol', n // (m + 2), 2 * m, seed))
    # Here, for the workers, which need no draws, to start twice as fast.
    from scipy.stats import qmc  # type: ignore[import-untyped]
    if method == 'latin_hypercube':
        return np.asarray(qmc.LatinHypercube(m, rng=rng).random(n))
    # A Sobol sequence has its balance at powers of two.
    return np.asarray(qmc.Sobol(m, rng=rng).random_base2(ceil(log2(n))))[:n]


def _saltelli(pairs: Array) -> Array:
    """Return draws A, B, and A with each column of B in turn, shape ((m + 2) n, m)."""
    A, B = np.hsplit(pairs, 2)
    one = np.eye(len(A.T), dtype=bool)
    return np.vstack([A, B, *(np.where(mine, B, A) for mine in one)])


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


class RunPlace(NamedTuple):
    """
    Where a run is in its map.

    Attributes
    ----------
    point : int
        Index in the grid, the last axis fastest.
    indices : tuple of int
        Index in the values of each axis.
    variant, repeat : int
        Indices of the law and of the draw.

    """

    point: int
    indices: tuple[int, ...]
    variant: int
    repeat: int


class Runs:
    """
    Numbers, columns and setups of the runs of a map.

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
    draws : ndarray, shape (repeats, m)
        Number of each uncertain quantity in each repeat.

    """

    def __init__(self, spec: MapSpec) -> None:
        self.spec = spec
        self.draws = draws(spec.uncertain, spec.repeats)
        #: Setup of each law at the values of the known axes for which it was needed last.
        self._of_laws: dict[int, tuple[tuple[float, ...], Setup]] = {}

    def __len__(self) -> int:
        """Return the number of runs."""
        return self.spec.runs

    def place(self, run: int) -> RunPlace:
        """Return where a run is."""
        rest, repeat = divmod(run, self.spec.repeats.repeats)
        point, variant = divmod(rest, len(self.spec.variants))
        indices = np.unravel_index(point, self.spec.shape) if self.spec.axes else ()
        return RunPlace(point, tuple(map(int, indices)), variant, repeat)

    def number(self, indices: tuple[int, ...], variant: int, repeat: int) -> int:
        """Return the number of the run at a place."""
        point = int(np.ravel_multi_index(indices, self.spec.shape)) if indices else 0
        return (point * len(self.spec.variants) + variant) * self.spec.repeats.repeats + repeat

    def columns(self, run: int) -> dict[str, Any]:
        """Return which run it is, as its row of the results says."""
        place, spec = self.place(run), self.spec
        variant = spec.variants[place.variant]
        return {'run': run, 'point': place.point, 'repeat': place.repeat,
                'seed': self._seed(place.repeat), 'variant': variant.name,
                'law': variant.law, 'switching': variant.switching,
                **{quantity.name: x for quantity, x in self._settings(place)}}

    def setup(self, run: int) -> Setup:
        """
        Return what is run.

        Raises
        ------
        CtcError
            If values of axes or draws contradict each other, or a draw is not allowed.

        """
        place = self.place(run)
        settings = self._settings(place)
        known = tuple(x for quantity, x in settings[:len(self.spec.axes)] if quantity.known)
        return applied(self._of_law(place.variant, known), settings, self._seed(place.repeat))

    def _seed(self, repeat: int) -> int:
        """Return the seed of the noise; the same for all repeats if differences count."""
        repeats = self.spec.repeats
        return repeats.seed + (0 if repeats.sampling == 'saltelli' else repeat)

    def example(self, variant: int) -> Setup:
        """Return a setup of a law: that of the first point without a draw, if it is allowed."""
        axes = [(axis, axis.values[0]) for axis in self.spec.axes]
        setup = self._of_law(variant, tuple(x for axis, x in axes if axis.known))
        try:
            return applied(setup, axes)
        except CtcError:
            return setup

    def _settings(self, place: RunPlace) -> list[tuple[Quantity, float]]:
        """Return the numbers of all quantities at a place, in the order in which they are set."""
        axes = [(axis, axis.values[i]) for axis, i in zip(self.spec.axes, place.indices)]
        return [*axes, *zip(self.spec.uncertain, self.draws[place.repeat].tolist())]

    def _of_law(self, index: int, known: tuple[float, ...]) -> Setup:
        """Return the setup of a law at the values of the axes that the controller knows."""
        variant = self.spec.variants[index]
        last, setup = self._of_laws.get(index, (None, self.spec.setup))
        if last is None or (variant.recommended and last != known):
            recommended = self._recommended(variant.law, known) if variant.recommended else {}
            setup = self.spec.setup.changed(recommended).changed({'controller': variant.values})
            self._of_laws[index] = known, setup
        return setup

    def _recommended(self, law: str, known: tuple[float, ...]) -> dict[str, dict[str, Any]]:
        """Return what is recommended for a law, by node, but for what a known axis sets."""
        file, axes = self.spec.setup, [axis for axis in self.spec.axes if axis.known]
        made = recommended_setup(applied(file, zip(axes, known)), law)
        by_axes = {(node, spec.name) for axis in axes for node, spec in axis.targets}
        values: dict[str, dict[str, Any]] = {}
        for node, new, old in (('controller', made.controller, file.controller),
                               ('reference', made.reference, file.reference)):
            before = old.as_mapping()
            values[node] = {name: x for name, x in new.as_mapping().items()
                            if x != before[name] and (node, name) not in by_axes}
        return values


def evaluate(setup: Setup, window: tuple[float, float], failure: Failure) -> dict[str, Any]:
    """
    Return the columns of a run's results, `of_results`; None where there is no number.

    Parameters
    ----------
    setup : Setup
        What to run.
    window : (float, float)
        Evaluated interval [s].
    failure : Failure
        What counts as one.

    Raises
    ------
    MachineError
        If the machine cannot run it: that is no property of the run.

    """
    row = {**dict.fromkeys(of_results(len(setup.controller.joint_names))), 'engine': ''}
    if (count := steps(setup)) > failure.steps_above:
        return {**row, 'failure': 'too long', 'reason': (
            f'{count:.3g} steps of the integrator > {failure.steps_above}')}
    found = score(setup, window)
    if found.failure:
        return {**row, 'failure': 'diverged', 'reason': found.failure}
    row.update({f'{key}_{i}': _finite(x) for name, key in PER_JOINT.items()
                for i, x in enumerate(getattr(found, name), 1)})
    row.update({key: _finite(getattr(found, name)) for name, key in OVERALL.items()})
    row.update(engine=found.engine, error=found.error, variation=_finite(found.most_variation),
               saturated=found.saturated, slips=found.most_slips)
    row['failure'], row['reason'] = _judged(found, setup, failure)
    return row


def steps(setup: Setup) -> float:
    """Return how many steps of the integrator a run has; stiff elastic joints have many."""
    plant = setup.plant
    if plant.elastic:
        return make_plant(plant, setup.descriptions.get('plant', '')).steps
    return plant.duration / min(plant.control_period, plant.integration_step)


def refused(n: int, error: CtcError) -> dict[str, Any]:
    """Return the columns of a run of `n` joints whose parameters are not allowed."""
    return {**dict.fromkeys(of_results(n)), 'engine': '', 'failure': 'refused',
            'reason': str(error)}


def _finite(x: float | None) -> float | None:
    return x if x is not None and np.isfinite(x) else None


def _judged(found: Score, setup: Setup, failure: Failure) -> tuple[str, str]:
    """Return kind and reason of a failure; empty for none."""
    if found.error > failure.error_above:
        joint = setup.controller.joint_names[found.rms.index(found.error)]
        return 'error', f'{joint}: {found.error:.3g} > {failure.error_above:g} rad'
    if (found.saturated or 0.0) > failure.saturated_above:
        return 'saturated', (f'a torque at its limit in {found.saturated:.3g} > '
                             f'{failure.saturated_above:g} of the samples')
    if found.most_slips > failure.slips_above:
        return 'slips', f'{found.most_slips:.3g} > {failure.slips_above:g} stick-slips a second'
    if failure.not_reached and found.reaching_time is None:
        return 'not reached', 'v never stays within its band'
    return '', ''


_LAW, _REPEAT = 'law', 'repeat'


def find_run(runs: Runs, text: str) -> int:
    """
    Return the number of the run that a text names.

    Parameters
    ----------
    runs : Runs
        Of the map.
    text : str
        A number, or ``name=value,...`` of the axes, law and repeat; the value of an axis that is
        nearest is taken. What has one value only may be left out.

    Raises
    ------
    UsageError
        If it names no run, or more than one.

    """
    try:
        if text.strip().isdecimal():
            return _among('run', int(text), len(runs))
        return runs.number(*_place(runs.spec, dict(_pair(word) for word in text.split(','))))
    except ParameterError as error:
        raise UsageError(f'--explain {text}: {error}') from None


def _place(spec: MapSpec, given: Mapping[str, str]) -> tuple[tuple[int, ...], int, int]:
    """Return the indices of the axes, of the law, and of the repeat."""
    choices: dict[str, Sequence[Any]] = {
        **{axis.name: axis.values for axis in spec.axes},
        _LAW: [x.name for x in spec.variants], _REPEAT: range(spec.repeats.repeats)}
    for name in given:
        if name not in choices:
            raise ParameterError(name, given[name], 'a run number, or '
                                 f'{", ".join(choices)}{near(name, choices)}')
    for name, values in choices.items():
        if len(values) > 1 and name not in given:
            shown = values if len(values) < 20 else [values[0], '...', values[-1]]
            words = ', '.join(x if isinstance(x, str) else f'{x:g}' for x in shown)
            raise ParameterError(name, '', f'one of {words}: there is more than one')
    repeat = _number(_REPEAT, given.get(_REPEAT, '0'))
    return (tuple(_nearest(axis, given[axis.name]) if axis.name in given else 0
                  for axis in spec.axes), _law(spec.variants, given[_LAW]) if _LAW in given else 0,
            _among(_REPEAT, repeat, spec.repeats.repeats))


def _pair(word: str) -> tuple[str, str]:
    name, equals, value = (x.strip() for x in word.partition('='))
    if not (name and equals and value):
        raise ParameterError('POINT', word, 'a run number, or name=value,...')
    return name, value


def _number(name: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = nan
    if not isfinite(number):
        raise ParameterError(name, text, 'a number')
    return number


def _among(name: str, number: float, count: int) -> int:
    """Return `number` as an index below `count`."""
    if number != number // 1 or not 0 <= number < count:
        raise ParameterError(name, number, f'0 to {count - 1}')
    return int(number)


def _nearest(axis: Axis, text: str) -> int:
    """Return the index of the value of an axis that is nearest to a number."""
    x = _number(axis.name, text)
    first, *others = sorted(range(len(axis.values)), key=lambda k: abs(axis.values[k] - x))
    if others and abs(axis.values[others[0]] - x) == abs(axis.values[first] - x):
        raise ParameterError(axis.name, text, 'a number nearest to one of '
                             + ', '.join(f'{axis.values[k]:g}' for k in (first, others[0])))
    return first


def _law(variants: Sequence[LawSettings], text: str) -> int:
    """Return the index of the variant with this name, or of the only one under this law."""
    found = [i for i, x in enumerate(variants) if x.name == text] or [
        i for i, x in enumerate(variants) if x.law == text]
    if len(found) != 1:
        names = [x.name for x in variants]
        raise ParameterError(_LAW, text, ' | '.join(names) + near(text, names))
    return found[0]


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
    if unknown[found].any():
        return np.logical_and(found, unknown)
    steps = np.array(coarse)
    while (steps > 1).any():
        for cell in np.argwhere(_mixed(state, steps)):
            first = cell * steps
            found[tuple(slice(a, a + step + (step > 1), max(step // 2, 1))
                        for a, step in zip(first.tolist(), steps.tolist()))] = True
        steps = np.maximum(steps // 2, 1)
    return np.logical_and(found, unknown)


def _mixed(state: npt.NDArray[np.int8], steps: npt.NDArray[np.int_]) -> Mask:
    """Return which cells of a size were run at their corners, and fail in part."""
    sizes = np.where(steps > 1, steps + 1, 1)
    cells: Any = np.lib.stride_tricks.sliding_window_view(state, tuple(sizes.tolist()))
    cells = cells[tuple(slice(None, None, step) for step in steps.tolist())]
    within = tuple(range(state.ndim, 2 * state.ndim))
    at_corners: Any = (Ellipsis, *(slice(None, None, step) for step in steps.tolist()))
    corners = cells[at_corners]
    mixed: Mask = ((cells == PASSES).any(axis=within) & (cells == FAILS).any(axis=within)
                   & (corners != UNKNOWN).all(axis=within))
    return mixed


class Refinement:
    """
    Which runs of a map come next, by what came of those before; all at once if it is not refined.

    Parameters
    ----------
    runs : Runs
        Of the map.

    """

    def __init__(self, runs: Runs) -> None:
        self._runs, self._taken = runs, False
        self._state: npt.NDArray[np.int8] | None = None
        if runs.spec.refined:
            self._state = np.full((len(runs.spec.variants), *runs.spec.shape), UNKNOWN, np.int8)

    def numbers(self) -> Sequence[int]:
        """Return the next runs, ascending; none when the boundary of every law is found."""
        if self._state is None:
            return range(0 if self._taken else len(self._runs))
        laws, repeats = len(self._state), self._runs.spec.repeats.repeats
        firsts = np.concatenate([
            (np.flatnonzero(wanted(state, self._runs.spec.coarse)) * laws + v) * repeats
            for v, state in enumerate(self._state)])
        found: list[int] = (np.sort(firsts)[:, np.newaxis] + np.arange(repeats)).ravel().tolist()
        return found

    def take(self, rows: Callable[[], Any]) -> None:
        """Take the rows of what `numbers` returned, a pyarrow table, if they are needed."""
        self._taken = True
        if self._state is None:
            return
        table, repeats = rows(), self._runs.spec.repeats.repeats
        place, index = np.unique(np.asarray(table['run']) // repeats, return_inverse=True)
        failed = np.bincount(index, np.asarray(table['failure'].to_pylist()) != '')
        point, variant = np.divmod(place, len(self._state))
        self._state.reshape(len(self._state), -1)[variant, point] = np.where(
            2 * failed >= repeats, FAILS, PASSES)

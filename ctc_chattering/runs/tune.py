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

"""Gains for a robot that is known in part: what is tuned and drawn, the search, its result."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
import dataclasses
from functools import partial
from itertools import count
import json
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

from ctc_chattering.analysis.compilation import compile_setups
from ctc_chattering.analysis.tables import rounded
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup, Values
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.configuration.yaml_file import mapping, read_yaml
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError, ParameterError, prefixed
from ctc_chattering.parameters import LEAST, Parameter, whole
from ctc_chattering.runs.points import Runs
from ctc_chattering.runs.pool import processes
from ctc_chattering.runs.recommended import recommended, recommended_setup
from ctc_chattering.runs.score import Score, score
from ctc_chattering.runs.search import (
    front,
    gains,
    knee,
    Limits,
    Numbers,
    over_draws,
    OverDraws,
    Range,
    require_optuna,
    search,
    space,
    starts,
    Trial,
)
from ctc_chattering.runs.spec import (
    errors_of,
    MapSpec,
    parse,
    read_law,
    read_uncertain,
    read_value,
    Uncertain,
)
from ctc_chattering.simulation.plant_config import PlantConfig

#: What is uncertain where nothing says so: a factor of what the file has, and what it has none of.
_FACTOR: dict[str, Any] = {'uniform': [0.8, 1.2], 'factor': True}
_UNKNOWN: dict[str, dict[str, Any]] = {
    'friction': {'parameter': 'plant.coulomb_friction'},
    'lag': {'parameter': 'plant.actuator_lag', 'uniform': [0.0, 2e-3]},
    'noise': {'parameter': 'plant.velocity_noise', 'log_uniform': [1e-4, 2e-3]}}
_MODEL: dict[str, Any] = {'parameters': ['controller.inertia_scale', 'controller.gravity_scale'],
                          'uniform': [0.9, 1.1]}
#: Draws, where the spec does not say how many.
DRAWS = 32
#: Draws for the validation, for each one of the search.
_FRESH = 4
#: Shortest smooth start [s]: a start with a large error is no measure of gains.
_START = 2.0
#: Numbers that are searched only where the spec asks for it. `b` scales v; the paper has 1.
_ASKED = ('b',)
#: Law that docs/laws.md recommends for real arms, and that is tuned where nothing says which.
_BEST = 'observer_feedback'
#: Keys of the section `tune`, and of a spec of `ctc map` that have no meaning here.
_KEYS = ('law', 'switching', 'torque_limit', 'torque_rate_limit', 'search')
_OF_MAP = ('axes', 'laws', 'failure', 'refine')


@dataclasses.dataclass(frozen=True)
class TuneSpec(MapSpec):
    """
    A checked spec: that of a map of draws, under the law that is tuned, and how to tune it.

    Attributes
    ----------
    file : Setup
        The robot with the law and gains of its file, a smooth start, and no events.
    values : mapping
        Parameters of the file for `parameter_file.dump`, by node; with its own duration.
    limits : Limits
        Of the torque.
    ranges : mapping of str to Range
        Where each number is searched.

    """

    file: Setup
    values: Mapping[str, Values]
    limits: Limits
    ranges: Mapping[str, Range]

    def gains(self, numbers: Mapping[str, float]) -> dict[str, Any]:
        """Return the parameters of the controller that numbers mean, to four digits."""
        config = self.setup.controller
        missing = {name: getattr(config, name) for name in _ASKED if name not in numbers}
        found = gains({**missing, **numbers}, config, self.setup.plant.coulomb_friction)
        return {name: _rounded(x) for name, x in found.items() if name not in missing}

    def fresh(self) -> TuneSpec:
        """Return the spec of the validation: more draws, of another seed and with other noise."""
        n = self.repeats.repeats
        return dataclasses.replace(self, repeats=self.repeats.changed(
            {'repeats': _FRESH * n, 'seed': self.repeats.seed + n}))


def parse_tune(tree: object, path: Path, more: Mapping[str, Any] | None = None) -> TuneSpec:
    """
    Return what a spec says.

    Parameters
    ----------
    tree : object
        Contents of the spec: keys of a spec of `ctc map` but `axes`, `laws` and `failure`, and
        `tune`.
    path : Path
        Of the spec; relative paths in it count from its directory.
    more : mapping, optional
        What is uncertain besides: as in a spec, or drives. Without this and `uncertain`, `usual`
        is.

    Raises
    ------
    CtcError
        Naming the key, its value and what is allowed; before anything is run.

    """
    for key in _OF_MAP:
        if isinstance(tree, dict) and key in tree:
            raise CtcError(f'{key}: not allowed for ctc tune, which takes one law and what is '
                           'uncertain; it is for ctc map')
    given: Any = {'repeats': DRAWS, **tree} if isinstance(tree, dict) else tree
    spec = parse(given, path)
    if spec.repeats.sampling == 'saltelli':
        raise ParameterError('sampling', 'saltelli', 'random | latin_hypercube | sobol')
    trees = {**(given.get('uncertain') or {}), **(more or {})} if (
        more is not None or 'uncertain' in given) else usual(spec.setup)
    uncertain = tuple(x if isinstance(x, Uncertain) else read_uncertain(name, x)
                      for name, x in trees.items())
    section = mapping('tune', given.get('tune') or {}, _KEYS)
    file = _plain(spec.setup)
    law = {'law': section.get('law', _BEST)}
    if 'switching' in section or law['law'] == 'chattering':
        law['switching'] = section.get('switching', 'implicit_observer')
    variant = read_law('tune', law, file)
    setup = file.changed({'controller': variant.values})
    found = TuneSpec(**{
        **vars(spec), 'setup': setup, 'uncertain': uncertain, 'tree': {**given, 'uncertain': {
            name: getattr(x, 'text', x) for name, x in trees.items()}},
        'variants': (variant,)},
        file=file, values=_values(file, given, path), limits=_limits(section, setup),
        ranges=_ranges(section.get('search') or {}, setup))
    _check(found)
    return found


def usual(setup: Setup) -> dict[str, Any]:
    """Return what is uncertain of a robot where nothing says so."""
    found = {'model': _MODEL}
    for name, x in _UNKNOWN.items():
        parameter = x['parameter'].partition('.')[2]
        if any(getattr(setup.plant, parameter)):
            found[name] = {'parameter': x['parameter'], **_FACTOR}
        elif len(x) > 1:
            found[name] = x
    return found


def _plain(setup: Setup) -> Setup:
    """Return a setup that starts smoothly, and whose parameters do not change in the run."""
    start = max(setup.reference.start_duration, _START)
    return dataclasses.replace(
        setup.changed({'reference': {'start_duration': start}}), events=())


def _values(file: Setup, given: Mapping[str, Any], path: Path) -> dict[str, Values]:
    """Return the values of the file to be written, with the duration that it has itself."""
    own = parameter_file.load(find_config(given.get('params_file', 'friction'), path.parent),
                              given.get('overrides', {}))
    values = {node: dict(mine) for node, mine in file.values.items()}
    values['plant'].update(duration=own.plant.duration)
    values['bringup'].update(events=[''])
    return values


def _limits(section: Mapping[str, Any], setup: Setup) -> Limits:
    """Return the limits that the spec gives; else the least of all that is known."""
    plant, config = setup.plant, setup.controller
    model = model_of(config, setup.descriptions.get('controller', ''))
    torque = (config.effort_limit, plant.torque_saturation, model.effort_limits)
    rate = (config.effort_rate_limit, config.torque_rate_limit, plant.torque_rate_limit)
    return Limits(*(
        read_value(f'tune.{name}', 'float[]', section[name], model.n, minimum=LEAST,
                   infinite=True, shape='n') if name in section else
        tuple(map(min, zip(*filter(None, known))))
        for name, known in (('torque_limit', torque), ('torque_rate_limit', rate))))


def _ranges(tree: object, setup: Setup) -> dict[str, Range]:
    """Return where each number is searched: from `SPACE`, or the spec."""
    known = space(setup.controller)
    given = mapping('tune.search', tree, tuple(known))
    ranges = {name: x for name, x in known.items() if name not in _ASKED or name in given}
    for name, value in given.items():
        numbers = read_value(f'tune.search.{name}', 'float[]', value if isinstance(
            value, list) else [value, value], minimum=LEAST)
        if len(numbers) != 2 or numbers[0] > numbers[1]:
            raise ParameterError(f'tune.search.{name}', value, 'a number > 0, or two, ascending')
        ranges[name] = Range(*numbers)
    return ranges


def _check(spec: TuneSpec) -> None:
    """Check that all gains searched are allowed, and that no draw sets one of them."""
    for end in ('low', 'high'):
        values = spec.gains({name: getattr(x, end) for name, x in spec.ranges.items()})
        with prefixed('tune.search.'):
            spec.setup.controller.changed(values)
    for quantity in spec.uncertain:
        for node, target in quantity.targets:
            if node == 'controller' and target.name in (*values, 'law', 'switching'):
                raise CtcError(f'uncertain.{quantity.name}: {node}.{target.name} is tuned; '
                               'allowed: what is not')


def _rounded(value: Any) -> Any:
    """Return a number, or a list of them, to four digits."""
    return [_rounded(x) for x in value] if isinstance(value, list) else rounded(value, 4)


#: Names in the directory that `ctc identify` writes.
VALUES, NUMBERS = 'identified.yaml', 'identify.json'
#: Part of M, C and G that may be wrong in any case.
_MODEL_PART = 0.05
#: Nearly 1, the end of the interval of a lag.
_LAST = 1.0 - 1e-9


@dataclasses.dataclass(frozen=True)
class PossibleDrives(Uncertain):
    """
    Delays with the lags that explain the recording as well, all as likely as each other.

    From the number k + u the delay is the k-th one, and each lag is by the part u of its interval
    above the lower end.

    Attributes
    ----------
    drives : tuple of (int, tuple of (float, float))
        Delays, each with the interval of the lag of each joint [s].

    """

    drives: tuple[tuple[int, tuple[tuple[float, float], ...]], ...]

    @property
    def unit(self) -> str:
        """Return no unit: the number is a place in all of these."""
        return ''

    @property
    def text(self) -> str:
        """Return delays and lags in words."""
        return ' or '.join(
            f'delay {delay} with lags '
            f'{", ".join(f"{1e3 * low:.2g} to {1e3 * high:.2g}" for low, high in lags)} ms'
            for delay, lags in self.drives)

    @property
    def typical(self) -> tuple[float, ...]:
        """Return numbers of each delay with its shortest and its longest lags."""
        return tuple(k + u for k in range(len(self.drives)) for u in (0.0, _LAST))

    def value(self, spec: Parameter, x: float, _now: Any, _n: int) -> Any:
        """Return the delay, or the lag of each joint."""
        k = min(int(x), len(self.drives) - 1)
        delay, lags = self.drives[k]
        if spec.name == 'input_delay':
            return delay
        return tuple(low + (x - k) * (high - low) for low, high in lags)


def identified_spec(directory: Path, tree: Mapping[str, Any]) -> TuneSpec:
    """
    Return what is tuned, from what `ctc identify` has written.

    Parameters
    ----------
    directory : Path
        With `identified.yaml` and `identify.json`.
    tree : mapping
        Further keys of the spec.

    Raises
    ------
    CtcError
        If a file cannot be read, or is none of `ctc identify`.

    """
    path = directory / NUMBERS
    setup = parameter_file.load(directory / VALUES)
    try:
        found = json.loads(path.read_text(encoding='utf-8'))
        uncertain = dict((*_friction(found), *_drives(found), *_model(found, setup)))
    except OSError as error:
        raise CtcError(f'{path}: {error.strerror or error}') from None
    except (ValueError, KeyError, TypeError, AttributeError, IndexError):
        raise CtcError(f'{path}: not a file of ctc identify') from None
    # The rate in the file is what the recommended law makes do with, no limit of the drives.
    rate = setup.plant.torque_rate_limit
    section = {'torque_rate_limit': list(rate) if rate else inf, **(tree.get('tune') or {})}
    return parse_tune({'params_file': VALUES, **tree, 'tune': section}, directory / VALUES,
                      uncertain)


def _friction(found: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield factors of friction: for all joints, the widest interval of any."""
    for name in ('coulomb', 'viscous'):
        part = max((_half(x[name]) / x[name]['value'] for x in found['friction']
                    if (x[name]['value'] or 0.0) > 0.0), default=0.0)
        if part > 0.0:
            yield name, {'parameter': f'plant.{name}_friction', 'factor': True,
                         'uniform': [max(0.0, 1.0 - part), 1.0 + part]}


def _drives(found: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield each delay that is possible, with the intervals of its lags."""
    drives = tuple((int(x['delay_samples']), tuple(
        (max(0.0, float(low)), float(high)) for low, high in x['actuator_lag_interval_95_s']))
        for x in found['delays_possible'])
    if any(high > low for _, lags in drives for low, high in lags) or len(drives) > 1:
        parameters = PlantConfig.parameters()
        targets = tuple(('plant', parameters[x]) for x in ('input_delay', 'actuator_lag'))
        yield 'delay and lag', PossibleDrives(
            'delay and lag', targets, False, 'uniform', (0.0, float(len(drives))), drives)


def _model(found: Mapping[str, Any], setup: Setup) -> Iterator[tuple[str, Any]]:
    """Yield a scale of the controller's model, and the payload that it lacks."""
    known = [x for x in found['model_errors'] if x['value'] is not None]
    part = max([_MODEL_PART, *(abs(x['value']) + _half(x) for x in known if not x['unit'])])
    yield 'model', {**_MODEL, 'uniform': [1.0 - min(part, 0.9), 1.0 + part]}
    for x in known:
        if x['unit'] and setup.plant.described and x['value'] > 0.0 and _half(x) > 0.0:
            yield 'payload', {'parameter': 'plant.payload', 'uniform': [
                max(0.0, x['value'] - _half(x)), x['value'] + _half(x)]}


def _half(number: Mapping[str, Any]) -> float:
    """Return half the interval of a number; 0 without one."""
    low, high = number.get('interval_95') or (0.0, 0.0)
    return 0.5 * float(high - low)


class Candidate(NamedTuple):
    """
    Gains, and what they do.

    Attributes
    ----------
    name : str
        Shown.
    values : mapping
        Parameters of the controller in place of those of the file.
    drawn, fresh : OverDraws
        On the draws of the search, and on fresh ones.

    """

    name: str
    values: Mapping[str, Any]
    drawn: OverDraws
    fresh: OverDraws


@dataclasses.dataclass(frozen=True)
class Tuning:
    """
    The result of a search.

    Attributes
    ----------
    spec : TuneSpec
        What was tuned.
    percentile : float
        Part of the runs that error and variation of a candidate do not exceed [%].
    seed : int
        Of the search.
    trials : tuple of Trial
        All, in their order.
    front : tuple of int
        Trials that are not dominated, in the order of their torque variation.
    points : tuple of Candidate
        The same, validated.
    best : Candidate or None
        What is recommended: of the points, and of `others` under the law that is tuned; None
        without a trial that keeps the limits.
    others : tuple of Candidate
        The gains of the file, and the recommended settings of laws.
    drawn, fresh : Runs
        Draws of the search and of the validation.

    """

    spec: TuneSpec
    percentile: float
    seed: int
    trials: tuple[Trial, ...]
    front: tuple[int, ...]
    points: tuple[Candidate, ...]
    best: Candidate | None
    others: tuple[Candidate, ...]
    drawn: Runs
    fresh: Runs


Progress = Callable[[int, int], None]


def with_gains(draws: Runs, values: Mapping[str, Any]) -> list[Setup]:
    """Return the setups of all draws with parameters of the controller."""
    return [dataclasses.replace(x, controller=x.controller.changed(values)) for x in draws.setups]


def scores_of(window: tuple[float, float], setups: Sequence[Setup]) -> list[Score]:
    """Run setups; return the numbers of their true motion in a window."""
    return [score(setup, window) for setup in setups]


def searched(spec: TuneSpec, trials: int, percentile: float = 95.0, seed: int = 0,
             each: Callable[..., Iterator[Any]] = map, progress: Progress | None = None
             ) -> Tuning:
    """
    Search for gains, and validate what was found.

    Parameters
    ----------
    spec : TuneSpec
        Robot, law, limits and ranges.
    trials : int
        How many.
    percentile : float
        Part of the runs that error and variation do not exceed [%]; 100 for the worst run.
    seed : int
        Of the sampler.
    each : callable
        Map of a function over tasks, in their order.
    progress : callable, optional
        Called with the number of trials that are done, and of all.

    Raises
    ------
    CtcError
        If a draw is not allowed; before anything is run.

    """
    drawn, fresh = Runs(spec), Runs(spec.fresh())
    for draws in (drawn, fresh):  # What is not allowed shows here.
        _ = draws.setups

    def scores(candidates: Iterable[Mapping[str, Any]], draws: Runs) -> list[OverDraws]:
        """Return what candidates, parameters of the controller, do over the same draws."""
        return [over_draws(runs, spec.limits, percentile) for runs in each(
            partial(scores_of, spec.window), [with_gains(draws, x) for x in candidates])]

    first = starts(spec.setup.controller, spec.setup.plant.coulomb_friction,
                   recommended(spec.setup), spec.ranges)
    found: list[Trial] = []
    others = references(spec)
    of_others = scores(others.values(), drawn)

    def answers(batch: list[Numbers]) -> Iterator[tuple[tuple[float, float], dict[str, float]]]:
        found.extend(map(Trial, batch, scores(map(spec.gains, batch), drawn)))
        if progress is not None:
            progress(len(found), trials)
        return ((x.score.objectives, x.score.excess) for x in found[-len(batch):])

    search(answers, spec.ranges, first, trials, seed)
    chosen = front([trial.score for trial in found])
    values = [spec.gains(found[k].numbers) for k in chosen]
    validated = scores([*values, *others.values()], fresh)
    points = tuple(map(Candidate, map(str, count(1)), values, (found[k].score for k in chosen),
                       validated))
    rest = tuple(map(Candidate, others, others.values(), of_others, validated[len(points):]))
    config = spec.setup.controller
    mine = [x for x in rest if points and config.changed(x.values).law == config.law]
    return Tuning(spec, percentile, seed, tuple(found), tuple(chosen), points,
                  recommended_of([*points, *mine]), rest, drawn, fresh)


def recommended_of(candidates: Sequence[Candidate]) -> Candidate | None:
    """Return the knee on fresh draws, of those that keep the limits there, or of all."""
    kept = [x for x in candidates if x.fresh.allowed] or list(candidates)
    return kept[knee([x.fresh for x in kept])] if kept else None


def references(spec: TuneSpec) -> dict[str, dict[str, Any]]:
    """Return the gains of the file, which are the first, and the recommended settings, by name."""
    file, law = spec.file, spec.setup.controller.law
    setups = {'file': file, **{f'recommended {name}': recommended_setup(file, name)
                               for name in dict.fromkeys((law, _BEST))}}
    found = {}
    for name, setup in setups.items():
        config = setup.controller
        words = (name, '' if config.law in name else config.law, config.switching_in_force)
        found[' '.join(filter(None, words))] = config.as_mapping()
    return found


def setups(spec: TuneSpec) -> list[Setup]:
    """Return the laws that run: the one that is tuned, and those of `references`."""
    return [dataclasses.replace(spec.setup, controller=spec.setup.controller.changed(values))
            for values in ({}, *references(spec).values())]


def tune_spec(spec: TuneSpec | Mapping[str, Any] | str | Path,
              identified: str | Path | None = None) -> TuneSpec:
    """Return what is tuned; arguments and errors as of `tune`."""
    if isinstance(spec, TuneSpec):
        return spec
    if isinstance(spec, Mapping):
        if identified is not None:
            return identified_spec(Path(identified), spec)
        return parse_tune(dict(spec), Path(Path(str(spec.get('params_file', 'friction'))).name))
    with errors_of(Path(spec)):
        return parse_tune(read_yaml(Path(spec)), Path(spec))


def tune(spec: TuneSpec | Mapping[str, Any] | str | Path, trials: int = 200,
         percentile: float = 95.0, identified: str | Path | None = None, jobs: int = 1,
         show: Callable[[str], None] = print, progress: Progress | None = None) -> Tuning:
    """
    Search for gains for a robot whose parameters are known only within ranges.

    Parameters
    ----------
    spec : mapping, str or Path
        What is tuned, as docs/tuning.md has it, or the path of a file with it; such as
        ``{'params_file': 'panda', 'repeats': 32, 'tune': {'law': 'observer_feedback'}}``.
    trials : int
        Gains to try.
    percentile : float
        Part of the draws that error and torque variation do not exceed [%]; 100 for the worst.
    identified : str or Path, optional
        Directory that `write_identified` has written: the robot, uncertain within its
        intervals. `spec` is then a mapping of further keys.
    jobs : int
        Processes; with more than 1 a script needs ``if __name__ == '__main__'``.
    show : callable
        Takes lines about what is compiled.
    progress : callable, optional
        Called with the number of trials that are done, and of all; the validation follows.

    Returns
    -------
    Tuning
        The ``points`` of the front of error against torque variation, each with ``values``, the
        parameters of the controller; ``best`` is the recommended one, None if none keeps the
        limits. For `write_tuning`.

    Raises
    ------
    CtcError
        If something in the spec, or an argument, is not allowed, before anything is run.

    """
    require_optuna('tune')
    trials, jobs = whole('trials', trials, 1), whole('jobs', jobs, 1)
    if not 0.0 < percentile <= 100.0:
        raise ParameterError('percentile', percentile, 'a number > 0 and <= 100')
    found = tune_spec(spec, identified)
    compile_setups(setups(found), show)
    with processes(jobs) as each:
        return searched(found, trials, percentile, found.repeats.seed, each, progress)

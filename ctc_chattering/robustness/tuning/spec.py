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

"""What is tuned: a robot, its uncertainty, a law, limits, and ranges of the numbers searched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from math import inf
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.number_format import rounded
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup, Values
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.configuration.yaml_file import mapping
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.parameters import Parameter
from ctc_chattering.robustness.quantity import applied, read_uncertain, Uncertain
from ctc_chattering.robustness.sampling import draws
from ctc_chattering.robustness.spec import parse, Repeats
from ctc_chattering.robustness.tuning.search import Limits
from ctc_chattering.studies.tuning import gains, Range, space

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
#: Law that is tuned where nothing says which.
_LAW = 'observer_feedback'
#: Keys of the section `tune`, and of a spec of `ctc map` that have no meaning here.
_KEYS = ('law', 'switching', 'torque_limit', 'torque_rate_limit', 'search')
_OF_MAP = ('axes', 'laws', 'failure', 'refine')


@dataclasses.dataclass(frozen=True)
class Draws:
    """
    What is uncertain, drawn.

    Attributes
    ----------
    seed : int
        Of the draws; the plant's noise_seed is this plus the number of the draw.
    values : tuple of tuple of float, shape (draws, m)
        Number of each uncertain quantity.
    setups : tuple of Setup
        The robot of each draw, under the law that is tuned.

    """

    seed: int
    values: tuple[tuple[float, ...], ...]
    setups: tuple[Setup, ...]


@dataclasses.dataclass(frozen=True)
class TuneSpec:
    """
    A checked spec.

    Attributes
    ----------
    name : str
        Of its file, or of the parameter file.
    file : Setup
        The robot with the law and gains of its file, a smooth start, and no events.
    setup : Setup
        The same under the law that is tuned.
    values : mapping
        Parameters of the file for `parameter_file.dump`, by node; with its own duration.
    window : (float, float)
        Evaluated interval [s].
    uncertain : tuple of Uncertain
        What is drawn.
    repeats : Repeats
        How it is drawn.
    limits : Limits
        Of the torque.
    ranges : mapping of str to Range
        Where each number is searched.
    notes : tuple of str
        What is not known, and not drawn.

    """

    name: str
    file: Setup
    setup: Setup
    values: Mapping[str, Values]
    window: tuple[float, float]
    uncertain: tuple[Uncertain, ...]
    repeats: Repeats
    limits: Limits
    ranges: Mapping[str, Range]
    notes: tuple[str, ...] = ()

    def gains(self, numbers: Mapping[str, float]) -> dict[str, Any]:
        """Return the parameters of the controller that numbers mean, to four digits."""
        config = self.setup.controller
        missing = {name: getattr(config, name) for name in _ASKED if name not in numbers}
        found = gains({**missing, **numbers}, config, self.setup.plant.coulomb_friction)
        return {name: _rounded(x) for name, x in found.items() if name not in missing}

    def draws(self) -> Draws:
        """Return the draws of the search."""
        return self._drawn(self.repeats)

    def fresh_draws(self) -> Draws:
        """Return as many draws as the validation has, by another seed and with other noise."""
        n = self.repeats.repeats
        return self._drawn(self.repeats.changed(
            {'repeats': _FRESH * n, 'seed': self.repeats.seed + n}))

    def _drawn(self, repeats: Repeats) -> Draws:
        table = draws(self.uncertain, repeats)
        return Draws(repeats.seed, tuple(map(tuple, table.tolist())), tuple(
            applied(self.setup, zip(self.uncertain, row), repeats.seed + k)
            for k, row in enumerate(table.tolist())))


def parse_tune(tree: object, path: Path, more: Sequence[Uncertain] = ()) -> TuneSpec:
    """
    Return what a spec says.

    Parameters
    ----------
    tree : object
        Contents of the spec: keys of a spec of `ctc map` but `axes`, `laws` and `failure`, and
        `tune`.
    path : Path
        Of the spec; relative paths in it count from its directory.
    more : sequence of Uncertain
        What is uncertain besides. Without this and `uncertain`, `usual` is.

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
    uncertain = (*spec.uncertain, *more) if more or 'uncertain' in given else usual(spec.setup)
    section = mapping('tune', given.get('tune') or {}, _KEYS)
    file = _plain(spec.setup)
    law = {'law': section.get('law', _LAW)}
    if 'switching' in section or law['law'] == 'chattering':
        law['switching'] = section.get('switching', 'implicit_observer')
    try:
        setup = file.changed({'controller': law})
    except ParameterError as error:
        raise _within('tune', error) from None
    if 'switching' in law and not setup.controller.takes('switching'):
        raise ParameterError('tune.switching', law['switching'], f'none under law {law["law"]}')
    found = TuneSpec(
        spec.name, file, setup, _values(file, given, path), spec.window,
        uncertain, spec.repeats, _limits(section, setup),
        _ranges(section.get('search') or {}, setup))
    _check(found)
    return found


def usual(setup: Setup) -> tuple[Uncertain, ...]:
    """Return what is uncertain of a robot where nothing says so."""
    found = {'model': _MODEL}
    for name, x in _UNKNOWN.items():
        parameter = x['parameter'].partition('.')[2]
        if any(getattr(setup.plant, parameter)):
            found[name] = {'parameter': x['parameter'], **_FACTOR}
        elif len(x) > 1:
            found[name] = x
    return tuple(read_uncertain(name, x) for name, x in found.items())


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
        _limit(f'tune.{name}', section[name], model.n) if name in section else
        tuple(map(min, zip(*filter(None, known))))
        for name, known in (('torque_limit', torque), ('torque_rate_limit', rate))))


def _limit(key: str, value: object, n: int) -> tuple[float, ...]:
    """Return a limit of each joint; a number is that of every joint."""
    spec = Parameter(key, 'float[]', inf, '', minimum=0.0, exclusive=True, infinite=True,
                     shape='n')
    limit: tuple[float, ...] = spec.coerce(value, n)
    spec.check(limit, n)
    return limit


def _ranges(tree: object, setup: Setup) -> dict[str, Range]:
    """Return where each number is searched: from `SPACE`, or the spec."""
    known = space(setup.controller)
    given = mapping('tune.search', tree, tuple(known))
    ranges = {name: x for name, x in known.items() if name not in _ASKED or name in given}
    for name, value in given.items():
        ends = value if isinstance(value, list) else [value, value]
        spec = Parameter(f'tune.search.{name}', 'float[]', (), '', minimum=0.0, exclusive=True)
        numbers = spec.coerce(ends)
        spec.check(numbers, 0)
        if len(numbers) != 2 or numbers[0] > numbers[1]:
            raise ParameterError(spec.name, value, 'a number > 0, or two, ascending')
        ranges[name] = Range(*numbers)
    return ranges


def _check(spec: TuneSpec) -> None:
    """Check that all gains searched are allowed, and that no draw sets one of them."""
    for end in ('low', 'high'):
        try:
            values = spec.gains({name: getattr(x, end) for name, x in spec.ranges.items()})
            spec.setup.controller.changed(values)
        except ParameterError as error:
            raise _within('tune.search', error) from None
    for quantity in spec.uncertain:
        for node, target in quantity.targets:
            if node == 'controller' and target.name in (*values, 'law', 'switching'):
                raise CtcError(f'uncertain.{quantity.name}: {node}.{target.name} is tuned; '
                               'allowed: what is not')


def _within(key: str, error: ParameterError) -> ParameterError:
    """Return an error with its place in the spec."""
    name = error.name.removeprefix('controller: ')
    return ParameterError(f'{key}.{name}', error.value, error.allowed)


def _rounded(value: Any) -> Any:
    """Return a number, or a list of them, to four digits."""
    return [_rounded(x) for x in value] if isinstance(value, list) else rounded(value, 4)

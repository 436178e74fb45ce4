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

"""What is tuned: robot, uncertainty, from a spec or `ctc identify`, law, limits and ranges."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import dataclasses
import json
from math import inf
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.tables import rounded
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup, Values
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.configuration.yaml_file import mapping
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.parameters import Parameter
from ctc_chattering.runs.search import gains, Limits, Range, space
from ctc_chattering.runs.spec import (
    LawSettings,
    MapSpec,
    parse,
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
#: Law that is tuned where nothing says which.
_LAW = 'observer_feedback'
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
    notes : tuple of str
        What is not known, and not drawn.

    """

    file: Setup
    values: Mapping[str, Values]
    limits: Limits
    ranges: Mapping[str, Range]
    notes: tuple[str, ...] = ()

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
    law = {'law': section.get('law', _LAW)}
    if 'switching' in section or law['law'] == 'chattering':
        law['switching'] = section.get('switching', 'implicit_observer')
    try:
        setup = file.changed({'controller': law})
    except ParameterError as error:
        raise _within('tune', error) from None
    if 'switching' in law and not setup.controller.takes('switching'):
        raise ParameterError('tune.switching', law['switching'], f'none under law {law["law"]}')
    config = setup.controller
    found = TuneSpec(**{
        **vars(spec), 'setup': setup, 'uncertain': uncertain, 'tree': {**given, 'uncertain': {
            name: getattr(x, 'text', x) for name, x in trees.items()}},
        'variants': (LawSettings('', config.law, config.switching_in_force, law, False),)},
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
        read_value(f'tune.{name}', 'float[]', section[name], model.n, minimum=0.0, exclusive=True,
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
            value, list) else [value, value], minimum=0.0, exclusive=True)
        if len(numbers) != 2 or numbers[0] > numbers[1]:
            raise ParameterError(f'tune.search.{name}', value, 'a number > 0, or two, ascending')
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
        notes = tuple(_notes(found, setup))
    except OSError as error:
        raise CtcError(f'{path}: {error.strerror or error}') from None
    except (ValueError, KeyError, TypeError, AttributeError, IndexError):
        raise CtcError(f'{path}: not a file of ctc identify') from None
    # The rate in the file is what the recommended law makes do with, no limit of the drives.
    rate = setup.plant.torque_rate_limit
    section = {'torque_rate_limit': list(rate) if rate else inf, **(tree.get('tune') or {})}
    spec = parse_tune({'params_file': VALUES, **tree, 'tune': section}, directory / VALUES,
                      uncertain)
    return dataclasses.replace(spec, notes=notes)


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
        if x['unit'] and _drawn(x, setup):
            yield 'payload', {'parameter': 'plant.payload', 'uniform': [
                max(0.0, x['value'] - _half(x)), x['value'] + _half(x)]}


def _notes(found: Mapping[str, Any], setup: Setup) -> Iterator[str]:
    """Yield what is not known, and not drawn."""
    if found['delay_samples'] is None and len(found['delays_possible']) < 2:
        yield f'the delay is not known, and {setup.plant.input_delay} in {VALUES}'
    for x in found['model_errors']:
        if x['value'] is not None and x['unit'] and not _drawn(x, setup):
            yield f'{x["name"]} of {x["value"]:.3g} {x["unit"]} is not drawn'


def _drawn(error: Mapping[str, Any], setup: Setup) -> bool:
    """Return whether the plant can have a payload."""
    return bool(setup.plant.described and error['value'] > 0.0 and _half(error) > 0.0)


def _half(number: Mapping[str, Any]) -> float:
    """Return half the interval of a number; 0 without one."""
    low, high = number.get('interval_95') or (0.0, 0.0)
    return 0.5 * float(high - low)

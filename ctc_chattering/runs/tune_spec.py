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
What is tuned: a robot that is known in part, a law, where each of its numbers is searched.

The numbers suit robots of every size: where joints differ, a number times what the file has for
each joint.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import dataclasses
from functools import cached_property
import json
from math import inf, sqrt
from pathlib import Path
from typing import Any, NamedTuple

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup, Values
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.configuration.yaml_file import detect_kind, FileKind, mapping, read_yaml
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.control.laws.registry import laws_by_parameter, OF_SWITCHING
from ctc_chattering.control.recommended_gains import RECOMMENDED_LAW, RECOMMENDED_SWITCHING
from ctc_chattering.errors import CtcError, ParameterError, prefixed
from ctc_chattering.input_files import read_text
from ctc_chattering.number_format import round_number
from ctc_chattering.parameters import LEAST
from ctc_chattering.runs.recommended import recommended_setup
from ctc_chattering.runs.score import limits
from ctc_chattering.runs.spec import (
    Failure,
    KEYS,
    MapSpec,
    parse,
    read_law,
    read_value,
)

#: What is uncertain of model, of friction, and of lag and noise that the file has.
_MODEL: dict[str, Any] = {'parameters': ['controller.inertia_scale', 'controller.gravity_scale'],
                          'uniform': [0.9, 1.1]}
_FACTOR: dict[str, Any] = {'uniform': [0.8, 1.2], 'factor': True}
#: Draws, where the spec does not say how many.
DRAWS = 32
#: Draws for the validation, for each one of the search.
_FRESH = 4
#: Shortest smooth start [s]: a start with a large error is no measure of gains.
_START = 2.0
#: Keys of the section `tune`, and of the spec: those of `ctc map` that have a meaning here.
_OF_TUNE = ('law', 'switching', 'torque_limit', 'torque_rate_limit', 'search')
_KEYS = tuple(x for x in KEYS if x not in ('axes', 'laws', 'failure', 'refine'))


class Range(NamedTuple):
    """Range of a number that is searched, on a logarithmic scale."""

    low: float
    high: float


#: What is searched. `pole` is p and `damping` d in ``kp = p²``, ``kv = 2 d p``; `ka` and
#: `friction_level` are multiples of the file's, `ki` of ``kp kv``, and `adaptation_gain` of the
#: Coulomb friction.
SPACE: dict[str, Range] = {
    'pole': Range(5.0, 500.0),
    'damping': Range(0.4, 4.0),
    'lambda': Range(1.0, 100.0),
    'ka': Range(0.5, 20.0),
    'boundary_layer': Range(1e-3, 1.0),
    'observer_bandwidth': Range(20.0, 2000.0),
    'ki': Range(1e-3, 0.5),
    'lead_ratio': Range(0.05, 1.0),
    'momentum_gain': Range(10.0, 1000.0),
    'super_twisting_k1': Range(1.0, 1000.0),
    'super_twisting_k2': Range(10.0, 1e5),
    'adaptation_gain': Range(0.1, 1e4),
    'friction_velocity': Range(2e-3, 1.0),
    'friction_lead': Range(3e-4, 0.03),
    'estimator_bandwidth': Range(30.0, 600.0),
    'friction_learning': Range(1.0, 100.0)}


def space(config: ControllerConfig) -> dict[str, Range]:
    """Return what is searched: kp and kv, and what law and switching in force declare."""
    names = ('pole', 'damping', *config.law_parameters)
    return {name: x for name, x in SPACE.items() if name in names
            and OF_SWITCHING.get(name, config.switching) == config.switching}


def gains(numbers: Mapping[str, float], config: ControllerConfig, friction: tuple[float, ...]
          ) -> dict[str, Any]:
    """
    Return the parameters that the numbers of a trial mean.

    Parameters
    ----------
    numbers : mapping
        Of everything in `space`.
    config : ControllerConfig
        The file's, with the law and switching.
    friction : tuple of float, shape (n,)
        Coulomb friction of the plant [N·m].

    """
    n = len(config.joint_names)
    kp, kv = numbers['pole'] ** 2, 2.0 * numbers['damping'] * numbers['pole']
    values: dict[str, Any] = {'kp': [kp] * n, 'kv': [kv] * n}
    for name in space(config):
        if name not in ('pole', 'damping'):
            x = numbers[name]
            per_joint = config.parameters()[name].shape
            values[name] = [x * y for y in _scales(name, kp * kv, config, friction)
                            ] if per_joint else x
    return values


def starts(config: ControllerConfig, friction: tuple[float, ...], known: Mapping[str, Any],
           ranges: Mapping[str, Range]) -> list[dict[str, float]]:
    """
    Return the numbers of the first two trials, within the ranges.

    Parameters
    ----------
    config, friction
        As `gains` has them; their numbers, those of joint 1, are the first.
    known : mapping
        What is recommended for `observer_feedback`, by parameter: of its `kp`, `kv` and `ka`, and
        the triple pole of `integral` and the observer of `chattering` for a robot, are the
        second, with what suits a reversal of 10 ms, and the first for all else.
    ranges : mapping
        Where to search.

    """
    kp, kv = config.kp[0], config.kv[0]
    values = config.as_mapping()
    file = {'pole': sqrt(kp), 'damping': 0.5 * kv / sqrt(kp)}
    for name in space(config):
        if name not in file:
            x = values[name]
            file[name] = x[0] / _scales(name, kp * kv, config, friction)[0] if isinstance(
                x, tuple) else x
    pole = sqrt(known['kp'][0])
    other = {'pole': pole, 'damping': 0.5 * known['kv'][0] / pole,
             'ka': known['ka'][0] / (config.ka[0] or 1.0), 'ki': 1.0 / 9.0,
             'estimator_bandwidth': known['estimator_bandwidth'],
             'friction_lead': 5e-3, 'friction_velocity': 0.1, 'lead_ratio': 0.1,
             'observer_bandwidth': config.parameters()['observer_bandwidth'].default}
    return [{name: min(max(x[name], limits.low), limits.high) for name, limits in ranges.items()}
            for x in (file, {**file, **other})]


def _scales(name: str, product: float, config: ControllerConfig, friction: tuple[float, ...]
            ) -> tuple[float, ...]:
    """Return by what a number of one gain is multiplied on each joint, shape (n,)."""
    n = len(config.joint_names)
    return {'ka': tuple(x or 1.0 for x in config.ka), 'ki': (product,) * n,
            'adaptation_gain': tuple(x or 1.0 for x in friction)}.get(name, (1.0,) * n)


class Limits(NamedTuple):
    """Largest torque [N·m] and torque rate [N·m/s] of each joint, shape (n,); inf for none."""

    torque: tuple[float, ...]
    rate: tuple[float, ...]


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
        found = gains(numbers, self.setup.controller, self.setup.plant.coulomb_friction)
        return {name: _rounded(x) for name, x in found.items()}

    @cached_property
    def references(self) -> dict[str, dict[str, Any]]:
        """Return the gains of the file, the first, and recommended ones, by name."""
        law, tuned = self.setup.controller.law, self.setup.controller.as_mapping()
        setups = {'file': self.file, **{f'recommended {name}': recommended_setup(self.file, name)
                                        for name in dict.fromkeys((law, RECOMMENDED_LAW))}}
        found = {}
        for name, setup in setups.items():
            config = setup.controller
            words = (name, '' if config.law in name else config.law, config.switching_in_force)
            found[' '.join(filter(None, words))] = {
                key: x for key, x in config.as_mapping().items() if x != tuned[key]}
        return found

    def fresh(self) -> TuneSpec:
        """Return the spec of the validation: more draws, of another seed and with other noise."""
        n = self.repeats.repeats
        return dataclasses.replace(self, repeats=self.repeats.changed(
            {'repeats': _FRESH * n, 'seed': self.repeats.seed + n}))


def parse_tune(tree: object, path: Path) -> TuneSpec:
    """
    Return what a spec says.

    Parameters
    ----------
    tree : object
        Contents of the spec: keys of a spec of `ctc map` but `axes`, `laws`, `refine` and
        `failure`, and `tune`. Without `uncertain`, `usual` is.
    path : Path
        Of the spec; relative paths in it count from its directory.

    Raises
    ------
    CtcError
        Naming the key, its value and what is allowed; before anything is run.

    """
    given = {'repeats': DRAWS, **mapping('spec', tree, _KEYS)}
    spec = parse(given, path)
    if 'uncertain' not in given:
        return parse_tune({**given, 'uncertain': usual(spec.setup)}, path)
    if spec.repeats.sampling == 'saltelli':
        raise ParameterError('sampling', 'saltelli', 'random | latin_hypercube | sobol')
    section = mapping('tune', given.get('tune') or {}, _OF_TUNE)
    law = {'law': section.get('law', RECOMMENDED_LAW)}
    if 'switching' in section or law['law'] in laws_by_parameter()['switching']:
        law['switching'] = section.get('switching', RECOMMENDED_SWITCHING)
    start = max(spec.setup.reference.start_duration, _START)
    file = dataclasses.replace(
        spec.setup.changed({'reference': {'start_duration': start}}), events=())
    variant = read_law('tune', law, file)
    setup = file.changed({'controller': variant.values})
    own = parameter_file.load(find_config(given.get('params_file', 'friction'), path.parent),
                              given.get('overrides', {}))  # It has the duration of the file.
    values = {**file.values, 'bringup': {**file.values['bringup'], 'events': ['']},
              'plant': {**file.values['plant'], 'duration': own.plant.duration}}
    found = TuneSpec(**{
        **vars(spec), 'setup': setup, 'variants': (variant,), 'failure': Failure()},
        file=file, values=values, limits=_limits(section, setup),
        ranges=_ranges(section.get('search') or {}, setup))
    _check(found)
    return found


def usual(setup: Setup) -> dict[str, Any]:
    """Return what is uncertain of a robot where nothing says so."""
    plant, found = setup.plant, {'model': _MODEL}
    if any(plant.coulomb_friction):
        found['friction'] = {'parameter': 'plant.coulomb_friction', **_FACTOR}
    found['lag'] = {'parameter': 'plant.actuator_lag', **(
        _FACTOR if any(plant.actuator_lag) else {'uniform': [0.0, 2e-3]})}
    found['noise'] = {'parameter': 'plant.velocity_noise', **(
        _FACTOR if any(plant.velocity_noise) else {'log_uniform': [1e-4, 2e-3]})}
    return found


def _limits(section: Mapping[str, Any], setup: Setup) -> Limits:
    """Return the limits that the spec gives; else the least of all that is known."""
    plant, config, n = setup.plant, setup.controller, len(setup.plant.joint_names)
    rates = (config.effort_rate_limit, config.torque_rate_limit, plant.torque_rate_limit)
    return Limits(*(
        read_value(f'tune.{name}', 'float[]', section[name], n, minimum=LEAST, infinite=True,
                   shape='n') if name in section else tuple(known)
        for name, known in (('torque_limit', limits(setup)),
                            ('torque_rate_limit', map(min, zip(*filter(None, rates)))))))


def _ranges(tree: object, setup: Setup) -> dict[str, Range]:
    """Return where each number is searched: from `SPACE`, or the spec."""
    known = space(setup.controller)
    ranges = dict(known)
    for name, value in mapping('tune.search', tree, tuple(known)).items():
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
    return [_rounded(x) for x in value] if isinstance(value, list) else round_number(value, 4)


#: Names in the directory that `ctc identify` writes.
VALUES, NUMBERS = 'identified.yaml', 'identify.json'
#: Part of M, C and G that may be wrong in any case.
_MODEL_PART = 0.05


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
        found = json.loads(read_text(path))
        uncertain = dict((*_friction(found), *_drives(found), *_model(found)))
    except (ValueError, KeyError, TypeError, AttributeError, IndexError):
        raise CtcError(f'{path}: not a file of ctc identify') from None
    # The rate in the file is what the recommended law makes do with, no limit of the drives.
    rate = setup.plant.torque_rate_limit
    section = {'torque_rate_limit': list(rate) if rate else inf, **(tree.get('tune') or {})}
    return parse_tune({
        'params_file': VALUES, **tree, 'tune': section,
        'uncertain': {**(tree.get('uncertain') or {}), **uncertain}}, directory / VALUES)


def _friction(found: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield factors of friction: for all joints, the widest interval of any."""
    for name in ('coulomb', 'viscous'):
        part = max((_half(x[name]) / x[name]['value'] for x in found['friction']
                    if (x[name]['value'] or 0.0) > 0.0), default=0.0)
        if part > 0.0:
            yield name, {'parameter': f'plant.{name}_friction', 'factor': True,
                         'uniform': [max(0.0, 1.0 - part), 1.0 + part]}


def _drives(found: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the delays that are possible, and all lags that are so of any joint with any delay."""
    delays = [int(x['delay_samples']) for x in found['delays_possible']]
    if len(delays) > 1:
        yield 'delay', {'parameter': 'plant.input_delay', 'choice': delays}
    ends = [float(end) for x in found['delays_possible']
            for interval in x['actuator_lag_interval_95_s'] for end in interval]
    if ends and max(ends) > max(0.0, min(ends)):
        yield 'lag', {'parameter': 'plant.actuator_lag', 'uniform': [
            max(0.0, min(ends)), max(ends)]}


def _model(found: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield a scale of the controller's model."""
    part = max(_MODEL_PART, float(found.get('bodies_uncertainty', 0.0)))
    yield 'model', {**_MODEL, 'uniform': [1.0 - min(part, 0.9), 1.0 + part]}


def _half(number: Mapping[str, Any]) -> float:
    """Return half the interval of a number; 0 without one."""
    low, high = number.get('interval_95') or (0.0, 0.0)
    return 0.5 * float(high - low)


def tune_spec(spec: TuneSpec | Mapping[str, Any] | str | Path,
              identified: str | Path | None = None, more: Mapping[str, Any] | None = None
              ) -> TuneSpec:
    """Return what a spec, or a parameter file alone, has tuned; `more` in place of its keys."""
    if isinstance(spec, TuneSpec):
        return spec
    if isinstance(spec, Mapping):
        if identified is not None:
            return identified_spec(Path(identified), spec)
        return parse_tune(spec, Path(Path(str(spec.get('params_file', 'friction'))).name))
    path = Path(spec)
    tree = read_yaml(path, FileKind.SPEC, FileKind.PARAMETERS)
    if detect_kind(tree) == FileKind.PARAMETERS:
        return tune_spec({'params_file': str(path), **(more or {})})
    with prefixed(f'{path}: '):
        return parse_tune({**tree, **(more or {})} if isinstance(tree, dict) else tree, path)

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
Specs of searches for gains.

`ctc tune` reads it by `tune_spec`, from a file or from the output of `ctc identify`. The numbers
that are searched suit robots of every size. Where joints differ, a number times a gain of the
file is that of each joint.
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
from ctc_chattering.runs.conditions import MIN_START_DURATION_S
from ctc_chattering.runs.recommended import FILE, LawSettings, RECOMMENDED, recommended_setup
from ctc_chattering.runs.score import torque_limits
from ctc_chattering.runs.spec import (
    Failure,
    KEYS,
    MapSpec,
    parse_spec,
    read_law,
    read_setup,
    read_value,
)

#: Number of draws by default.
DRAWS = 32
#: Parameters of the controller that scale its model.
_MODEL_SCALES = ['controller.inertia_scale', 'controller.gravity_scale']
#: Numbers of a trial by name.
Numbers = dict[str, float]


class Range(NamedTuple):
    """Range of a number, on a logarithmic scale."""

    low: float
    high: float


#: Ranges of the search. `pole` is p and `damping` d in ``kp = p²``, ``kv = 2 d p``. `ka` is a
#: multiple of the file's, `ki` of ``kp kv``, and `adaptation_gain` of the Coulomb friction.
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
    """Return the ranges of the gains of a law."""
    names = ('pole', 'damping', *config.law_parameters)
    return {name: limits for name, limits in SPACE.items() if name in names
            and OF_SWITCHING.get(name, config.switching) == config.switching}


def gains(numbers: Mapping[str, float], config: ControllerConfig, friction: tuple[float, ...]
          ) -> dict[str, Any]:
    """
    Return the gains that numbers of a trial mean.

    Parameters
    ----------
    numbers : mapping
        A number for every name in `space`.
    config : ControllerConfig
        The file's, with the law and switching.
    friction : tuple of float, shape (n,)
        Coulomb friction of the plant [N·m].

    """
    n = len(config.joint_names)
    kp = numbers['pole'] ** 2
    kv = 2.0 * numbers['damping'] * numbers['pole']
    values: dict[str, Any] = {'kp': [kp] * n, 'kv': [kv] * n}
    for name in (*space(config),)[2:]:  # Without pole and damping.
        values[name] = numbers[name]
        if config.parameters()[name].shape:
            scales = _scales(name, kp * kv, config, friction)
            values[name] = [numbers[name] * x for x in scales]
    return values


def first_numbers(config: ControllerConfig, friction: tuple[float, ...],
                  by_rule: Mapping[str, Any], ranges: Mapping[str, Range]) -> list[Numbers]:
    """
    Return the numbers of the first two trials.

    Those of the first mean the gains of the file on joint 1. Those of the second are by the rule
    of `observer_feedback` where it has them: `kp`, `kv`, `ka` and `estimator_bandwidth`. Other
    gains of the second suit a triple pole of `integral`, the observer of `chattering`, and a
    reversal of 10 ms. The rest is that of the first.

    Parameters
    ----------
    config, friction
        As `gains` has them.
    by_rule : mapping
        Recommended gains of `observer_feedback`, by parameter.
    ranges : mapping
        Ranges of the search.

    """
    kp, kv = config.kp[0], config.kv[0]
    file = {'pole': sqrt(kp), 'damping': 0.5 * kv / sqrt(kp)}
    for name in (*space(config),)[2:]:
        value = config.as_mapping()[name]
        if isinstance(value, tuple):
            value = value[0] / _scales(name, kp * kv, config, friction)[0]
        file[name] = value
    pole = sqrt(by_rule['kp'][0])
    recommended = file | {
        'pole': pole, 'damping': 0.5 * by_rule['kv'][0] / pole,
        'ka': by_rule['ka'][0] / (config.ka[0] or 1.0), 'ki': 1.0 / 9.0,
        'estimator_bandwidth': by_rule['estimator_bandwidth'],
        'friction_lead': 5e-3, 'friction_velocity': 0.1, 'lead_ratio': 0.1,
        'observer_bandwidth': config.parameters()['observer_bandwidth'].default}
    return [{name: min(max(numbers[name], limits.low), limits.high)
             for name, limits in ranges.items()} for numbers in (file, recommended)]


def _scales(name: str, product: float, config: ControllerConfig, friction: tuple[float, ...]
            ) -> tuple[float, ...]:
    """Return the factors from a number to gains, shape (n,)."""
    if name == 'ka':
        return tuple(x or 1.0 for x in config.ka)
    if name == 'adaptation_gain':
        return tuple(x or 1.0 for x in friction)
    return (product if name == 'ki' else 1.0,) * len(config.joint_names)


class Limits(NamedTuple):
    """
    Largest torque [N·m] and torque rate [N·m/s].

    They have the shape (n,), and inf for no limit.
    """

    torque: tuple[float, ...]
    rate: tuple[float, ...]


@dataclasses.dataclass(frozen=True)
class TuneSpec(MapSpec):
    """
    A checked spec of a search.

    Attributes
    ----------
    file : Setup
        The robot with the law and gains of its file, a smooth start, and no events.
    values : mapping
        Parameters of the file for `parameter_file.dump`, by node, with its own duration.
    limits : Limits
        Limits of the torque.
    ranges : mapping of str to Range
        Range of each number.

    """

    file: Setup
    values: Mapping[str, Values]
    limits: Limits
    ranges: Mapping[str, Range]

    def gains(self, numbers: Mapping[str, float]) -> dict[str, Any]:
        """Return the gains that numbers mean, to four digits."""
        values = gains(numbers, self.setup.controller, self.setup.plant.coulomb_friction)
        return {name: [round_number(x, 4) for x in value] if isinstance(value, list)
                else round_number(value, 4) for name, value in values.items()}

    def law(self, name: str, numbers: Mapping[str, float]) -> LawSettings:
        """Return the tuned law with its gains."""
        config = self.setup.controller
        return LawSettings(config.law, config.switching_in_force, values=self.gains(numbers),
                           name=name)

    @cached_property
    def references(self) -> tuple[LawSettings, ...]:
        """Laws to compare with: gains of the file and recommended."""
        tuned = self.setup.controller
        by_rule = [recommended_setup(self.file, law)
                   for law in dict.fromkeys((tuned.law, RECOMMENDED_LAW))]
        laws = []
        for setup in (self.file, *by_rule):
            config = setup.controller
            switching = config.switching_in_force
            words = (FILE if setup is self.file else RECOMMENDED, config.law, switching)
            values = {name: x for name, x in config.as_mapping().items()
                      if x != tuned.as_mapping()[name]}
            laws.append(LawSettings(config.law, switching, values=values,
                                    name=' '.join(filter(None, words))))
        return tuple(laws)

    def fresh(self) -> TuneSpec:
        """
        Return the spec of the validation.

        It has four times the draws, of another seed and noise.
        """
        n = self.repeats.repeats
        return dataclasses.replace(self, repeats=self.repeats.changed(
            {'repeats': 4 * n, 'seed': self.repeats.seed + n}))


def parse_tune(tree: object, path: Path) -> TuneSpec:
    """
    Return the checked spec.

    Parameters
    ----------
    tree : object
        Contents of the spec: keys of a spec of `ctc map` but `axes`, `laws`, `refine` and
        `failure`, and `tune`. `uncertain` is by default that of `usual_uncertainty`.
    path : Path
        Path of the spec. Relative paths in it count from its directory.

    Raises
    ------
    CtcError
        Naming the key, its value and the allowed ones, before anything is run.

    """
    keys = tuple(x for x in KEYS if x not in ('axes', 'laws', 'failure', 'refine'))
    values = {'repeats': DRAWS, **mapping('spec', tree, keys)}
    if 'uncertain' not in values:
        values['uncertain'] = usual_uncertainty(read_setup(values, path.parent))
    spec = parse_spec(values, path)
    if spec.repeats.sampling == 'saltelli':
        raise ParameterError('sampling', 'saltelli', 'random | latin_hypercube | sobol')
    section = mapping('tune', values.get('tune') or {}, (
        'law', 'switching', 'torque_limit', 'torque_rate_limit', 'search'))
    # A start with a large error is no measure of gains.
    start = max(spec.setup.reference.start_duration, MIN_START_DURATION_S)
    file = dataclasses.replace(
        spec.setup.changed({'reference': {'start_duration': start}}), events=())
    law = _read_tuned_law(section, file)
    setup = file.changed({'controller': law.parameters})
    # The tuned file keeps the duration of its own, not that of the spec.
    untimed = parameter_file.load(find_config(values.get('params_file', 'friction'), path.parent),
                                  values.get('overrides', {}))
    dumped = {**file.values, 'bringup': {**file.values['bringup'], 'events': ['']},
              'plant': {**file.values['plant'], 'duration': untimed.plant.duration}}
    of_map = vars(spec) | {'setup': setup, 'variants': (law,), 'failure': Failure()}
    tuned = TuneSpec(**of_map, file=file, values=dumped, limits=_read_limits(section, setup),
                     ranges=_read_ranges(section.get('search') or {}, setup))
    _check_gains(tuned)
    return tuned


def usual_uncertainty(setup: Setup) -> dict[str, Any]:
    """Return the uncertain quantities of a robot by default."""
    factor = {'uniform': [0.8, 1.2], 'factor': True}
    plant = setup.plant
    uncertain: dict[str, Any] = {'model': {'parameters': _MODEL_SCALES, 'uniform': [0.9, 1.1]}}
    if any(plant.coulomb_friction):
        uncertain['friction'] = {'parameter': 'plant.coulomb_friction', **factor}
    lag = factor if any(plant.actuator_lag) else {'uniform': [0.0, 2e-3]}
    noise = factor if any(plant.velocity_noise) else {'log_uniform': [1e-4, 2e-3]}
    return uncertain | {'lag': {'parameter': 'plant.actuator_lag', **lag},
                        'noise': {'parameter': 'plant.velocity_noise', **noise}}


def _read_tuned_law(section: Mapping[str, Any], file: Setup) -> LawSettings:
    """Return the law that is tuned."""
    law = {'law': section.get('law', RECOMMENDED_LAW)}
    if 'switching' in section or law['law'] in laws_by_parameter()['switching']:
        law['switching'] = section.get('switching', RECOMMENDED_SWITCHING)
    return read_law('tune', law, file)


def _read_limits(section: Mapping[str, Any], setup: Setup) -> Limits:
    """Return the limits of the spec, or the known ones."""
    plant, config = setup.plant, setup.controller
    rates = (config.effort_rate_limit, config.torque_rate_limit, plant.torque_rate_limit)
    known_limits = {'torque_limit': torque_limits(setup),
                    'torque_rate_limit': map(min, zip(*filter(None, rates)))}
    return Limits(*(
        read_value(f'tune.{name}', 'float[]', section[name], len(plant.joint_names),
                   minimum=LEAST, infinite=True, shape='n')
        if name in section else tuple(limit) for name, limit in known_limits.items()))


def _read_ranges(tree: object, setup: Setup) -> dict[str, Range]:
    """Return the ranges of the spec above those of `SPACE`."""
    ranges = space(setup.controller)
    for name, value in mapping('tune.search', tree, tuple(ranges)).items():
        ends = value if isinstance(value, list) else [value, value]
        numbers = read_value(f'tune.search.{name}', 'float[]', ends, minimum=LEAST)
        if len(numbers) != 2 or numbers[0] > numbers[1]:
            raise ParameterError(f'tune.search.{name}', value, 'a number > 0, or two, ascending')
        ranges[name] = Range(*numbers)
    return ranges


def _check_gains(spec: TuneSpec) -> None:
    """Check that gains are allowed and not drawn."""
    for end in (0, 1):
        values = spec.gains({name: limits[end] for name, limits in spec.ranges.items()})
        with prefixed('tune.search.'):
            spec.setup.controller.changed(values)
    for quantity in spec.uncertain:
        for node, target in quantity.targets:
            if node == 'controller' and target.name in (*values, 'law', 'switching'):
                raise CtcError(
                    f'uncertain.{quantity.name}: {node}.{target.name} is tuned, so that it cannot '
                    'be uncertain; allowed: a parameter that the search does not set')


#: Parameter file in the directory that `ctc identify` writes.
VALUES = 'identified.yaml'
#: Numbers in that directory.
NUMBERS = 'identify.json'


def identified_spec(directory: Path, tree: Mapping[str, Any]) -> TuneSpec:
    """
    Return the spec of an identified robot.

    Parameters
    ----------
    directory : Path
        Output of `ctc identify`, with `identified.yaml` and `identify.json`.
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
        numbers = json.loads(read_text(path))
        uncertain = dict((*_friction(numbers), *_drives(numbers), *_model(numbers)))
    except (ValueError, KeyError, TypeError, AttributeError, IndexError):
        raise CtcError(f'{path}: not a file of ctc identify') from None
    # The rate in the file suffices for the recommended law, and is no limit of the drives.
    rate = setup.plant.torque_rate_limit
    section = {'torque_rate_limit': list(rate) if rate else inf, **(tree.get('tune') or {})}
    return parse_tune({
        'params_file': VALUES, **tree, 'tune': section,
        'uncertain': {**(tree.get('uncertain') or {}), **uncertain}}, directory / VALUES)


def _friction(numbers: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """
    Yield factors of friction.

    For all joints it is the widest interval of any.
    """
    for name in ('coulomb', 'viscous'):
        terms = [joint[name] for joint in numbers['friction']]
        half_widths = [_half_interval(x) / x['value'] for x in terms if (x['value'] or 0.0) > 0.0]
        if half_widths and (widest := max(half_widths)) > 0.0:
            yield name, {'parameter': f'plant.{name}_friction', 'factor': True,
                         'uniform': [max(0.0, 1.0 - widest), 1.0 + widest]}


def _drives(numbers: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the possible delays, and lags of any joint."""
    delays = [int(x['delay_samples']) for x in numbers['delays_possible']]
    if len(delays) > 1:
        yield 'delay', {'parameter': 'plant.input_delay', 'choice': delays}
    ends = [float(end) for x in numbers['delays_possible']
            for interval in x['actuator_lag_interval_95_s'] for end in interval]
    if ends and max(ends) > max(0.0, min(ends)):
        yield 'lag', {'parameter': 'plant.actuator_lag', 'uniform': [
            max(0.0, min(ends)), max(ends)]}


def _model(numbers: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield a scale of the controller's model, at least ±5 %."""
    half_width = max(0.05, float(numbers.get('bodies_uncertainty', 0.0)))
    yield 'model', {'parameters': _MODEL_SCALES,
                    'uniform': [1.0 - min(half_width, 0.9), 1.0 + half_width]}


def _half_interval(number: Mapping[str, Any]) -> float:
    """Return half the interval of a number, or 0."""
    low, high = number.get('interval_95') or (0.0, 0.0)
    return 0.5 * float(high - low)


def tune_spec(spec: TuneSpec | Mapping[str, Any] | str | Path,
              identified: str | Path | None = None, changes: Mapping[str, Any] | None = None
              ) -> TuneSpec:
    """
    Return the spec of a file or a mapping.

    A parameter file alone is one with all defaults. `changes` win over keys of the file.
    """
    if isinstance(spec, TuneSpec):
        return spec
    if isinstance(spec, Mapping):
        if identified is not None:
            return identified_spec(Path(identified), spec)
        return parse_tune(spec, Path(Path(str(spec.get('params_file', 'friction'))).name))
    path = Path(spec)
    tree = read_yaml(path, FileKind.SPEC, FileKind.PARAMETERS)
    if detect_kind(tree) == FileKind.PARAMETERS:
        return tune_spec({'params_file': str(path), **(changes or {})})
    with prefixed(f'{path}: '):
        return parse_tune({**tree, **(changes or {})} if isinstance(tree, dict) else tree, path)

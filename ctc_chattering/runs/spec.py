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
Specs of maps: laws, axes, draws and failures.

`read_spec` reads one from a file for `ctc map`. `tune_spec` takes its keys for `ctc tune`. Every
error names the key, its value and the allowed ones, before anything is run.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
import dataclasses
from itertools import pairwise
from math import inf, prod
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.metrics import WARN_ERROR_SHARE
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.node_parameters import LOOP
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.configuration.yaml_file import FileKind, mapping, read_yaml
from ctc_chattering.errors import CtcError, ParameterError, prefixed
from ctc_chattering.parameters import Config, Parameter, parameter
from ctc_chattering.runs.recommended import FILE, LawSettings, RECOMMENDED, recommended_setup
from ctc_chattering.runs.score import result_columns, RUN_COLUMNS
import numpy as np
import yaml

#: Largest number of runs of a map, and of values of an axis.
MAX_RUNS = 10_000_000
#: Distributions. Each has two numbers, but `choice` any number of values.
DISTRIBUTIONS = ('uniform', 'log_uniform', 'normal', 'choice')
#: Keys of a quantity, besides those of its values.
_QUANTITY_KEYS = ('parameter', 'parameters', 'factor')


@dataclasses.dataclass(frozen=True)
class Quantity:
    """
    Parameters that one number sets.

    Attributes
    ----------
    name : str
        Column of the results.
    targets : tuple of (str, Parameter)
        Node, one of `LOOP`, and its parameter. A parameter for every joint has the number on each.
    factor : bool
        Whether the number multiplies the value that the parameter has otherwise.

    """

    name: str
    targets: tuple[tuple[str, Parameter], ...]
    factor: bool

    @property
    def unit(self) -> str:
        """Physical unit of the number, empty for a factor."""
        return '' if self.factor else self.targets[0][1].unit

    @property
    def known_to_controller(self) -> bool:
        """Presence of another target than the plant."""
        return any(node != 'plant' for node, _ in self.targets)

    def value(self, spec: Parameter, number: float, current: Any, n: int) -> Any:
        """
        Return the value of a parameter.

        Parameters
        ----------
        spec : Parameter
            One of the targets.
        number : float
            Number of the quantity.
        current : object
            Value of the parameter so far.
        n : int
            Number of joints.

        """
        if not self.factor:
            value: Any = (number,) * n if spec.shape else number
        elif isinstance(current, tuple):
            value = tuple(number * x for x in current)
        else:
            value = number * current
        return int(value) if spec.kind == 'int' and value == round(value) else value


@dataclasses.dataclass(frozen=True)
class Axis(Quantity):
    """A quantity with its values in a map, ascending."""

    values: tuple[float, ...]


@dataclasses.dataclass(frozen=True)
class Uncertain(Quantity):
    """
    A quantity that is drawn.

    Attributes
    ----------
    distribution : str
        One of `DISTRIBUTIONS`.
    numbers : tuple of float
        Ends of `uniform` and `log_uniform`, mean and standard deviation of `normal`, or the
        equally likely values of `choice`.

    """

    distribution: str
    numbers: tuple[float, ...]

    @property
    def typical(self) -> tuple[float, ...]:
        """Values that must be allowed."""
        return self.numbers[:1] if self.distribution == 'normal' else self.numbers


def set_quantities(setup: Setup, numbers: Iterable[tuple[Quantity, float]],
                   noise_seed: int | None = None) -> Setup:
    """
    Return a setup with quantities set in order.

    Parameters
    ----------
    setup : Setup
        Setup of the file, or of a law.
    numbers : iterable of (Quantity, float)
        Quantities with their numbers.
    noise_seed : int, optional
        Seed of the plant, in place of that of the setup.

    Raises
    ------
    CtcError
        If a value is not allowed, or contradicts another.

    """
    values: dict[str, dict[str, Any]] = {node: {} for node in LOOP}
    for quantity, number in numbers:
        for node, spec in quantity.targets:
            config = getattr(setup, node)
            current = values[node].get(spec.name, getattr(config, spec.field))
            values[node][spec.name] = quantity.value(
                spec, number, current, len(config.joint_names))
    if noise_seed is not None:
        values['plant']['noise_seed'] = noise_seed
    return setup.changed(values)


def read_axis(name: str, tree: object) -> Axis:
    """Return an axis of a spec."""
    key = f'axes.{name}'
    if not isinstance(tree, dict) or 'range' not in tree:
        values = mapping(key, tree, (*_QUANTITY_KEYS, 'values'))
        numbers = read_value(f'{key}.values', 'float[]', values.get('values'))
        if not numbers or any(a >= b for a, b in pairwise(numbers)):
            raise ParameterError(f'{key}.values', numbers, 'one number or more, ascending')
        return Axis(name, *_read_targets(key, values), numbers)
    values = mapping(key, tree, (*_QUANTITY_KEYS, 'range', 'count', 'spacing'))
    spacing = read_value(f'{key}.spacing', 'str', values.get('spacing', 'linear'),
                         choices=('linear', 'log'))
    ends = _read_ends(f'{key}.range', values['range'], spacing == 'log')
    count = read_value(f'{key}.count', 'int', values.get('count'), minimum=2, maximum=MAX_RUNS)
    space: Any = np.geomspace if spacing == 'log' else np.linspace
    return Axis(name, *_read_targets(key, values), tuple(space(*ends, count).tolist()))


def read_uncertain(name: str, tree: object) -> Uncertain:
    """Return an uncertain quantity of a spec."""
    key = f'uncertain.{name}'
    values = mapping(key, tree, (*_QUANTITY_KEYS, *DISTRIBUTIONS))
    distribution = _only_key(key, values, DISTRIBUTIONS)
    key_of_numbers, value = f'{key}.{distribution}', values[distribution]
    if distribution in ('uniform', 'log_uniform'):
        numbers = _read_ends(key_of_numbers, value, distribution == 'log_uniform')
    else:
        numbers = read_value(key_of_numbers, 'float[]', value)
        if distribution == 'normal' and not (len(numbers) == 2 and numbers[-1] > 0.0):
            raise ParameterError(key_of_numbers, numbers, 'mean and standard deviation > 0')
        if not len(set(numbers)) == len(numbers) > 0:
            raise ParameterError(key_of_numbers, numbers, 'different numbers')
    return Uncertain(name, *_read_targets(key, values), distribution, numbers)


def read_value(key: str, type_name: str, value: object, n: int = 0, **allowed: Any) -> Any:
    """Return a checked value of a spec."""
    return Parameter(key, type_name, None, '', **allowed).checked(value, n)


def _only_key(key: str, values: Mapping[str, Any], names: Sequence[str]) -> str:
    """Return the only present one of some keys."""
    present = [name for name in names if name in values]
    if len(present) != 1:
        raise ParameterError(key, present, 'one of ' + ', '.join(names))
    return present[0]


def _read_ends(key: str, value: object, positive: bool) -> tuple[float, ...]:
    """Return two ends, ascending."""
    ends: tuple[float, ...] = read_value(key, 'float[]', value)
    if len(ends) != 2 or ends[0] >= ends[1] or (positive and ends[0] <= 0.0):
        raise ParameterError(key, ends, 'two numbers, ascending' + ', > 0' * positive)
    return ends


def check_quantities(quantities: Iterable[tuple[Quantity, tuple[float, ...]]], setup: Setup
                     ) -> None:
    """
    Check quantities alone and against each other.

    Parameters
    ----------
    quantities : iterable of (Quantity, tuple of float)
        In the order in which they are set, with values that must be allowed.
    setup : Setup
        Setup of the file.

    Raises
    ------
    CtcError
        For a value that is not allowed, or a parameter that is set again and not multiplied.

    """
    first_setter: dict[str, str] = {}
    for quantity, numbers in quantities:
        for node, spec in quantity.targets:
            target = f'{node}.{spec.name}'
            setter = first_setter.setdefault(target, quantity.name)
            if setter != quantity.name and not quantity.factor:
                raise ParameterError(quantity.name, target,
                                     f'a factor, since {setter} sets it as well')
        for number in numbers:
            with prefixed(f'{quantity.name} = {number:g}: '):
                set_quantities(setup, [(quantity, number)])


def coarse_steps(values: Mapping[str, Any], axes: tuple[Axis, ...]) -> tuple[int, ...]:
    """Return the steps of the coarse grid along each axis."""
    levels = read_value('refine', 'int', values.get('refine', 0), minimum=0, maximum=16)
    steps = tuple(2 ** levels if 'range' in values['axes'][x.name] else 1 for x in axes)
    if levels and max(steps, default=1) == 1:
        raise ParameterError('refine', levels, '0, or an axis with a range')
    for axis, step in zip(axes, steps):
        if (len(axis.values) - 1) % step:
            raise ParameterError(f'axes.{axis.name}.count', len(axis.values),
                                 f'a multiple of {step} and 1 with refine {levels}')
    return steps


def _read_targets(key: str, values: dict[str, Any]
                  ) -> tuple[tuple[tuple[str, Parameter], ...], bool]:
    """Return the targets of a quantity, and `factor`."""
    name = _only_key(key, values, ('parameter', 'parameters'))
    texts = values[name] if name == 'parameters' else [values[name]]
    texts = read_value(f'{key}.{name}', 'str[]', texts)
    targets = tuple(target for text in texts for target in _targets(f'{key}.{name}', text))
    if not targets or len(set(targets)) < len(targets):
        raise ParameterError(f'{key}.{name}', texts, 'one or more, each once')
    return targets, read_value(f'{key}.factor', 'bool', values.get('factor', False))


def _targets(key: str, text: str) -> list[tuple[str, Parameter]]:
    """Return the nodes and declarations of a parameter."""
    node, _, name = text.partition('.')
    nodes = [node]
    if node not in LOOP:
        nodes, name = list(LOOP), text
    targets = [(node, LOOP[node].parameters()[name]) for node in nodes
               if name in LOOP[node].parameters()]
    are_numbers = all(spec.kind in ('int', 'float', 'float[]') for _, spec in targets)
    # The spec itself sets two parameters, by its duration, and by seed and repeat.
    if not targets or not are_numbers or name in ('duration', 'noise_seed'):
        raise ParameterError(
            key, text, f'a parameter of {", ".join(LOOP)} that is a number or a number a joint, '
            'such as plant.coulomb_friction; duration, seed and repeats of the spec set others')
    return targets


#: Keys of a spec. `tune` is for `ctc tune`.
KEYS = ('params_file', 'duration', 'window', 'overrides', 'laws', 'axes', 'uncertain', 'sampling',
        'repeats', 'seed', 'failure', 'refine', 'tune')


@dataclasses.dataclass(frozen=True)
class Repeats(Config):
    """Number of runs of every point, and their draws."""

    sampling: str = parameter(
        'sobol', 'How `uncertain` is drawn.',
        choices=('random', 'latin_hypercube', 'sobol', 'saltelli'))
    repeats: int = parameter(1, 'Runs of every law at every point.', minimum=1, maximum=MAX_RUNS)
    seed: int = parameter(
        0, 'Seed of the draws; noise_seed of the plant is seed + repeat.', maximum=2 ** 61)


@dataclasses.dataclass(frozen=True)
class Failure(Config):
    """Limits from which a finished run is a failure."""

    error_above: float = parameter(inf, 'RMS error of any joint in the window.', 'rad')
    error_share_above: float = parameter(
        inf, 'RMS error of any joint in the window, as a part of the amplitude of its motion.')
    saturated_above: float = parameter(
        1.0, 'Part of the samples in the window with a torque at its limit.', maximum=1.0)
    slips_above: float = parameter(inf, 'Stick-slips of any joint in a second of rest.', '1/s')
    not_reached: bool = parameter(
        False, 'Whether v that never stays within its band is a failure.')


@dataclasses.dataclass(frozen=True)
class MapSpec:
    """
    A checked spec.

    Attributes
    ----------
    name : str
        Name of its file.
    setup : Setup
        The parameter file with the overrides of the spec.
    window : (float, float)
        Evaluated interval [s].
    variants : tuple of LawSettings
        Laws.
    axes, uncertain : tuple of Quantity
        In the order of the file.
    repeats : Repeats
        Draws.
    failure : Failure
        Limits.
    coarse : tuple of int
        Of each axis: the step between values that are run first, a power of two.
    tree : mapping
        Contents of the file.

    """

    name: str
    setup: Setup
    window: tuple[float, float]
    variants: tuple[LawSettings, ...]
    axes: tuple[Axis, ...]
    uncertain: tuple[Uncertain, ...]
    repeats: Repeats
    failure: Failure
    coarse: tuple[int, ...]
    tree: Mapping[str, Any]

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes."""
        return tuple(len(axis.values) for axis in self.axes)

    @property
    def runs(self) -> int:
        """Total number of runs."""
        return prod(self.shape) * len(self.variants) * self.repeats.repeats


def read_spec(path: Path) -> MapSpec:
    """
    Read a spec and its parameter file.

    Raises
    ------
    CtcError
        Naming the file, the key, its value and the allowed ones, before anything is run.

    """
    tree = read_yaml(path, FileKind.SPEC)
    with prefixed(f'{path}: '):
        return parse_spec(tree, path)


def spec_rows(tree: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the keys of a spec with their values."""
    for key, value in tree.items():
        for name, entry in (value if isinstance(value, dict) else {'': value}).items():
            yield f'{key} {name}'.rstrip(), yaml.safe_dump(
                entry, default_flow_style=True, sort_keys=False, allow_unicode=True,
                width=float('inf')).removesuffix('...\n').rstrip()


def parse_spec(tree: object, path: Path) -> MapSpec:
    """
    Return the checked spec.

    Relative paths in it count from the directory of `path`.
    """
    values = mapping('spec', tree, KEYS)
    setup = read_setup(values, path.parent)
    taken = (*RUN_COLUMNS, *result_columns(len(setup.controller.joint_names)))
    axes = _read_quantities(values, 'axes', read_axis, taken)
    uncertain = _read_quantities(values, 'uncertain', read_uncertain, (
        *taken, *(axis.name for axis in axes)))
    spec = MapSpec(
        name=path.stem, setup=setup, window=_read_window(values, setup.plant.duration),
        variants=_read_laws(values, setup), axes=axes, uncertain=uncertain,
        repeats=Repeats.from_mapping({x: values[x] for x in Repeats.parameters() if x in values}),
        failure=_read_failure(values), coarse=coarse_steps(values, axes), tree=values)
    _check_saltelli(spec)
    if spec.runs > MAX_RUNS:
        raise CtcError(f'{spec.runs} runs: {prod(spec.shape)} points, {len(spec.variants)} laws, '
                       f'{spec.repeats.repeats} repeats; allowed: {MAX_RUNS}')
    check_quantities(
        [*((x, x.values) for x in axes), *((x, x.typical) for x in uncertain)], setup)
    return spec


def _check_saltelli(spec: MapSpec) -> None:
    """Check that draws for Sobol indices are whole."""
    if spec.repeats.sampling != 'saltelli':
        return
    blocks = len(spec.uncertain) + 2
    size, remainder = divmod(spec.repeats.repeats, blocks)
    if spec.axes or len(spec.uncertain) < 2 or remainder or size.bit_count() != 1:
        raise ParameterError('sampling', 'saltelli', (
            'without axes, for what is uncertain, two quantities or more, with repeats of '
            f'{blocks} times a power of two'))


def _read_failure(values: Mapping[str, Any]) -> Failure:
    """
    Return the limits of failure.

    The default is the error of which `ctc simulate` warns.
    """
    if 'failure' not in values:
        return Failure(error_share_above=WARN_ERROR_SHARE)
    with prefixed('failure.'):
        return Failure.from_mapping(mapping(
            'failure', values['failure'], tuple(Failure.parameters())))


def read_setup(values: Mapping[str, Any], beside: Path) -> Setup:
    """Return the parameter file with the spec's overrides."""
    name = read_value('params_file', 'str', values.get('params_file', 'friction'))
    overrides = values.get('overrides', {})
    if not isinstance(overrides, dict) or not all(isinstance(x, dict) for x in overrides.values()):
        raise ParameterError('overrides', overrides, 'a mapping of nodes to their parameters')
    if 'duration' in values:
        plant = {**overrides.get('plant', {}), 'duration': values['duration']}
        overrides = {**overrides, 'plant': plant}
    setup = parameter_file.load(find_config(name, beside), overrides)
    if setup.plant.duration == 0.0:
        raise ParameterError('duration', 0.0, 'a number > 0, since every run must end')
    return setup


def _read_window(values: Mapping[str, Any], duration: float) -> tuple[float, float]:
    """Return the evaluated interval, by default the second half."""
    window = read_value('window', 'float[]', values.get('window', [0.5 * duration, duration]))
    if len(window) != 2 or not 0.0 <= window[0] < window[1] <= duration:
        raise ParameterError('window', window, f'two times, ascending, from 0 to {duration:g} s')
    return window[0], window[1]


def _read_quantities(values: Mapping[str, Any], key: str, read: Callable[[str, object], Any],
                     taken: Container[str]) -> tuple[Any, ...]:
    """Return axes or uncertain quantities with new names."""
    tree = values.get(key) or {}
    if not isinstance(tree, dict):
        raise ParameterError(key, tree, 'a mapping of names')
    for name in tree:
        if not (isinstance(name, str) and name.isidentifier()) or name in taken:
            raise ParameterError(key, name, 'a name of letters, digits and _ that is no column '
                                 'of the results, such as error, law or repeat')
    return tuple(read(name, x) for name, x in tree.items())


def _read_laws(values: Mapping[str, Any], setup: Setup) -> tuple[LawSettings, ...]:
    """Return the laws, by default that of the file."""
    items = values.get('laws', [setup.controller.law])
    if not isinstance(items, list) or not items:
        raise ParameterError('laws', items, 'a list of laws')
    laws = tuple(read_law(f'laws[{i}]', item, setup) for i, item in enumerate(items))
    names = [law.name for law in laws]
    if len(set(names)) < len(names):
        raise ParameterError('laws', names, 'different names: give each a name of its own')
    return laws


def read_law(key: str, item: object, setup: Setup) -> LawSettings:
    """Return a law from text or a mapping."""
    values: dict[str, Any] = {'law': setup.controller.law}
    if isinstance(item, str) and 0 < len(item.split()) <= 2:
        values.update(zip(('law', 'switching'), item.split()))
    elif isinstance(item, dict) and all(isinstance(name, str) for name in item):
        values.update(item)
    else:
        raise ParameterError(key, item, 'a law, a law and a switching, or a mapping of '
                             'parameters of the controller, name and recommended')
    name = read_value(f'{key}.name', 'str', values.pop('name', ''))
    recommended = read_value(f'{key}.recommended', 'bool', values.pop('recommended', False))
    with prefixed(f'{key}.'):
        config = setup.controller.changed(values)
        if recommended:
            config = recommended_setup(setup, config.law).controller.changed(values)
        if 'switching' in values and not config.takes('switching'):
            raise ParameterError('switching', values['switching'], f'none under law {config.law}')
    switching = config.switching_in_force
    words = (config.law, switching, RECOMMENDED if recommended else '')
    return LawSettings(config.law, switching, RECOMMENDED if recommended else FILE, values,
                       name or ' '.join(filter(None, words)))

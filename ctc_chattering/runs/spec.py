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

"""The spec of a map: what is run, over which values and draws, and what counts as a failure."""

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
from ctc_chattering.runs.recommended import recommended_setup
from ctc_chattering.runs.score import of_results, WHICH
import numpy as np
import yaml

#: Most runs of a map, and values of an axis.
MOST = 10_000_000
#: Most levels of a refinement.
_LEVELS = 16
#: Distributions, and the two numbers of each; of `choice` any number of values.
DISTRIBUTIONS = ('uniform', 'log_uniform', 'normal', 'choice')
#: Parameters that the spec itself sets: by its duration, and by seed and repeat.
_SET = ('duration', 'noise_seed')
_OF_QUANTITY = ('parameter', 'parameters', 'factor')


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
        Whether the number multiplies what the parameter has otherwise.

    """

    name: str
    targets: tuple[tuple[str, Parameter], ...]
    factor: bool

    @property
    def unit(self) -> str:
        """Return the unit of the number; empty for a factor, and where there is none."""
        return '' if self.factor else self.targets[0][1].unit

    @property
    def known(self) -> bool:
        """Whether the controller knows of it: not all is the plant's alone."""
        return any(node != 'plant' for node, _ in self.targets)

    def value(self, spec: Parameter, x: float, now: Any, n: int) -> Any:
        """
        Return what a parameter gets.

        Parameters
        ----------
        spec : Parameter
            One of the targets.
        x : float
            The number.
        now : object
            Value of the parameter so far.
        n : int
            Number of joints.

        """
        if self.factor:
            value: Any = tuple(x * y for y in now) if isinstance(now, tuple) else x * now
        else:
            value = (x,) * n if spec.shape else x
        return int(value) if spec.kind == 'int' and value == round(value) else value


@dataclasses.dataclass(frozen=True)
class Axis(Quantity):
    """A quantity with the values that a map has of it, ascending."""

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
        Ends of `uniform` and `log_uniform`; mean and standard deviation of `normal`; the values
        of `choice`, each as likely as the others.

    """

    distribution: str
    numbers: tuple[float, ...]

    @property
    def typical(self) -> tuple[float, ...]:
        """Values that must be allowed: the ends, the values, or the mean."""
        return self.numbers[:1] if self.distribution == 'normal' else self.numbers


def applied(setup: Setup, settings: Iterable[tuple[Quantity, float]], noise_seed: int | None = None
            ) -> Setup:
    """
    Return a setup with quantities set to numbers, one after the other.

    Parameters
    ----------
    setup : Setup
        Of the file, or of a law.
    settings : iterable of (Quantity, float)
        What is set.
    noise_seed : int, optional
        Of the plant, in place of that of the setup.

    Raises
    ------
    CtcError
        If a value is not allowed, or contradicts another.

    """
    values: dict[str, dict[str, Any]] = {node: {} for node in LOOP}
    for quantity, x in settings:
        for node, spec in quantity.targets:
            config = getattr(setup, node)
            now = values[node].get(spec.name, getattr(config, spec.field))
            values[node][spec.name] = quantity.value(spec, x, now, len(config.joint_names))
    if noise_seed is not None:
        values['plant']['noise_seed'] = noise_seed
    return setup.changed(values)


def read_axis(name: str, tree: object) -> Axis:
    """Return an axis of a spec; raise `ParameterError` that names the key."""
    key = f'axes.{name}'
    if not isinstance(tree, dict) or 'range' not in tree:
        values = mapping(key, tree, (*_OF_QUANTITY, 'values'))
        numbers = read_value(f'{key}.values', 'float[]', values.get('values'))
        if not numbers or any(a >= b for a, b in pairwise(numbers)):
            raise ParameterError(f'{key}.values', numbers, 'one number or more, ascending')
        return Axis(name, *_parameters(key, values), numbers)
    values = mapping(key, tree, (*_OF_QUANTITY, 'range', 'count', 'spacing'))
    spacing = read_value(f'{key}.spacing', 'str', values.get('spacing', 'linear'),
                         choices=('linear', 'log'))
    ends = _ends(f'{key}.range', values['range'], spacing == 'log')
    count = read_value(f'{key}.count', 'int', values.get('count'), minimum=2, maximum=MOST)
    space: Any = np.geomspace if spacing == 'log' else np.linspace
    return Axis(name, *_parameters(key, values), tuple(space(*ends, count).tolist()))


def read_uncertain(name: str, tree: object) -> Uncertain:
    """Return an uncertain quantity of a spec; raise `ParameterError` that names the key."""
    key = f'uncertain.{name}'
    values = mapping(key, tree, (*_OF_QUANTITY, *DISTRIBUTIONS))
    kind = _one_of(key, values, DISTRIBUTIONS)
    where, given = f'{key}.{kind}', values[kind]
    if kind in ('uniform', 'log_uniform'):
        numbers = _ends(where, given, kind == 'log_uniform')
    else:
        numbers = read_value(where, 'float[]', given)
        if kind == 'normal' and not (len(numbers) == 2 and numbers[-1] > 0.0):
            raise ParameterError(where, numbers, 'mean and standard deviation > 0')
        if not len(set(numbers)) == len(numbers) > 0:
            raise ParameterError(where, numbers, 'different numbers')
    return Uncertain(name, *_parameters(key, values), kind, numbers)


def read_value(key: str, kind: str, value: object, n: int = 0, **allowed: Any) -> Any:
    """Return a value of a spec, declared as a `Parameter` is."""
    return Parameter(key, kind, None, '', **allowed).checked(value, n)


def _one_of(key: str, values: Mapping[str, Any], names: Sequence[str]) -> str:
    """Return which one of some keys is given."""
    given = [name for name in names if name in values]
    if len(given) != 1:
        raise ParameterError(key, given, 'one of ' + ', '.join(names))
    return given[0]


def _ends(key: str, value: object, positive: bool) -> tuple[float, ...]:
    """Return two ends, ascending."""
    ends: tuple[float, ...] = read_value(key, 'float[]', value)
    if len(ends) != 2 or ends[0] >= ends[1] or (positive and ends[0] <= 0.0):
        raise ParameterError(key, ends, 'two numbers, ascending' + ', > 0' * positive)
    return ends


def check(quantities: Iterable[tuple[Quantity, tuple[float, ...]]], setup: Setup) -> None:
    """
    Check quantities alone and against each other.

    Parameters
    ----------
    quantities : iterable of (Quantity, tuple of float)
        In the order in which they are set, with values that must be allowed.
    setup : Setup
        Of the file.

    Raises
    ------
    CtcError
        For a value that is not allowed, or a parameter that is set again and not multiplied.

    """
    by: dict[tuple[str, str], str] = {}
    for quantity, numbers in quantities:
        for node, spec in quantity.targets:
            here = f'{node}.{spec.name}'
            other = by.setdefault((node, spec.name), quantity.name)
            if other != quantity.name and not quantity.factor:
                raise ParameterError(quantity.name, here, f'a factor, for {other} sets it, too')
        for x in numbers:
            with prefixed(f'{quantity.name} = {x:g}: '):
                applied(setup, [(quantity, x)])


def coarse_steps(values: Mapping[str, Any], axes: tuple[Axis, ...]) -> tuple[int, ...]:
    """Return every how many values of each axis are run first; all of an axis without range."""
    levels = read_value('refine', 'int', values.get('refine', 0), minimum=0, maximum=_LEVELS)
    steps = tuple(2 ** levels if 'range' in values['axes'][x.name] else 1 for x in axes)
    if levels and max(steps, default=1) == 1:
        raise ParameterError('refine', levels, '0, or an axis with a range')
    for axis, step in zip(axes, steps):
        if (len(axis.values) - 1) % step:
            raise ParameterError(f'axes.{axis.name}.count', len(axis.values),
                                 f'a multiple of {step} and 1 with refine {levels}')
    return steps


def _parameters(key: str, values: dict[str, Any]
                ) -> tuple[tuple[tuple[str, Parameter], ...], bool]:
    """Return the targets of a quantity, and whether it is a factor."""
    given = _one_of(key, values, ('parameter', 'parameters'))
    texts = values[given] if given == 'parameters' else [values[given]]
    texts = read_value(f'{key}.{given}', 'str[]', texts)
    found = tuple(target for text in texts for target in _targets(f'{key}.{given}', text))
    if not found or len(set(found)) < len(found):
        raise ParameterError(f'{key}.{given}', texts, 'one or more, each once')
    return found, read_value(f'{key}.factor', 'bool', values.get('factor', False))


def _targets(key: str, text: str) -> list[tuple[str, Parameter]]:
    """Return the nodes that have a parameter, and its declaration."""
    node, _, name = text.partition('.')
    nodes, name = ((node,), name) if node in LOOP else (LOOP, text)
    found = [(node, LOOP[node].parameters()[name]) for node in nodes
             if name in LOOP[node].parameters()]
    if not found or name in _SET or any(
            spec.kind not in ('int', 'float', 'float[]') for _, spec in found):
        raise ParameterError(
            key, text, f'a parameter of {", ".join(LOOP)} that is a number or a number a joint, '
            'such as plant.coulomb_friction; duration, seed and repeats of the spec set others')
    return found


#: Keys of a spec. `tune` is for `ctc tune`.
KEYS = ('params_file', 'duration', 'window', 'overrides', 'laws', 'axes', 'uncertain', 'sampling',
        'repeats', 'seed', 'failure', 'refine', 'tune')


@dataclasses.dataclass(frozen=True)
class Repeats(Config):
    """How often every point is run, and how what is uncertain is drawn."""

    sampling: str = parameter(
        'sobol', 'How `uncertain` is drawn.',
        choices=('random', 'latin_hypercube', 'sobol', 'saltelli'))
    repeats: int = parameter(1, 'Runs of every law at every point.', minimum=1, maximum=MOST)
    seed: int = parameter(
        0, 'Seed of the draws; noise_seed of the plant is seed + repeat.', maximum=2 ** 61)


@dataclasses.dataclass(frozen=True)
class Failure(Config):
    """What counts as a failure besides a run that diverges or is refused."""

    error_above: float = parameter(inf, 'RMS error of any joint in the window.', 'rad')
    error_share_above: float = parameter(
        inf, 'RMS error of any joint in the window, as a part of the amplitude of its motion.')
    saturated_above: float = parameter(
        1.0, 'Part of the samples in the window with a torque at its limit.', maximum=1.0)
    slips_above: float = parameter(inf, 'Stick-slips of any joint in a second of rest.', '1/s')
    not_reached: bool = parameter(
        False, 'Whether v that never stays within its band is a failure.')


#: Where a spec names no failure: an error of which `simulate` warns.
USUAL_FAILURE = Failure(error_share_above=WARN_ERROR_SHARE)


@dataclasses.dataclass(frozen=True)
class LawSettings:
    """
    A law with its settings.

    Attributes
    ----------
    name : str
        Shown, for example ``chattering sign``.
    law, switching : str
        At the start; the switching is empty for a law without.
    values : mapping
        Parameters of the controller in place of the file's, the law among them.
    recommended : bool
        Whether all others are what docs/laws.md recommends.

    """

    name: str
    law: str
    switching: str
    values: Mapping[str, Any]
    recommended: bool


@dataclasses.dataclass(frozen=True)
class MapSpec:
    """
    A checked spec.

    Attributes
    ----------
    name : str
        Of its file.
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
        Of each axis: every how many of its values are run first, a power of two; 1 for all.
    tree : mapping
        As it was given.

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
        """Return the number of values of each axis."""
        return tuple(len(axis.values) for axis in self.axes)

    @property
    def runs(self) -> int:
        """Return the number of runs."""
        return prod(self.shape) * len(self.variants) * self.repeats.repeats

    def under(self, candidates: Mapping[str, Mapping[str, Any]]) -> MapSpec:
        """Return the spec with candidates, parameters of the controller by name, as its laws."""
        configs = map(self.setup.controller.changed, candidates.values())
        return dataclasses.replace(self, variants=tuple(
            LawSettings(name, x.law, x.switching_in_force, values, False)
            for (name, values), x in zip(candidates.items(), configs)))


def read_spec(path: Path) -> MapSpec:
    """
    Read a spec, and the parameter file that it names.

    Raises
    ------
    CtcError
        Naming the file, the key, its value and what is allowed; before anything is run.

    """
    tree = read_yaml(path, FileKind.SPEC)
    with prefixed(f'{path}: '):
        return parse(tree, path)


def rows_of(tree: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the keys of a spec, and those below them, with their values as YAML on one line."""
    for key, value in tree.items():
        parts = value if isinstance(value, dict) else {'': value}
        for name, part in parts.items():
            yield f'{key} {name}'.rstrip(), yaml.safe_dump(
                part, default_flow_style=True, sort_keys=False, allow_unicode=True,
                width=float('inf')).removesuffix('...\n').rstrip()


def parse(tree: object, path: Path) -> MapSpec:
    """Return what a spec says; relative paths in it count from the directory of `path`."""
    values = mapping('spec', tree, KEYS)
    setup = _setup(values, path.parent)
    n = len(setup.controller.joint_names)
    taken = (*WHICH, *of_results(n))
    axes = _quantities(values, 'axes', read_axis, taken)
    uncertain = _quantities(values, 'uncertain', read_uncertain, (
        *taken, *(axis.name for axis in axes)))
    with prefixed('failure.'):
        failure = USUAL_FAILURE if 'failure' not in values else Failure.from_mapping(mapping(
            'failure', values['failure'], tuple(Failure.parameters())))
    spec = MapSpec(
        path.stem, setup, _window(values, setup.plant.duration), _variants(values, setup),
        axes, uncertain,
        Repeats.from_mapping({x: values[x] for x in Repeats.parameters() if x in values}),
        failure, coarse_steps(values, axes), values)
    parts, n = len(spec.uncertain) + 2, spec.repeats.repeats
    if spec.repeats.sampling == 'saltelli' and (
            spec.axes or len(spec.uncertain) < 2 or n % parts or (n // parts).bit_count() != 1):
        raise ParameterError('sampling', 'saltelli', (
            'without axes, for what is uncertain, two quantities or more, with repeats of '
            f'{parts} times a power of two'))
    if spec.runs > MOST:
        raise CtcError(f'{spec.runs} runs: {prod(spec.shape)} points, {len(spec.variants)} laws, '
                       f'{spec.repeats.repeats} repeats; allowed: {MOST}')
    check([*((axis, axis.values) for axis in axes), *((x, x.typical) for x in uncertain)], setup)
    return spec


def _setup(values: Mapping[str, Any], beside: Path) -> Setup:
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
        raise ParameterError('duration', 0.0, 'a number > 0, for every run must end')
    return setup


def _window(values: Mapping[str, Any], duration: float) -> tuple[float, float]:
    """Return the evaluated interval; the second half by default."""
    window = read_value('window', 'float[]', values.get('window', [0.5 * duration, duration]))
    if len(window) != 2 or not 0.0 <= window[0] < window[1] <= duration:
        raise ParameterError('window', window, f'two times, ascending, from 0 to {duration:g} s')
    return window[0], window[1]


def _quantities(values: Mapping[str, Any], key: str, read: Callable[[str, object], Any],
                taken: Container[str]) -> tuple[Any, ...]:
    """Return the axes, or what is uncertain; they have other names than those that are taken."""
    tree = values.get(key) or {}
    if not isinstance(tree, dict):
        raise ParameterError(key, tree, 'a mapping of names')
    for name in tree:
        if not (isinstance(name, str) and name.isidentifier()) or name in taken:
            raise ParameterError(key, name, 'a name of letters, digits and _ that is no column '
                                 'of the results, such as error, law or repeat')
    return tuple(read(name, x) for name, x in tree.items())


def _variants(values: Mapping[str, Any], setup: Setup) -> tuple[LawSettings, ...]:
    """Return the laws; that of the file by default."""
    items = values.get('laws', [setup.controller.law])
    if not isinstance(items, list) or not items:
        raise ParameterError('laws', items, 'a list of laws')
    found = tuple(read_law(f'laws[{i}]', item, setup) for i, item in enumerate(items))
    names = [variant.name for variant in found]
    if len(set(names)) < len(names):
        raise ParameterError('laws', names, 'different names: give each a name of its own')
    return found


def read_law(key: str, item: object, setup: Setup) -> LawSettings:
    """Return a law from text, such as ``chattering sign``, or a mapping."""
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
        made = setup.controller.changed(values)
        if recommended:
            made = recommended_setup(setup, made.law).controller.changed(values)
        if 'switching' in values and not made.takes('switching'):
            raise ParameterError('switching', values['switching'], f'none under law {made.law}')
    switching = made.switching_in_force
    words = (made.law, switching, 'recommended' if recommended else '')
    return LawSettings(name or ' '.join(filter(None, words)), made.law, switching, values,
                       recommended)

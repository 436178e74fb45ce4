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

"""The spec of a map: what is run, over which values, and what counts as a failure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
import dataclasses
from math import inf, prod
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.configuration.yaml_file import mapping, read_yaml
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.parameters import Config, Parameter, parameter
from ctc_chattering.robustness import columns
from ctc_chattering.robustness.quantity import (
    Axis,
    check,
    coarse_steps,
    MOST,
    read_axis,
    read_uncertain,
    Uncertain,
)
from ctc_chattering.studies.recommended import recommended_setup

Q = TypeVar('Q')
#: Keys of a spec. `tune` is for `ctc tune`.
KEYS = ('params_file', 'duration', 'window', 'overrides', 'laws', 'axes', 'uncertain', 'sampling',
        'repeats', 'seed', 'failure', 'refine', 'tune')


@dataclasses.dataclass(frozen=True)
class Repeats(Config):
    """How often every point is run, and how what is uncertain is drawn."""

    title: ClassVar[str] = 'repeats'

    sampling: str = parameter(
        'sampling', 'str', 'sobol', 'How `uncertain` is drawn.',
        choices=('random', 'latin_hypercube', 'sobol', 'saltelli'))
    repeats: int = parameter(
        'repeats', 'int', 1, 'Runs of every law at every point.', minimum=1, maximum=MOST)
    seed: int = parameter(
        'seed', 'int', 0, 'Seed of the draws; noise_seed of the plant is seed + repeat.',
        minimum=0, maximum=2 ** 61)


@dataclasses.dataclass(frozen=True)
class Failure(Config):
    """What counts as a failure besides a run that diverges or is refused."""

    title: ClassVar[str] = 'failure'

    error_above: float = parameter(
        'error_above', 'float', inf, 'RMS error of any joint in the window.', unit='rad',
        minimum=0.0, infinite=True)
    saturated_above: float = parameter(
        'saturated_above', 'float', 1.0,
        'Part of the samples in the window with a torque at its limit.', minimum=0.0, maximum=1.0)
    slips_above: float = parameter(
        'slips_above', 'float', inf, 'Stick-slips of any joint in a second of rest.', unit='1/s',
        minimum=0.0, infinite=True)
    steps_above: int = parameter(
        'steps_above', 'int', 1_000_000,
        'Steps of the integrator of a run, which then is not run.', minimum=1, maximum=10 ** 12)
    not_reached: bool = parameter(
        'not_reached', 'bool', False, 'Whether v that never stays within its band is a failure.')


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

    """

    name: str
    setup: Setup
    window: tuple[float, float]
    variants: tuple[LawSettings, ...]
    axes: tuple[Axis, ...]
    uncertain: tuple[Uncertain, ...]
    repeats: Repeats
    failure: Failure
    coarse: tuple[int, ...] = ()

    @property
    def refined(self) -> bool:
        """Return whether points are run near the boundary only."""
        return any(step > 1 for step in self.coarse)

    @property
    def shape(self) -> tuple[int, ...]:
        """Return the number of values of each axis."""
        return tuple(len(axis.values) for axis in self.axes)

    @property
    def runs(self) -> int:
        """Return the number of runs."""
        return prod(self.shape) * len(self.variants) * self.repeats.repeats


def read_spec(path: Path) -> MapSpec:
    """
    Read a spec, and the parameter file that it names.

    Raises
    ------
    CtcError
        Naming the file, the key, its value and what is allowed; before anything is run.

    """
    with errors_of(path):
        return parse(read_yaml(path), path)


@contextmanager
def errors_of(path: Path) -> Iterator[None]:
    """Put the path of a file in front of the errors that reading it raises."""
    try:
        yield
    except ParameterError as error:
        raise ParameterError(f'{path}: {error.name}', error.value, error.allowed) from None
    except RecursionError:
        raise CtcError(f'{path}: it contains itself') from None
    except CtcError as error:
        text = str(error)
        raise type(error)(text if text.startswith(str(path)) else f'{path}: {text}') from None


def parse(tree: object, path: Path) -> MapSpec:
    """Return what a spec says; relative paths in it count from the directory of `path`."""
    values = mapping('spec', tree, KEYS)
    setup = _setup(values, path.parent)
    n = len(setup.controller.joint_names)
    axes = _quantities(values, 'axes', read_axis, n)
    uncertain = _quantities(values, 'uncertain', read_uncertain, n)
    for quantity in uncertain:
        if quantity.name in [axis.name for axis in axes]:
            raise ParameterError('uncertain', quantity.name, 'a name that no axis has')
    spec = MapSpec(
        path.stem, setup, _window(values, setup.plant.duration), _variants(values, setup),
        axes, uncertain,
        Repeats.from_mapping({x: values[x] for x in Repeats.parameters() if x in values}),
        _failure(values.get('failure', {})), coarse_steps(values, axes))
    _check_saltelli(spec)
    if spec.runs > MOST:
        raise CtcError(f'{spec.runs} runs: {prod(spec.shape)} points, {len(spec.variants)} laws, '
                       f'{spec.repeats.repeats} repeats; allowed: {MOST}')
    check([*((axis, axis.values) for axis in axes), *((x, x.typical) for x in uncertain)], setup)
    return spec


def _setup(values: Mapping[str, Any], beside: Path) -> Setup:
    """Return the parameter file with the spec's overrides."""
    name = Parameter('params_file', 'str', '', '').coerce(values.get('params_file', 'friction'))
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
    given = values.get('window', [0.5 * duration, duration])
    window = Parameter('window', 'float[]', (), '').coerce(given)
    if len(window) != 2 or not 0.0 <= window[0] < window[1] <= duration:
        raise ParameterError('window', given, f'two times, ascending, from 0 to {duration:g} s')
    return window[0], window[1]


def _quantities(values: Mapping[str, Any], key: str, read: Callable[[str, object], Q], n: int
                ) -> tuple[Q, ...]:
    """Return the axes, or what is uncertain, of a robot of `n` joints."""
    tree = values.get(key) or {}
    if not isinstance(tree, dict):
        raise ParameterError(key, tree, 'a mapping of names')
    taken = columns.of_map((), n)
    for name in tree:
        if not (isinstance(name, str) and name.isidentifier()) or name in taken:
            raise ParameterError(key, name, 'a name of letters, digits and _ that is no column '
                                 'of the results, such as error, law or repeat')
    return tuple(read(name, x) for name, x in tree.items())


def _check_saltelli(spec: MapSpec) -> None:
    """Check what Sobol indices need: no axis, and two draws and one for each that is uncertain."""
    if spec.repeats.sampling != 'saltelli':
        return
    parts = len(spec.uncertain) + 2
    if spec.axes or not spec.uncertain:
        raise ParameterError('sampling', 'saltelli', 'uncertain and no axes')
    n = spec.repeats.repeats // parts
    if n * parts != spec.repeats.repeats or n & (n - 1):
        raise ParameterError('repeats', spec.repeats.repeats, (
            f'{parts} times a power of two with saltelli, for example {256 * parts}'))


def _failure(tree: object) -> Failure:
    values = mapping('failure', tree, tuple(Failure.parameters()))
    try:
        return Failure.from_mapping(values)
    except ParameterError as error:
        raise ParameterError(f'failure.{error.name}', error.value, error.allowed) from None


def _variants(values: Mapping[str, Any], setup: Setup) -> tuple[LawSettings, ...]:
    """Return the laws; that of the file by default."""
    items = values.get('laws', [setup.controller.law])
    if not isinstance(items, list) or not items:
        raise ParameterError('laws', items, 'a list of laws')
    found = tuple(_variant(f'laws[{i}]', item, setup) for i, item in enumerate(items))
    names = [variant.name for variant in found]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise ParameterError(f'laws[{i}]', name, 'a name that no other has: give it one')
    return found


def _variant(key: str, item: object, setup: Setup) -> LawSettings:
    """Return a law from text, such as ``chattering sign``, or a mapping."""
    values: dict[str, Any] = {'law': setup.controller.law}
    if isinstance(item, str) and 0 < len(item.split()) <= 2:
        values.update(zip(('law', 'switching'), item.split()))
    elif isinstance(item, dict):
        values.update(item)
    else:
        raise ParameterError(key, item, 'a law, a law and a switching, or a mapping of '
                             'parameters of the controller, name and recommended')
    name = Parameter(f'{key}.name', 'str', '', '').coerce(values.pop('name', ''))
    recommended = Parameter(f'{key}.recommended', 'bool', False, '').coerce(
        values.pop('recommended', False))
    try:
        made = setup.controller.changed(values)
        if recommended:
            made = recommended_setup(setup, made.law).controller.changed(values)
        if 'switching' in values and not made.takes('switching'):
            raise ParameterError('switching', values['switching'], f'none under law {made.law}')
    except ParameterError as error:
        raise ParameterError(f'{key}.{error.name}', error.value, error.allowed) from None
    switching = made.switching_in_force
    words = (made.law, switching, 'recommended' if recommended else '')
    return LawSettings(name or ' '.join(filter(None, words)), made.law, switching, values,
                       recommended)

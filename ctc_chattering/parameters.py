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
Declarations of parameters.

Type, unit, default, range and description of a parameter are in one place. A configuration is a
frozen dataclass derived from `Config`. Its fields are made by `parameter`. YAML files, ROS nodes,
`ctc` and the tables of the documentation are served from these fields. The checks at the end are
for arguments of functions.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import copy
import dataclasses
from functools import cached_property
import importlib
import inspect
import math
import re
from typing import Any, ClassVar, TypeVar
import warnings

from ctc_chattering.errors import as_ctc_error, CtcError, ParameterError, suggest
import numpy as np
import numpy.typing as npt

C = TypeVar('C', bound='Config')
#: Annotation of a parameter with a number per joint.
PerJoint = tuple[float, ...]
#: Annotation of a parameter with strings.
Strings = tuple[str, ...]

#: Least magnitude of a number that must not be 0. Less is refused like 0.
LEAST = 1e-9
#: Largest magnitude of a finite number. Products of larger ones leave the range of floats.
LARGEST = 1e9
#: Largest magnitude of an integer, which a parameter of ROS holds.
_LARGEST_INTEGER = 2 ** 62
#: Name of a class of the user's: ``package.module:Name``.
OWN_CLASS = re.compile(r'[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*')
#: Kind by annotation, where the annotation is not itself a kind.
_KINDS = {'PerJoint': 'float[]', 'Strings': 'str[]'}
#: Shapes that annotations imply.
_SHAPES = {'PerJoint': 'n'}
#: Kinds that have a range.
_NUMBERS = ('float', 'float[]', 'int')
_TYPE_NAMES = {
    'bool': 'a boolean', 'int': 'an integer', 'float': 'a number', 'str': 'a string',
    'float[]': 'a list of numbers', 'str[]': 'a list of strings'}
#: Type of a scalar of each kind, and the types that become one. A boolean is no number.
_SCALARS: dict[str, tuple[Any, Any]] = {
    'bool': (bool, bool), 'int': (int, (int, np.integer)),
    'float': (float, (int, float, np.integer, np.floating)), 'str': (str, str)}


@dataclasses.dataclass(frozen=True)
class Parameter:
    """
    Declaration of one parameter: type, range, unit and documentation.

    Attributes
    ----------
    name : str
        As in the YAML file, for example ``disturbance.amplitude``.
    kind : {'bool', 'int', 'float', 'str', 'float[]', 'str[]'}
        Its type.
    default : object
        A scalar for a ``float[]`` is the value of every joint. Several numbers are the values of
        that many joints, and other numbers of joints have the default 0.
    description, unit : str
        For `ros2 param describe` and the documentation.
    minimum, maximum : float
        Range of the value, or of each element. Numbers are within ±`LARGEST` in any case, and
        `LEAST` is the minimum of a number that must not be 0.
    infinite : bool
        True if infinity is a value.
    choices : tuple of str
        The only strings allowed. Empty for any.
    custom : bool
        True if a class of the user's is also allowed, itself or as ``package.module:Name``.
    shape : {'', 'n', 'nn'}
        Size of a list: any, one per joint, or n or n·n numbers, which are a symmetric positive
        definite matrix row by row.
    read_only : bool
        True if it is fixed once the node runs.
    laws : tuple of str
        Control laws that take it. Empty for all laws, and for what has no law.
    usual : (float, float)
        Range of a slider.

    """

    name: str
    kind: str
    default: Any
    description: str
    unit: str = ''
    minimum: float = -math.inf
    maximum: float = math.inf
    infinite: bool = False
    choices: tuple[str, ...] = ()
    custom: bool = False
    shape: str = ''
    read_only: bool = False
    laws: tuple[str, ...] = ()
    usual: tuple[float, float] = (0.0, 0.0)

    @cached_property
    def field(self) -> str:
        """Name in the dataclass."""
        # `lambda` is a keyword, and a dot is no identifier.
        return 'lambda_' if self.name == 'lambda' else self.name.replace('.', '_')

    @property
    def meaning(self) -> str:
        """Return the description, and the laws that take it."""
        return self.description + (f' Law {", ".join(self.laws)}.' if self.laws else '')

    @property
    def allowed(self) -> str:
        """Return in words the values that are allowed."""
        if self.choices:
            choices = [choice or "''" for choice in self.choices]
            return ' | '.join([*choices, 'package.module:Name'] if self.custom else choices)
        text = _TYPE_NAMES[self.kind]
        if self.kind in _NUMBERS:
            low, high = self.bounds
            text = text if self.infinite else text.replace('number', 'finite number')
            text += f' >= {low:g} and <= {high:g}{", or inf" if self.infinite else ""}'
        if self.shape == 'nn':
            text += ', one for all, one per joint or n*n row by row, symmetric positive definite'
        elif self.shape == 'n':
            text += ', one for all or one per joint'
        return text

    @property
    def facts(self) -> str:
        """Return unit, range and number of values for the help of an option."""
        if self.choices:
            return self.allowed
        facts = [unit_text(self.unit)]
        if self.minimum == LEAST:
            facts.append('above 0')
        elif math.isfinite(self.minimum):
            facts.append(f'at least {self.minimum:g}')
        if math.isfinite(self.maximum):
            facts.append(f'at most {self.maximum:g}')
        if self.infinite:
            facts.append('or .inf')
        if self.shape == 'n':
            facts.append('one value or one per joint')
        return ', '.join(filter(None, facts))

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and largest finite value."""
        largest = _LARGEST_INTEGER if self.kind == 'int' else LARGEST
        return max(self.minimum, -largest), min(self.maximum, largest)

    def default_for(self, n: int) -> Any:
        """Return the default for `n` joints."""
        if self.kind != 'float[]':
            return self.default
        if not isinstance(self.default, tuple):
            return (float(self.default),) * n
        return self.default if n == len(self.default) else (0.0,) * n

    def coerce(self, value: object, n: int = 0) -> Any:
        """
        Return `value` as this parameter's Python type.

        Integers become floats where floats are due.

        Parameters
        ----------
        value : object
            Value of any type.
        n : int
            Number of joints. One number, in a list or not, is that of each joint. With 0 the
            number of joints is not known, and a number in no list is refused.

        Raises
        ------
        ParameterError
            If the type does not fit.

        """
        if not self.kind.endswith('[]'):
            return self._scalar(value, value)
        per_joint = self.kind == 'float[]' and self.shape in ('n', 'nn') and n > 0
        if isinstance(value, np.ndarray) and value.ndim == 1:
            value = tuple(value)
        if isinstance(value, (list, tuple, array)):
            items = tuple(self._scalar(item, value) for item in value)
            return items * n if per_joint and len(items) == 1 else items
        if per_joint:
            return (self._scalar(value, value),) * n
        raise ParameterError(self.name, value, self.allowed)

    def _scalar(self, item: object, value: object) -> Any:
        """Return an item of a value, coerced."""
        if self.custom and isinstance(item, type):
            return f'{item.__module__}:{item.__qualname__}'
        make, accepted = _SCALARS[self.kind.removesuffix('[]')]
        if isinstance(item, accepted) and (make is bool or not isinstance(item, bool)):
            with suppress(OverflowError):
                return make(item)
        hint = ''
        if isinstance(item, str) and make in (int, float):
            number = yaml_number(item)
            if number and (make is float or number.lstrip('+-').isdecimal()):
                hint = f'; write {number}, because YAML reads {item!r} as text'
        raise ParameterError(self.name, value, self.allowed + hint)

    def checked(self, value: object, n: int = 0) -> Any:
        """Return `value` as `coerce` does, if `check` allows it."""
        coerced = self.coerce(value, n)
        self.check(coerced, n)
        return coerced

    def check(self, value: Any, n: int) -> None:
        """Raise `ParameterError` unless `n` joints may have this value."""
        items = value if isinstance(value, tuple) else (value,)
        sizes = {'n': [n], 'nn': [n, n * n]}.get(self.shape)
        if sizes is not None and len(items) not in sizes:
            raise ParameterError(
                self.name, value, f'{self.allowed} (n = {n}, got {len(items)} values)')
        full = self.shape == 'nn' and len(items) != n
        if not all(self._allows(item, full) for item in items) or (
                full and not _positive_definite(matrix(items, n))):
            raise ParameterError(self.name, value, self.allowed + suggest(value, self.choices))

    def _allows(self, item: Any, full: bool) -> bool:
        """Return whether an item is allowed."""
        if self.choices:
            return item in self.choices or (
                self.custom and OWN_CLASS.fullmatch(item) is not None)
        if self.kind not in _NUMBERS:
            return True
        if self.infinite and item == math.inf:
            return True
        low, high = self.bounds
        return bool((-high if full else low) <= item <= high)


#: A number as people write it: mantissa, and sign and digits of the exponent.
_NUMBER = re.compile(r'([-+]?(?:\d+\.?\d*|\.\d+))(?:[eE]([-+]?)(\d+))?')


def yaml_number(text: str) -> str:
    """
    Return the number in a text as YAML needs it.

    To YAML, and to `ros2 param set`, 1e-9 is text and 1.0e-9 a number. Other text gives nothing.
    """
    text = text.strip()
    if text.lstrip('+-.').lower() in ('inf', 'infinity'):
        return '-.inf' if text.startswith('-') else '.inf'
    match = _NUMBER.fullmatch(text)
    if match is None:
        return ''
    mantissa, sign, exponent = match.groups()
    if exponent is None:
        return mantissa
    return f'{mantissa}{"" if "." in mantissa else ".0"}e{sign or "+"}{exponent}'


def _positive_definite(a: npt.NDArray[np.float64]) -> bool:
    if not np.allclose(a, a.T, rtol=1e-12, atol=0.0):
        return False
    return bool(np.linalg.eigvalsh(a).min() > 0.0)


def matrix(values: tuple[float, ...], n: int) -> npt.NDArray[np.float64]:
    """Return n numbers as a diagonal, or n·n as rows."""
    return np.reshape(values, (n, n)) if len(values) == n * n else np.diag(values)


def parameter(default: Any, description: str, unit: str = '', **attributes: Any) -> Any:
    """
    Return a dataclass field that declares one parameter.

    Parameters
    ----------
    default, description, unit
        As in `Parameter`.
    **attributes
        Other attributes of `Parameter`. By default the name is that of the field, and the kind
        that of its annotation. Unlike in `Parameter`, the minimum is 0 unless given. Infinity is a
        value if it is the default. A list of numbers has one per joint.

    """
    return dataclasses.field(default=None, metadata={
        'default': default, 'description': description, 'unit': unit, 'minimum': 0.0,
        'infinite': default == math.inf, **attributes})


@dataclasses.dataclass(frozen=True)
class Config:
    """
    Base of the configurations.

    Fields left out take their defaults, and all are checked. `joint_names`, where there is such a
    parameter, comes first: it gives the number of joints.

    Raises
    ------
    ParameterError
        On construction, for the first value that is not allowed.

    """

    _declared: ClassVar[dict[str, Parameter]] = {}

    def __init_subclass__(cls) -> None:
        """Collect the declarations, inherited ones first, and document them."""
        specs: list[Parameter] = []
        for base in cls.__bases__[::-1]:
            specs += vars(base)['_declared'].values()
        for name, field in vars(cls).items():
            if isinstance(field, dataclasses.Field):
                # A string, by the import of annotations from __future__.
                annotation = cls.__annotations__[name]
                defaults = {'name': name, 'kind': _KINDS.get(annotation, annotation),
                            'shape': _SHAPES.get(annotation, '')}
                specs.append(Parameter(**{**defaults, **field.metadata}))
        cls._declared = {spec.name: spec for spec in specs}
        text = inspect.cleandoc(cls.__doc__ or '')
        entries = [f'{spec.field} : {spec.kind}\n    {spec.meaning}' for spec in specs]
        cls.__doc__ = '\n'.join([text, '', 'Parameters', '----------', *entries])

    def __post_init__(self) -> None:
        """Fill in defaults, coerce types and check every value."""
        n = 0
        for spec in self.parameters().values():
            value = getattr(self, spec.field)
            value = spec.checked(spec.default_for(n) if value is None else value, n)
            object.__setattr__(self, spec.field, value)
            if spec.name == 'joint_names':
                check_joint_names(value)
                n = len(value)
        self.validate()

    def validate(self) -> None:
        """Check several parameters together. Subclasses override this."""

    @classmethod
    def parameters(cls) -> dict[str, Parameter]:
        """Return the declared parameters by name, in order."""
        return cls._declared

    @classmethod
    def from_mapping(cls: type[C], values: Mapping[str, object]) -> C:
        """
        Build the configuration from parameter names and values.

        Raises
        ------
        ParameterError
            For an unknown name or a value that is not allowed.

        """
        return cls(**{spec.field: value for spec, value in cls._declarations(values)})

    @classmethod
    def _declarations(cls, values: Mapping[str, object]) -> Iterator[tuple[Parameter, object]]:
        """Yield declarations and values, if all names are known."""
        names = cls.parameters()
        for name, value in values.items():
            if name not in names:
                raise ParameterError(
                    name, value, f'one of {", ".join(names)}{suggest(name, names)}')
            if value is None:
                raise ParameterError(name, value, names[name].allowed)
            yield names[name], value

    @classmethod
    def received(cls: type[C], values: Mapping[str, object],
                 classes: Mapping[str, object] | None = None) -> C:
        """
        Build the configuration from untrusted values.

        They are from a bag or from another process, and may not name code.

        Parameters
        ----------
        values : mapping
            Parameter names and values.
        classes : mapping, optional
            Classes from the user that replace those which the values name, by parameter.

        Raises
        ------
        ParameterError
            As `from_mapping` raises it.
        CtcError
            For the name of a class that the user does not replace.

        """
        values = dict(values)
        classes = classes or {}
        for name, spec in cls.parameters().items():
            value = values.get(name)
            if spec.custom and isinstance(value, str) and value not in spec.choices:
                if name not in classes:
                    raise CtcError(
                        f'{name}: {value[:80]!r} is not imported, because recorded and received '
                        f'values may not name code; give --{name} package.module:Name, or in '
                        f"Python {name}='package.module:Name'")
                values[name] = classes[name]
        return cls.from_mapping(values)

    def as_mapping(self) -> dict[str, Any]:
        """Return every parameter's value by name."""
        return {name: getattr(self, spec.field) for name, spec in self.parameters().items()}

    def changed(self: C, values: Mapping[str, object]) -> C:
        """Return a checked copy with other values of some parameters."""
        if 'joint_names' in values:  # The number of joints concerns all other parameters.
            return self.from_mapping({**self.as_mapping(), **values})
        config = copy(self)
        n = len(getattr(self, 'joint_names', ()))
        for spec, value in self._declarations(values):
            object.__setattr__(config, spec.field, spec.checked(value, n))
        config.validate()
        return config


def named_class(role: str, name: str, fits: Callable[[type], bool], expected: str) -> Any:
    """
    Import the class ``package.module:Name`` that a user has named.

    This is the one place that runs code which a value names. `Config.received` admits no other
    name.

    Parameters
    ----------
    role : str
        Purpose of the class, for errors, for example ``model``.
    name : str
        Name of the class.
    fits : callable
        Returns whether a class is as expected.
    expected : str
        Class that is expected, for errors.

    Raises
    ------
    CtcError
        If there is no such class, or it does not fit. Nothing of it has been called then.

    """
    module, _, attribute = name.partition(':')
    with as_ctc_error(f'the {role} {name} cannot be imported'):
        result = getattr(importlib.import_module(module), attribute)
    if not (isinstance(result, type) and fits(result)):
        raise CtcError(f'the {role} {name} is not a {expected}')
    return result


def accept_old_name(kind: type, old: str, new: str) -> None:
    """Let a class of the user's have a method by its old name, with a warning."""
    if not hasattr(kind, new) and hasattr(kind, old):
        warnings.warn(f'{kind.__name__}.{old} is deprecated. Call it {new}.', FutureWarning,
                      stacklevel=3)
        setattr(kind, new, getattr(kind, old))


def unit_text(unit: str) -> str:
    """Return a unit as pages show it: N·m for ``N*m``."""
    return unit.replace('*', '·').replace('^2', '²').replace('^3', '³')


def check_joint_names(names: tuple[str, ...]) -> None:
    """Raise `ParameterError` unless names are different and not empty."""
    if not names or len(set(names)) != len(names) or not all(names):
        raise ParameterError('joint_names', names, 'one or more names, all different, none empty')


def check_not_empty(name: str, values: Sequence[object]) -> None:
    """Raise `ParameterError` for an empty sequence."""
    if not values:
        raise ParameterError(name, values, 'one or more')


def checked_integer(name: str, value: object, minimum: float = -math.inf) -> int:
    """Return a whole number, or raise `ParameterError`."""
    return int(Parameter(name, 'int', None, '', minimum=minimum).checked(value))


def checked_vector(name: str, values: Any, n: int) -> npt.NDArray[np.float64]:
    """Return `n` numbers as an array, or raise `ParameterError`."""
    with suppress(TypeError, ValueError, OverflowError):
        result = np.array(values, float)
        if result.shape == (n,):
            return result
    raise ParameterError(name, values, f'{n} numbers')

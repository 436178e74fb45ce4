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
Models by name, and the parameters that describe one.

The configurations of plant, controller and reference derive from `DescribedConfig` and
`RobotConfig`. `model_of` makes the model of one.

A model of your own is a class derived from `Model`, in a module that Python finds. The parameter
names it ``package.module:Name``. It is called as ``Name(joint_names, gravity)``, with a tuple of
names and [m/s²], and its attribute ``n`` must be the number of names. `check_dynamics`, or
``ctc check-model --model package.module:Name``, tests it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from functools import lru_cache
from threading import get_ident

from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.errors import as_ctc_error, CtcError, ParameterError
from ctc_chattering.numerics.time_grid import period_ns
from ctc_chattering.parameters import Config, LEAST, named_class, parameter, PerJoint, Strings

#: Values of the parameter ``model``, besides classes.
MODELS = ('two_link', 'urdf')
#: Value of the parameter ``continuous_joints`` that stands for those of the robot's description.
DESCRIBED = 'described'


@dataclasses.dataclass(frozen=True)
class DescribedConfig(Config):
    """Joints and robot description of all loop nodes."""

    joint_names: Strings = parameter(
        ('joint1', 'joint2'),
        'Joints in the order of gains and torques.',
        read_only=True,
    )
    model: str = parameter(
        'two_link',
        'Robot model, or a model of your own (docs/robots.md).',
        choices=MODELS,
        custom=True,
        read_only=True,
    )
    description: str = parameter(
        '',
        'File of the robot for model urdf, a path or package://NAME/PATH; empty for the topic '
        'robot_description.',
        read_only=True,
    )
    continuous_joints: Strings = parameter(
        (DESCRIBED,),
        'Joints that turn endlessly, so that positions count modulo 2 pi; described for the '
        'continuous joints of the description or model.',
        read_only=True,
    )
    control_period: float = parameter(
        1e-3, 'Sample period h.', 's', minimum=LEAST, maximum=10.0, read_only=True
    )

    def validate(self) -> None:
        """Check the period and the names of continuous joints."""
        period_ns(self.control_period)
        unknown = set(self.continuous_joints) - {DESCRIBED, '', *self.joint_names}
        if unknown:
            raise ParameterError(
                'continuous_joints',
                self.continuous_joints,
                (f'{DESCRIBED}, or some of {", ".join(self.joint_names)}'),
            )

    @property
    def described(self) -> bool:
        """Return whether a description of the robot is needed."""
        return self.model == 'urdf'

    def which_are_continuous(self, described: Sequence[bool] = ()) -> tuple[bool, ...]:
        """
        Return True for joints that turn endlessly, shape (n,).

        Parameters
        ----------
        described : sequence of bool, shape (n,)
            The same of the description or `Model.continuous`. Empty for none.

        """
        if DESCRIBED not in self.continuous_joints or not described:
            described = (False,) * len(self.joint_names)
        return tuple(
            is_described or name in self.continuous_joints
            for name, is_described in zip(self.joint_names, described)
        )


@dataclasses.dataclass(frozen=True)
class RobotConfig(DescribedConfig):
    """Joints and model of plant and controller."""

    locked: Strings = parameter(
        ('',),
        'Positions of joints that are not in joint_names, each "name position". Other such '
        'joints stand at 0.',
        read_only=True,
    )
    gravity: float = parameter(
        9.81, 'Acceleration of gravity in G.', 'm/s^2', read_only=True
    )
    rotor_inertia: PerJoint = parameter(
        0.0,
        'Inertia of the rotors at the joints for model urdf, including the squared gear ratio; 0 '
        'for the inertia in the description.',
        'kg*m^2',
        read_only=True,
    )
    compiled: bool = parameter(
        True,
        'Use the machine code of `ctc compile` where it is available.',
        read_only=True,
    )

    def validate(self) -> None:
        """Check period, model and locked joints."""
        super().validate()
        check_model(self.model, self.joint_names)
        locked_positions(self.locked)
        if any(self.rotor_inertia) and not self.described:
            raise ParameterError(
                'rotor_inertia',
                self.rotor_inertia,
                '0 without a description of the robot',
            )


#: Models that `model_of` keeps, of all threads.
_CACHE_SIZE = 64


def make_model(
    name: str,
    gravity: float,
    joint_names: tuple[str, ...] = ('joint1', 'joint2'),
    urdf: str = '',
    locked: Mapping[str, float] | None = None,
    rotors: Sequence[float] = (),
) -> Model:
    """
    Return the model of a name.

    Parameters
    ----------
    name : str
        One of `MODELS`, or ``package.module:Name``.
    gravity : float
        Acceleration of gravity [m/s²].
    joint_names : tuple of str
        Joints of the model, in order.
    urdf : str
        Model ``urdf``: the text of the URDF.
    locked : mapping of str to float, optional
        Model ``urdf``: positions of joints that are not in `joint_names`. The default is 0.
    rotors : sequence of float, length n
        Model ``urdf``: inertias of the rotors at the joints [kg·m²], 0 for those of the URDF.
        Empty for all of the URDF.

    Raises
    ------
    CtcError
        If there is no such model, or not for these joints.

    """
    check_model(name, joint_names)
    if name == 'two_link':
        return TwoLink(gravity)
    if name == 'urdf':
        if not urdf.strip():
            raise CtcError(
                'model urdf needs the parameter description, or the topic robot_description'
            )
        from ctc_chattering.dynamics.urdf_model import UrdfModel

        with as_ctc_error('URDF: there is no model of it'):
            return UrdfModel(urdf, joint_names, gravity, locked, rotors)
    return _model_of_user(name, joint_names, gravity)


def model_of(config: RobotConfig, description: str = '') -> Model:
    """
    Return the model that a configuration names.

    A thread always gets the same object for the same robot, as a model is for one thread. A class
    of the user is called anew, as it may have changed.

    Parameters
    ----------
    config : RobotConfig
        Name, joints and the numbers of the model.
    description : str
        Text of a URDF.

    """
    make = _cached_model if config.model in MODELS else _cached_model.__wrapped__
    return make(
        config.model,
        config.gravity,
        config.joint_names,
        description,
        config.locked,
        config.rotor_inertia,
        get_ident(),
    )


@lru_cache(_CACHE_SIZE)
def _cached_model(
    name: str,
    gravity: float,
    joint_names: tuple[str, ...],
    description: str,
    locked: tuple[str, ...],
    rotors: tuple[float, ...],
    _thread: int,
) -> Model:
    return make_model(
        name, gravity, joint_names, description, locked_positions(locked), rotors
    )


def locked_positions(lines: Sequence[str]) -> dict[str, float]:
    """
    Return positions of lines "name position" [rad or m].

    Raises
    ------
    ParameterError
        If a line is not of this form.

    """
    result = {}
    for line in filter(None, lines):
        try:
            name, position = line.split()
            result[name] = float(position)
        except ValueError:
            raise ParameterError('locked', line, '"name position"') from None
    return result


def check_model(name: str, joint_names: tuple[str, ...]) -> None:
    """Raise `ParameterError` unless the name fits the joints."""
    RobotConfig.parameters()['model'].check(name, 0)
    if name == 'two_link' and len(joint_names) != TwoLink.n:
        raise ParameterError(
            'joint_names', joint_names, f'{TwoLink.n} names for model {name}'
        )


def _model_of_user(name: str, joint_names: tuple[str, ...], gravity: float) -> Model:
    """Return an instance of a user's class."""
    model_class = named_class(
        'model',
        name,
        lambda x: issubclass(x, Model),
        'class derived from ctc_chattering.Model',
    )
    with as_ctc_error(f'the model {name} cannot be constructed'):
        model: Model = model_class(joint_names, gravity)
    count = getattr(model, 'n', 'no')
    if count != len(joint_names):
        raise ParameterError(
            'joint_names', joint_names, f'{count} names for model {name}'
        )
    return model

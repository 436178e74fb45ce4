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
The models that the parameter ``model`` can name, and the parameters that describe one.

A model of your own is a class derived from `Model`, in a module that Python finds. The parameter
names it ``package.module:Name``; it is made as ``Name(joint_names, gravity)``, with a tuple of
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
from ctc_chattering.parameters import Config, LEAST, named_class, parameter

#: Values of the parameter ``model``, besides classes.
MODELS = ('two_link', 'urdf')
#: Value of the parameter ``continuous_joints`` that stands for those of the robot's description.
DESCRIBED = 'described'


@dataclasses.dataclass(frozen=True)
class DescribedConfig(Config):
    """Joints, and the description of the robot; what the configurations of all loop nodes have."""

    joint_names: tuple[str, ...] = parameter(
        ('joint1', 'joint2'), 'Joints, in the order of gains and torques.', read_only=True)
    model: str = parameter(
        'two_link', 'Robot model, or your own: docs/robots.md.', choices=MODELS, custom=True,
        read_only=True)
    description: str = parameter(
        '', 'Model urdf: file of the robot, a path or package://NAME/PATH; empty for the topic '
        'robot_description.', read_only=True)
    continuous_joints: tuple[str, ...] = parameter(
        (DESCRIBED,), 'Joints that turn endlessly, whose positions count modulo 2 pi; described: '
        'those that the description, or the model, says.', read_only=True)
    control_period: float = parameter(
        1e-3, 'Sample period h.', 's', minimum=LEAST, maximum=10.0, read_only=True)

    def validate(self) -> None:
        """Check the period, and that continuous joints are joints."""
        period_ns(self.control_period)
        unknown = set(self.continuous_joints) - {DESCRIBED, '', *self.joint_names}
        if unknown:
            raise ParameterError('continuous_joints', self.continuous_joints, (
                f'{DESCRIBED}, or some of {", ".join(self.joint_names)}'))

    @property
    def described(self) -> bool:
        """Whether a description of the robot is needed."""
        return self.model == 'urdf'

    def which_are_continuous(self, described: Sequence[bool] = ()) -> tuple[bool, ...]:
        """
        Return which joints turn endlessly, shape (n,).

        Parameters
        ----------
        described : sequence of bool, shape (n,)
            Those of the robot's description, or `Model.continuous`; empty for none.

        """
        known = described if DESCRIBED in self.continuous_joints and described else (
            (False,) * len(self.joint_names))
        return tuple(x or name in self.continuous_joints
                     for name, x in zip(self.joint_names, known))


@dataclasses.dataclass(frozen=True)
class RobotConfig(DescribedConfig):
    """Joints and model; the base of the configurations that have a model."""

    locked: tuple[str, ...] = parameter(
        ('',), 'Positions of joints not in joint_names, each "name position"; default 0.',
        read_only=True)
    gravity: float = parameter(9.81, 'Acceleration of gravity in G.', 'm/s^2', read_only=True)
    rotor_inertia: tuple[float, ...] = parameter(
        0.0, 'Model urdf: inertia of the rotors at the joints, gear ratios squared included; 0 '
        'for that of the description.', 'kg*m^2', read_only=True)
    compiled: bool = parameter(
        True, 'Use the machine code of `ctc compile` where it is available.', read_only=True)

    def validate(self) -> None:
        """Check the period, the model's number of joints and the locked joints."""
        super().validate()
        check_model(self.model, self.joint_names)
        locked_positions(self.locked)
        if any(self.rotor_inertia) and not self.described:
            raise ParameterError('rotor_inertia', self.rotor_inertia,
                                 '0 without a description of the robot')


#: Models that are kept.
_KEPT = 64


def make_model(name: str, gravity: float, joint_names: tuple[str, ...] = ('joint1', 'joint2'),
               urdf: str = '', locked: Mapping[str, float] | None = None,
               rotors: Sequence[float] = ()) -> Model:
    """
    Return a model.

    Parameters
    ----------
    name : str
        One of `MODELS`, or ``package.module:Name``, which the user has given.
    gravity : float
        Acceleration of gravity [m/s²].
    joint_names : tuple of str
        Joints of the model, in order.
    urdf : str
        Model ``urdf``: the text of the URDF.
    locked : mapping of str to float, optional
        Model ``urdf``: positions of joints that are not in `joint_names`; 0 for those left out.
    rotors : sequence of float, length n
        Model ``urdf``: inertias of the rotors at the joints [kg·m²], 0 for those of the URDF;
        empty for all of the URDF.

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
            raise CtcError('model urdf needs the parameter description, or the topic '
                           'robot_description')
        from ctc_chattering.dynamics.urdf_model import UrdfModel
        with as_ctc_error('URDF: there is no model of it'):
            return UrdfModel(urdf, joint_names, gravity, locked, rotors)
    return _own(name, joint_names, gravity)


def model_of(config: RobotConfig, description: str = '') -> Model:
    """
    Return the model that a configuration names; `description` is the text of a URDF.

    It is the same one for the same robot, and every thread has its own; a class of yours is made
    anew, for it may have changed.
    """
    make = _kept if config.model in MODELS else _made
    return make(config.model, config.gravity, config.joint_names, description, config.locked,
                config.rotor_inertia, get_ident())


def _made(name: str, gravity: float, joint_names: tuple[str, ...], description: str,
          locked: tuple[str, ...], rotors: tuple[float, ...], _thread: int) -> Model:
    return make_model(name, gravity, joint_names, description, locked_positions(locked), rotors)


_kept = lru_cache(_KEPT)(_made)


def locked_positions(lines: Sequence[str]) -> dict[str, float]:
    """
    Return joints and positions [rad or m] from lines "name position".

    Raises
    ------
    ParameterError
        For a line that is not of this form.

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
    """Raise `ParameterError` unless `name` may be a model, for as many joints as are named."""
    RobotConfig.parameters()['model'].check(name, 0)
    if name == 'two_link' and len(joint_names) != TwoLink.n:
        raise ParameterError('joint_names', joint_names, f'{TwoLink.n} names for model {name}')


def _own(name: str, joint_names: tuple[str, ...], gravity: float) -> Model:
    """Return an instance of a class of the user's."""
    own = named_class('model', name, lambda x: issubclass(x, Model),
                      'class derived from ctc_chattering.Model')
    with as_ctc_error(f'the model {name} cannot be made'):
        made: Model = own(joint_names, gravity)
    if getattr(made, 'n', None) != len(joint_names):
        raise ParameterError('joint_names', joint_names,
                             f'{getattr(made, "n", "no")} names for model {name}')
    return made

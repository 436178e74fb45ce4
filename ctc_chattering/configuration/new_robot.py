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

"""A parameter file for a robot of which no more is known than its URDF."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, pi, sqrt

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Values
from ctc_chattering.configuration.package_share import read_description
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.recommended_gains import LAW, model_torque, recommended_gains
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.trajectory.joint_limits import DescribedLimits, JointLimits
from ctc_chattering.trajectory.reference import make_motion
import numpy as np

#: Part of the limits that the motion takes, its largest amplitude [rad or m] and frequency [Hz].
SHARE, _AMPLITUDE, _FREQUENCY = 0.5, 0.5, 0.5
#: Coulomb friction that is assumed, as a part of the torque that the model takes, and what ka has
#: for that of the real robot, as a part of the effort limit.
FRICTION, KA = 0.1, 0.06
#: Duration of a run and of its smooth start [s], and time between the instants at which the torque
#: is evaluated [ns].
_DURATION, _START, _STEP = 10.0, 2.0, NANOSECONDS // 20


def new_robot(location: str, joints: Sequence[str] = (), gravity: float = 9.81
              ) -> dict[str, Values]:
    """
    Return the parameters of a run that the robot can do, by section of a file.

    A sinusoid around the middle of the limits, at no more than half the limits of position,
    velocity and acceleration and within those of the torque, under law `observer_feedback` with
    the recommended gains. The friction, which no URDF has, is assumed to be 10 % of the torque
    that the model takes; `ka` has room for 6 % of the effort limit.

    Parameters
    ----------
    location : str
        Of the URDF: a path or ``package://NAME/PATH``.
    joints : sequence of str
        Those that are controlled; by default all that can move.
    gravity : float
        [m/s²].

    Raises
    ------
    CtcError
        If there is no model of the URDF, or the robot cannot hold itself.

    """
    text = read_description(location)
    names = tuple(joints) or Tree(text).movable
    every = {'joint_names': names, 'control_period': 1e-3, 'gravity': gravity, 'model': 'urdf',
             'description': location}
    config = ControllerConfig.from_mapping(every)
    model = model_of(config, text)
    expected = model_torque(config, model)
    assert expected is not None  # Only a model of the user's has none.
    largest = np.array([a if a < inf else b for a, b in zip(model.effort_limits, expected)])
    friction = [_short(FRICTION * x) for x in expected]
    centre, amplitude, frequency = map(list, zip(*map(_sinusoid, DescribedLimits(
        text, names).joints)))
    gains = recommended_gains(config.changed({'ka': KA * largest}), expected)
    values: dict[str, Values] = {
        parameter_file.EVERY_NODE: every,
        'plant': {'pacing': 'lockstep', 'duration': _DURATION, 'initial_position': centre,
                  'coulomb_friction': friction},
        'controller': {'law': LAW, **gains},
        'reference': {'center': centre, 'amplitude': amplitude, 'frequency': frequency,
                      'start_duration': _START}}
    motion = make_motion(parameter_file.load(None, values).reference, None,
                         {name: (x, 0.0) for name, x in zip(names, centre)})
    torques = np.max([np.abs(model.inverse_dynamics(*motion.at(t))) for t in range(
        0, round(_DURATION * NANOSECONDS), _STEP)], axis=0) + friction
    for name, needed, most in zip(names, torques, largest):
        if needed > most:  # Nearly all of it is the weight: a slower motion would not help.
            raise CtcError(f'{name}: the motion takes {needed:.3g} N·m, but <limit effort> allows '
                           f'{most:g}; correct the URDF, or choose other joints by --joints')
    return values


def _sinusoid(joint: JointLimits) -> tuple[float, float, float]:
    """Return centre and amplitude [rad or m] and frequency [Hz] of a joint's motion."""
    low, high = joint.position
    centre = 0.5 * (low + high) if -inf < low < high < inf else 0.0
    amplitude = min(_AMPLITUDE, 0.5 * SHARE * (high - low))
    fastest = min(2.0 * pi * _FREQUENCY, SHARE * joint.velocity[1] / amplitude,
                  sqrt(SHARE * joint.acceleration[1] / amplitude))
    return _short(centre), _short(amplitude), _short(fastest / (2.0 * pi))


def _short(value: float) -> float:
    """Return a number to three digits."""
    return float(f'{value:.3g}')

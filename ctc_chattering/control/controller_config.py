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

"""Parameters of the controller: law, gains, model and limits."""

from __future__ import annotations

import dataclasses
from functools import cache
from math import inf

from ctc_chattering.control.laws.registry import (
    law_class,
    LAWS,
    laws_by_parameter,
    SWITCHINGS,
    takes,
)
from ctc_chattering.dynamics.drive_response import discretize_drives, DriveModel
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import RobotConfig
from ctc_chattering.errors import ParameterError
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.parameters import LEAST, Parameter, parameter, PerJoint, Position
import numpy as np

#: Lag of drives of which it is not known [s]: too much costs little, too little much.
ASSUMED_LAG = 3e-3


@dataclasses.dataclass(frozen=True)
class ControllerConfig(RobotConfig):
    """
    Parameters of the laws, of filter (3) and of the limits.

    `laws` says which law takes which.
    """

    law: str = parameter('chattering', 'Control law (docs/laws.md).', choices=LAWS, custom=True)
    kp: PerJoint = parameter(
        100.0, 'Position gain Kp.', '1/s^2', minimum=LEAST, shape='nn', usual=(1.0, 1e4))
    kv: PerJoint = parameter(
        50.0, 'Velocity gain Kv.', '1/s', minimum=LEAST, shape='nn', usual=(1.0, 1e3))
    ka: PerJoint = parameter(
        10.0, 'Chattering gain Ka, above friction plus disturbance. Laws with an observer take '
        'it as the bound of their estimate, and it must then also exceed the error of the model.',
        'N*m',
        usual=(0.1, 1e3))
    lambda_: float = parameter(
        10.0, 'Pole of the filter (3).', '1/s', name='lambda', minimum=LEAST, usual=(0.1, 1e3))
    b: float = parameter(
        1.0, 'Gain of the filter (3); 1 in the paper.', minimum=1e-3, maximum=1e3)
    switching: str = parameter(
        'sign', 'Evaluation of the chattering term.', choices=SWITCHINGS, custom=True)
    boundary_layer: float = parameter(
        0.05, 'Half the width of the layer of switching boundary_layer.', 'rad/s', minimum=LEAST)
    observer_bandwidth: float = parameter(
        200.0, 'Bandwidth of the estimate of switching implicit_observer, at most 0.3 / lag of '
        'the drives; .inf for an estimate from one sample.',
        'rad/s', minimum=LEAST, infinite=True, usual=(10.0, 1e4))
    estimator_bandwidth: float = parameter(
        100.0, 'Bandwidth of the observer or of the Kalman filter.', 'rad/s', minimum=LEAST,
        maximum=1e4)
    estimator_slope: bool = parameter(
        True, 'Estimate the slope of the perturbation as well. This is more accurate, but '
        'requires a better inertia of the model.')
    actuator_lag: PerJoint = parameter(
        inf, 'Time constant of the drives; .inf if unknown, for which 3 ms is assumed.',
        's', maximum=1.0)
    torque_rate_limit: PerJoint = parameter(
        inf, 'Rate limit of the drives; .inf if unknown.', 'N*m/s', minimum=LEAST)
    friction_learning: float = parameter(
        20.0, 'Learning rate of the level of friction; 0 for no learning.', '1/s', maximum=1e3)
    ki: PerJoint = parameter(
        100.0, 'Integral gain Ki, less than Kv Kp (docs/laws.md).', '1/s^3')
    lead_ratio: float = parameter(
        0.5, 'Fraction of the lag that remains after the lead; 1 for no lead.', minimum=LEAST,
        maximum=1.0)
    momentum_gain: float = parameter(
        200.0, 'Bandwidth of the estimate of the perturbation.', '1/s', minimum=LEAST)
    super_twisting_k1: PerJoint = parameter(
        60.0, 'Gain of the term with sqrt(|v|).', 'sqrt(rad/s^3)', minimum=LEAST)
    super_twisting_k2: PerJoint = parameter(
        2000.0, 'Gain of the integral of sgn(v), above the rate of change of the acceleration '
        'that the perturbation causes.', 'rad/s^3', minimum=LEAST)
    adaptation_gain: PerJoint = parameter(
        100.0, 'Adaptation rate of the level of friction, less than D Kv / h.', 'N*m/rad')
    friction_level: PerJoint = parameter(
        0.0, 'Known Coulomb friction. Laws slotine_li and observer_feedback adapt it.', 'N*m')
    friction_velocity: float = parameter(
        0.05, 'Velocity over which the friction of the law changes sign.', 'rad/s', minimum=LEAST)
    friction_lead: float = parameter(
        0.0, 'Time before a reversal at which the friction of the law changes sign.',
        's', maximum=0.1)
    resonance: float = parameter(
        inf, 'Lowest resonance of the arm while its drives hold it; .inf for stiff joints. The '
        'recommended gains and `ctc stability` use it.', 'Hz', minimum=LEAST, infinite=True)
    input_delay: int = parameter(
        0, 'Known delay of the torque in samples, over which the law predicts the state.',
        maximum=100,
        read_only=True)
    payload_mass: float = parameter(
        0.0, 'Mass of the payload and tool at the tip, which the description lacks. A change '
        'enters the model within a second.', 'kg', maximum=1e3)
    payload_center: Position = parameter(
        (0.0, 0.0, 0.0), 'Centre of mass of the payload in the frame of the last link.', 'm',
        minimum=-10.0, maximum=10.0)
    inertia_scale: float = parameter(
        1.0, 'Factor on M and C, to study model errors.', minimum=LEAST, read_only=True)
    gravity_scale: float = parameter(1.0, 'Factor on G, to study model errors.', read_only=True)
    effort_limit: PerJoint = parameter(
        inf, 'Largest torque to send; .inf for the limit of the description, or without one for '
        'no limit.', 'N*m',
        minimum=LEAST)
    effort_rate_limit: PerJoint = parameter(
        inf, 'Rate limit of the torque to send, which starts from 0; .inf for no limit.', 'N*m/s',
        minimum=LEAST)
    anti_windup: bool = parameter(
        True, 'Keep filter (3) and integrals from winding up at the effort limits.')
    error_limit: PerJoint = parameter(
        inf, 'Position error above which no torque is sent until ~/reset; .inf for no limit. Law '
        'observer_feedback then still stops after a growth by 1 rad.', 'rad', minimum=LEAST)
    state_decimation: int = parameter(
        10, 'Decimation of the topics under ~/, which carry every Nth sample. Plots of a bag '
        'recompute all samples.', minimum=1)

    def validate(self) -> None:
        """Check what `RobotConfig` checks, and that the model can carry a payload."""
        super().validate()
        if self.payload_mass and not self.described:
            raise ParameterError(
                'payload_mass', self.payload_mass, '0 without a description of the robot')

    @classmethod
    @cache
    def parameters(cls) -> dict[str, Parameter]:
        """Return the parameters by name, with their laws."""
        takers = laws_by_parameter()
        specs = {}
        for name, spec in super().parameters().items():
            specs[name] = dataclasses.replace(spec, laws=takers.get(name, ()))
        return specs

    def takes(self, name: str) -> bool:
        """Return whether the law takes a parameter."""
        return takes(self.law, name)

    def position_limits(self, model: Model) -> list[tuple[float, float]]:
        """Return least and greatest positions, ∓inf where there are none."""
        free = -inf, inf
        endless = self.which_are_continuous(model.continuous)
        limits = model.position_limits or (free,) * model.n
        return [free if turns else limit for limit, turns in zip(limits, endless)]

    def largest_torque(self, of_model: Vector) -> tuple[float, ...]:
        """
        Return the largest torque sent, shape (n,) [N·m].

        It is inf where nothing limits it.

        Parameters
        ----------
        of_model : sequence of float, shape (n,)
            `Model.effort_limits`: what holds where `effort_limit` is inf; empty for nothing.

        Raises
        ------
        ParameterError
            If a limit of the model is none: a negative one would turn the clamp round.

        """
        n = len(self.effort_limit)
        limits = of_model or (inf,) * n
        if len(limits) != n or not all(limit > 0.0 for limit in limits):
            raise ParameterError(
                'effort_limits of the model', tuple(limits), f'{n} numbers > 0, or none')
        return tuple(own if own < inf else described
                     for own, described in zip(self.effort_limit, limits))

    @property
    def known_lag(self) -> tuple[float, ...]:
        """Return the lag of the drives [s], 0 if unknown."""
        return tuple(x if x < inf else 0.0 for x in self.actuator_lag)

    @property
    def assumed_lag(self) -> tuple[float, ...]:
        """Return the lag of the drives [s], `ASSUMED_LAG` if unknown."""
        return tuple(ASSUMED_LAG if x == inf else x for x in self.actuator_lag)

    def assumed_drives(self, period: float) -> DriveModel:
        """Return the model of the drives that laws assume, for a period [s]."""
        lag = np.array(self.assumed_lag)
        return discretize_drives(lag, np.array(self.torque_rate_limit), period)

    @property
    def law_parameters(self) -> tuple[str, ...]:
        """Return the parameters that the law declares."""
        return law_class(self.law).parameters or ()

    @property
    def switching_in_force(self) -> str:
        """Return the switching; empty under a law without one."""
        return self.switching if self.takes('switching') else ''

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
Gains of every law by one rule for every robot, from what the controller is configured with.

With late = T + h (1 + d) of lag, period and delay, and F / R, friction over the rate limit of the
drives, the largest of the joints::

    p = min(fastest, speed / (late + r F / R)),    kp = a p²,  kv = b p,  ki = c p³       (RU1)

Bandwidths are multiples of p. `observer_feedback` has a rule of its own, which does not depend on
friction (`control/recommended_gains.py`). The numbers of `RULES` were chosen on the draws of seeds
1 and 2 of `held_out_conditions`, by the worst of these.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import dataclasses
from typing import Any, NamedTuple

from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control import recommended_gains
from ctc_chattering.controller.trips import UNBOUNDED
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.trajectory.reference import make_motion
import numpy as np

#: Where the gains of a comparison come from.
GAINS = FILE, RECOMMENDED = 'file', 'recommended'
#: Part of the model's torque that may be wrong, and instants at which it is evaluated.
_MODEL_ERROR, _INSTANTS = 0.2, 500
#: Weights of F / R and late in the lead of friction that is fed forward, and its bound [s].
_LEAD_REVERSAL, _LEAD_LATE, _LEAD_MOST = 0.45, 1.25, 0.1
#: Velocity over which friction that is fed forward changes sign [rad/s].
_FRICTION_VELOCITY = 0.1
#: Ka of law (6) over the friction, and bandwidth of its observer times the lag, at most [rad/s].
_KA, _OBSERVER, _FASTEST_OBSERVER = 1.2, 0.3, 200.0
#: Laws whose settings need the Coulomb friction.
_KNOW_FRICTION = ('slotine_li', 'friction_feedforward')
#: Smooth start that integrals need [s].
_START = 2.0


class Variant(NamedTuple):
    """A law with its switching, '' for one without, and where its gains come from."""

    law: str
    switching: str
    settings: str

    @property
    def values(self) -> dict[str, Any]:
        """Return what names the law, as parameters of the controller."""
        return {'law': self.law, **({'switching': self.switching} if self.switching else {})}


#: That to which all others are compared.
BASE = Variant('compensation', '', FILE)
#: That whose torque variation is the measure of all others'.
BEST = Variant('observer_feedback', '', RECOMMENDED)


class Rule(NamedTuple):
    """
    Numbers of (RU1).

    Attributes
    ----------
    speed, fastest : float
        Of p; `fastest` in rad/s.
    kp, kv, ki, reversal : float
        a, b, c and r.
    times_p, fixed : mapping
        Further parameters: what times p, and values as they are.

    """

    speed: float
    fastest: float = 60.0
    kp: float = 1.0
    kv: float = 2.0
    ki: float = 0.0
    reversal: float = 0.7
    times_p: Mapping[str, float] = {}
    fixed: Mapping[str, float] = {}


#: Laws by rule; `chattering` keeps Kp and Kv, of the paper for example.
RULES = {
    'compensation': Rule(0.5),
    'integral': Rule(0.24, kp=3.0, kv=3.0, ki=1.0, reversal=1.0),
    'momentum_observer': Rule(0.3, times_p={'momentum_gain': 1.0}),
    'super_twisting': Rule(0.3, fixed={'super_twisting_k1': 3.0, 'super_twisting_k2': 10.0}),
    'slotine_li': Rule(0.5),
    'friction_feedforward': Rule(0.5),
    'pd_gravity': Rule(0.5),
    'pid_kalman': Rule(0.41, 41.0, 3.3, 2.4, 1.5, times_p={
        'estimator_bandwidth': 8.6}),
    'extended_state_observer': Rule(0.4, 40.0, times_p={'estimator_bandwidth': 3.0})}


def by_rule(setup: Setup) -> dict[str, Any]:
    """Return the gains of the law in force by its rule, as parameters of the controller."""
    config = setup.controller
    if config.law == recommended_gains.LAW:
        return recommended(setup)
    late = recommended_gains.lateness(
        max(config.assumed_lag), config.control_period, config.input_delay)
    friction, n = config.friction_level, len(config.joint_names)
    reversal = max(f / r for f, r in zip(friction, config.torque_rate_limit))
    if config.law == 'chattering':
        ka = [_KA * x if x else y for x, y in zip(friction, config.ka)]
        return {'ka': ka, 'observer_bandwidth': _OBSERVER / max(
            *config.assumed_lag, _OBSERVER / _FASTEST_OBSERVER)}
    rule = RULES[config.law]
    p = min(rule.fastest, rule.speed / (late + rule.reversal * reversal))
    values: dict[str, Any] = {
        'kp': rule.kp * p ** 2, 'kv': rule.kv * p, 'ki': rule.ki * p ** 3,
        'friction_velocity': _FRICTION_VELOCITY,
        'friction_lead': min(_LEAD_MOST, _LEAD_LATE * late + _LEAD_REVERSAL * reversal),
        **{name: x * p for name, x in rule.times_p.items()}, **rule.fixed}
    declared = config.parameters()
    found: dict[str, Any] = {name: [x] * n if declared[name].shape else x
                             for name, x in values.items() if config.takes(name)}
    return {**found, **({'ka': recommended_ka(setup)} if config.takes('ka') else {})}


def desired_points(setup: Setup, duration: float, count: int
                   ) -> Iterator[tuple[list[float], list[float], list[float]]]:
    """Yield q_d, dq_d and ddq_d of the controller's joints at instants of a duration [s]."""
    plant, reference = setup.plant, setup.reference
    start = dict(zip(plant.joint_names, zip(plant.initial_position, plant.initial_velocity)))
    motion = make_motion(reference, setup.route, start, continuous=setup.continuous)
    order = [reference.joint_names.index(name) for name in setup.controller.joint_names]
    for t in np.linspace(0.0, 1e9 * duration, count).astype(int).tolist():
        q, dq, ddq = ([row[i] for i in order] for row in motion.at(t))
        yield q, dq, ddq


def recommended_ka(setup: Setup) -> list[float]:
    """Return the file's ka and 20 % of the largest torque that the model takes, shape (n,)."""
    config = setup.controller
    model = model_of(config, setup.descriptions.get('controller', ''))
    largest = np.zeros(model.n)
    for q, dq, ddq in desired_points(setup, setup.plant.duration, _INSTANTS):
        largest = np.maximum(largest, np.abs(model.inverse_dynamics(q, dq, ddq)))
    return [float(f'{a + _MODEL_ERROR * b:.3g}') for a, b in zip(config.ka, largest)]


def recommended(setup: Setup) -> dict[str, Any]:
    """Return the recommended law and its gains for a robot whose drives are known."""
    resolution = max(*setup.plant.encoder_resolution, *setup.plant.position_noise)
    gains = recommended_gains.recommended_gains(setup.controller, resolution=resolution)
    return {'law': recommended_gains.LAW, **gains, 'ka': recommended_ka(setup)}


def recommended_setup(setup: Setup, law: str) -> Setup:
    """
    Return a setup with a law and its gains by the rule, for a controller that knows its drives.

    What is known of drives and friction is taken from the plant.
    """
    plant, config, start = setup.plant, setup.controller, setup.reference.start_duration
    known = {'law': law, 'actuator_lag': plant.actuator_lag,
             'torque_rate_limit': plant.torque_rate_limit,
             **({'switching': 'implicit_observer'} if law == 'chattering' else {})}
    friction = {'friction_level': plant.coulomb_friction}
    values = {**known, **by_rule(setup.changed({'controller': {**known, **friction}})),
              **(friction if law in _KNOW_FRICTION else {})}
    if law in UNBOUNDED:
        values['effort_rate_limit'] = plant.torque_rate_limit
    if law == 'integral':
        setup = dataclasses.replace(setup, reference=setup.reference.changed(
            {'start_duration': max(start, _START)}))
    return dataclasses.replace(setup, controller=config.changed(values))

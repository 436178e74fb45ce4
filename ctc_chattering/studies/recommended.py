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

"""The recommended settings of the laws, by one rule for every robot; docs/laws.md."""

from __future__ import annotations

from collections.abc import Iterator
import dataclasses
from typing import Any

from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.recommended_gains import (
    estimator_bandwidth,
    largest_pole,
    lateness,
)
from ctc_chattering.controller.settings_check import UNBOUNDED
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.studies.tuning import KNOW_FRICTION
from ctc_chattering.trajectory.reference import make_motion
import numpy as np

#: Part of the model's torque that may be wrong, and instants at which it is evaluated.
_MODEL_ERROR, _INSTANTS = 0.2, 500
#: Triple pole of `integral` over that pole, and the smooth start that it needs [s].
_INTEGRAL, _START = 0.6, 2.0


def recommended_pole(setup: Setup) -> float:
    """Return p [rad/s] for the drives that the controller knows."""
    config = setup.controller
    return largest_pole(lateness(
        max(config.assumed_lag), config.control_period, config.input_delay))


def integral_pole(setup: Setup) -> float:
    """Return the triple pole of `integral` [rad/s]; a reversal of friction takes its time, too."""
    config, plant = setup.controller, setup.plant
    reversal = max(f / r for f, r in zip(plant.coulomb_friction, plant.torque_rate_limit))
    return _INTEGRAL * largest_pole(reversal + lateness(
        max(config.known_lag), config.control_period, config.input_delay))


def desired_points(setup: Setup, duration: float, count: int
                   ) -> Iterator[tuple[list[float], list[float], list[float]]]:
    """Yield q_d, dq_d and ddq_d of the controller's joints at instants of a duration [s]."""
    plant, reference = setup.plant, setup.reference
    motion = make_motion(reference, setup.route, dict(zip(
        plant.joint_names, zip(plant.initial_position, plant.initial_velocity))))
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
    """Return the recommended settings for a robot whose drives are known, by parameter."""
    n, pole = len(setup.controller.joint_names), recommended_pole(setup)
    resolution = max(*setup.plant.encoder_resolution, *setup.plant.position_noise)
    return {'law': 'observer_feedback', 'kp': [pole ** 2] * n, 'kv': [2.0 * pole] * n,
            'estimator_bandwidth': estimator_bandwidth(pole, resolution),
            'ka': recommended_ka(setup)}


def recommended_setup(setup: Setup, law: str) -> Setup:
    """
    Return a setup with a law and the settings that docs/laws.md recommends for it.

    What is known of drives and friction is taken from the plant. Laws that are not named here keep
    the gains of the file.
    """
    plant, config, reference = setup.plant, setup.controller, setup.reference
    config = config.changed({'law': law, 'actuator_lag': plant.actuator_lag,
                             'torque_rate_limit': plant.torque_rate_limit})
    setup = dataclasses.replace(setup, controller=config)
    values: dict[str, Any] = {}
    if law == 'observer_feedback':
        values = recommended(setup)
    elif law == 'chattering':
        values = {'switching': 'implicit_observer',
                  'observer_bandwidth': config.parameters()['observer_bandwidth'].default}
    elif law == 'integral':
        n, p = len(config.joint_names), integral_pole(setup)
        values = {'kp': [3.0 * p ** 2] * n, 'kv': [3.0 * p] * n, 'ki': [p ** 3] * n}
        reference = reference.changed({'start_duration': max(reference.start_duration, _START)})
    elif law in KNOW_FRICTION:
        values = {'friction_level': plant.coulomb_friction}
    if law in UNBOUNDED:
        values['effort_rate_limit'] = plant.torque_rate_limit
    return dataclasses.replace(setup, controller=config.changed(values), reference=reference)

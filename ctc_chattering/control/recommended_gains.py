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
Gains of `observer_feedback` that drives, delay and encoders allow; see docs/theory.md.

Its gains are its own: those of the other laws do not suit it, nor its own them. `GainChoice` is
the one place that decides which gains a law takes where a user chooses it and gives none.
"""

from __future__ import annotations

from math import inf, pi
from typing import Any

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import matrix
import numpy as np

#: The law with gains of its own, and which of its parameters these are.
LAW = 'observer_feedback'
GAINS = ('kp', 'kv', 'ka', 'estimator_bandwidth')
#: Double pole of the error, unless drives or delay are slower [rad/s].
POLE = 100.0
#: Most that the pole times lag and delay may be.
SLOWNESS = 0.4
#: Pole over the lowest resonance of elastic joints, whose encoders are at the motors.
RESONANCE_PART = 0.2
#: Resolution of positions up to which the observer is fast [rad].
FINE_RESOLUTION = 2e-5
#: ω over the pole, for fine positions, and for coarser or unknown ones.
_FAST, _SLOW = 2.0, 1.0
#: How much faster an observer without a slope may be, for the same noise of P̂ or less.
_WITHOUT_SLOPE = 2.0
#: Part of the model's torque that may be wrong, the acceleration that this torque is taken for
#: [rad/s²], and the number of positions at which it is.
MODEL_ERROR, _ACCELERATION, _POSITIONS = 0.2, 20.0, 100


def lateness(lag: float, period: float, delay: int) -> float:
    """Return T + h (1 + d) [s]: after which time a torque acts, with the sample it waits for."""
    return lag + period * (1 + delay)


def largest_pole(late: float, resonance: float = inf) -> float:
    """
    Return p [rad/s] of kp = p², kv = 2 p.

    Parameters
    ----------
    late : float
        Time after which a torque acts [s].
    resonance : float
        Lowest one of elastic joints [Hz].

    """
    return min(POLE, SLOWNESS / late, RESONANCE_PART * 2.0 * pi * resonance)


def pole_over_resonance(config: ControllerConfig) -> float:
    """Return the fastest pole of the feedback over the lowest resonance; 0 for stiff joints."""
    stiffness = np.diagonal(np.array(matrix(config.kp, len(config.joint_names))))
    return float(np.sqrt(stiffness.max()) / (2.0 * pi * config.resonance))


def estimator_bandwidth(pole: float, resolution: float, slope: bool = True) -> float:
    """
    Return ω of the observer [rad/s].

    Parameters
    ----------
    pole : float
        p [rad/s].
    resolution : float
        Step of the encoders, or noise of the positions, if that is more [rad].
    slope : bool
        Whether the observer has one, `estimator_slope`.

    """
    ratio = _FAST if resolution <= FINE_RESOLUTION else _SLOW
    return ratio * pole * (1.0 if slope else _WITHOUT_SLOPE)


def model_torque(config: ControllerConfig, model: Model) -> Array | None:
    """
    Return the largest torque of the model that is to be expected, shape (n,) [N·m].

    At positions that are drawn it holds the robot and accelerates one joint by 20 rad/s²; it is
    within the limits of the torque. None for a model of the user's that has none at such a
    position.
    """
    positions = np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSITIONS, model.n)).tolist()
    try:
        torques = [np.abs(model.gravity_torque(q))
                   + _ACCELERATION * np.diagonal(model.mass_matrix(q)) for q in positions]
    except (ArithmeticError, ValueError):
        return None
    found: Array = np.minimum(np.max(torques, axis=0), config.largest_torque(model.effort_limits))
    return found


def recommended_gains(config: ControllerConfig, torque: Array | None = None,
                      resolution: float = inf) -> dict[str, Any]:
    """
    Return the gains of `observer_feedback` from what is known, by parameter.

    The one rule: of `ctc new-robot`, of `recommended` in `ctc compare` and `ctc tune`, and of a
    law that is chosen without gains.

    Parameters
    ----------
    config : ControllerConfig
        Its lag of the drives, delay and period, and a `ka` that exceeds the friction.
    torque : array, shape (n,), optional
        `model_torque`; without it `ka` has no share for the error of the model.
    resolution : float
        As `estimator_bandwidth` takes it; unknown encoders count as coarse.

    """
    n = len(config.joint_names)
    pole = largest_pole(lateness(
        max(config.assumed_lag), config.control_period, config.input_delay), config.resonance)
    error = MODEL_ERROR * np.array([0.0] * n if torque is None else torque)
    return {'kp': (pole ** 2,) * n, 'kv': (2.0 * pole,) * n,
            'ka': tuple(float(f'{x:.3g}') for x in np.add(config.ka, error)),
            'estimator_bandwidth': estimator_bandwidth(pole, resolution, config.estimator_slope)}


class GainChoice:
    """
    Decides which gains a law takes where it is chosen without any.

    Attributes
    ----------
    torque : array, shape (n,), or None
        As `recommended_gains` takes it.

    """

    def __init__(self, torque: Array | None = None) -> None:
        self.torque = torque
        #: The gains in force when a law with gains of its own, or one without, was left.
        self._left: dict[bool, dict[str, Any]] = {}

    def suitable(self, law: str, config: ControllerConfig) -> dict[str, Any]:
        """Return the gains of a law of the other kind than that of `config`, by parameter."""
        if law == LAW:
            return recommended_gains(config, self.torque)
        known, n = config.parameters(), len(config.joint_names)
        return {name: known[name].default_for(n) for name in ('kp', 'kv')}

    def of_law(self, law: str, config: ControllerConfig) -> dict[str, Any]:
        """
        Return the gains that `law` takes in place of those of `config`, by parameter.

        None where the law of `config` has the same ones. Else those that it had before, the
        recommended ones, or, without its own, the defaults of kp and kv.
        """
        own, before = law == LAW, config.law == LAW
        if own == before:
            return {}
        values = config.as_mapping()
        self._left[before] = {name: values[name] for name in GAINS}
        return self._left.get(own) or self.suitable(law, config)

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
Recommended gains of every law.

They follow from what is known of the arm, its drives and its sensors.

A law declares its rule (`Law.gain_rule`), and every rule takes a `KnownLoop`. New robots,
comparisons, tuning, maps and a law that is chosen without gains all take `recommended_gains`.
`identification/gains.py` takes the pole and the bandwidths of single rules. With the
lateness l = T + h (1 + d) of lag, period and delay, and F / R, the joints' largest friction over
the rate limit of the drives, most laws follow::

    p = min(fastest, speed / (l + r F / R)),    kp = a p²,  kv = b p,  ki = c p³          (RU1)

`ObserverRule` does not depend on friction, see docs/theory.md. `SwitchingRule` keeps Kp and Kv.
The numbers of (RU1) were chosen on the draws of seeds 1 and 2 of `runs.conditions.held_out`, by
the worst of these.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import dataclasses
from math import inf, pi
from typing import Any, NamedTuple

from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.laws.registry import COMMON_GAINS, law_class, takes
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError
from ctc_chattering.number_format import round_number
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import matrix
import numpy as np

#: The law for real arms: recommended where nothing chooses one.
RECOMMENDED_LAW = 'observer_feedback'
#: The switching for law (6), which chatters least.
RECOMMENDED_SWITCHING = 'implicit_observer'
#: Gains that a change of the law exchanges, see `GainChoice`.
GAINS = ('kp', 'kv', 'ka', 'estimator_bandwidth')
#: Double pole of the error, unless drives or delay are slower [rad/s].
POLE = 100.0
#: Largest product of pole and lateness.
MAX_POLE_LATENESS = 0.4
#: Pole over the lowest resonance of elastic joints, whose encoders are at the motors.
MAX_POLE_PER_RESONANCE = 0.2
#: Resolution of positions up to which the observer is fast [rad].
FINE_RESOLUTION = 2e-5
#: Fraction of the model's torque that may be wrong.
MODEL_ERROR = 0.2
#: Largest product of the bandwidth of a switching's observer and the lag of the drives.
BANDWIDTH_LAG = 0.3


def lateness(lag: float, period: float, delay: int) -> float:
    """
    Return T + h (1 + d) [s].

    After this time a torque acts, including the sample that it waits for.
    """
    return lag + period * (1 + delay)


def unknown_torque() -> None:
    """
    Return None for an unknown torque.

    `ka` has no share for it then.
    """


class KnownLoop(NamedTuple):
    """
    Facts about drives, sensors and an arm.

    Attributes
    ----------
    config : ControllerConfig
        Its period, delay, drives, friction and resonance, and a `ka` that exceeds friction and
        disturbance.
    torque : callable
        Returns the largest torque of the model, shape (n,) [N·m]. It is that of `model_torque`, or
        along the desired motion by `runs/recommended.py`. None for a model without numbers. It is
        called where the gains depend on it.
    resolution : float
        Step of the encoders, or noise of the positions if that is more [rad]. Unknown encoders
        count as coarse.

    """

    config: ControllerConfig
    torque: Callable[[], Array | None] = unknown_torque
    resolution: float = inf

    @property
    def lag(self) -> float:
        """Lag of the slowest drive [s]."""
        return max(self.config.assumed_lag)

    @property
    def lateness(self) -> float:
        """Time after which a torque acts [s]."""
        return lateness(self.lag, self.config.control_period, self.config.input_delay)

    @property
    def reversal(self) -> float:
        """
        Longest F / R of a joint [s].

        In this time drives change their torque by the friction level, half of a reversal.
        """
        limits = self.config.torque_rate_limit
        return max(f / r for f, r in zip(self.config.friction_level, limits))

    def ka_for_model_errors(self) -> tuple[float, ...]:
        """Return ka with room for model errors [N·m]."""
        torque = self.torque()
        ka = np.array(self.config.ka)
        if torque is not None:
            ka = ka + MODEL_ERROR * torque
        return tuple(round_number(x) for x in ka)


class GainRule:
    """Rule for the gains of a law."""

    #: Whether gains of other laws do not suit the law, nor its gains them.
    is_separate = False
    #: Whether the law needs the Coulomb friction in `friction_level`.
    knows_friction = False
    #: Shortest smooth start for these gains [s].
    start_duration = 0.0

    def gains(self, loop: KnownLoop) -> dict[str, Any]:
        """
        Return parameters of the controller.

        A number stands for all joints.
        """
        raise NotImplementedError


@dataclasses.dataclass(frozen=True)
class PoleRule(GainRule):
    """
    Rule for gains from one pole p, (RU1).

    Attributes
    ----------
    speed, fastest : float
        Numerator and bound of p in (RU1), the bound in rad/s.
    kp, kv, ki, reversal : float
        a, b, c and r.
    times_p, fixed : mapping
        Further parameters: factors of p, and values.
    knows_friction : bool
        Whether the law needs the Coulomb friction in `friction_level`.
    start_duration : float
        Shortest smooth start for these gains [s].

    """

    speed: float
    fastest: float = 60.0
    kp: float = 1.0
    kv: float = 2.0
    ki: float = 0.0
    reversal: float = 0.7
    times_p: Mapping[str, float] = dataclasses.field(default_factory=dict)
    fixed: Mapping[str, float] = dataclasses.field(default_factory=dict)
    knows_friction: bool = False
    start_duration: float = 0.0

    def gains(self, loop: KnownLoop) -> dict[str, Any]:
        """Return gains for the pole p."""
        late = loop.lateness
        reversal_time = loop.reversal
        p = min(self.fastest, self.speed / (late + self.reversal * reversal_time))
        gains: dict[str, Any] = {
            'kp': self.kp * p ** 2,
            'kv': self.kv * p,
            'friction_velocity': 0.1,
            'friction_lead': min(0.1, 1.25 * late + 0.45 * reversal_time),
        }
        if self.ki:
            gains['ki'] = self.ki * p ** 3
        for name, factor in self.times_p.items():
            gains[name] = factor * p
        return gains | dict(self.fixed)


class SwitchingRule(GainRule):
    """
    Rule for Ka and observer of law (6).

    Kp and Kv stay, those of the paper for example.
    """

    def gains(self, loop: KnownLoop) -> dict[str, Any]:
        """
        Return Ka and the observer's bandwidth.

        Ka is 1.2 times the friction, where it is known.
        """
        ka = []
        for friction, bound in zip(loop.config.friction_level, loop.config.ka):
            ka.append(1.2 * friction if friction else bound)
        return {'ka': tuple(ka), 'observer_bandwidth': observer_bandwidth(loop.lag, 200.0)}


class ObserverRule(GainRule):
    """Gains of `observer_feedback`, which do not depend on friction."""

    is_separate = True

    def gains(self, loop: KnownLoop) -> dict[str, Any]:
        """Return gains for a double pole, and a bandwidth."""
        config = loop.config
        pole = largest_pole(loop.lateness, config.resonance)
        bandwidth = estimator_bandwidth(pole, loop.resolution, config.estimator_slope)
        return {'kp': pole ** 2, 'kv': 2.0 * pole, 'estimator_bandwidth': bandwidth}


def observer_bandwidth(lag: float, largest: float) -> float:
    """
    Return the bandwidth of a switching's observer.

    It is for a lag [s], and within a bound [rad/s].
    """
    return min(largest, BANDWIDTH_LAG / lag) if lag else largest


def largest_pole(late: float, resonance: float = inf) -> float:
    """
    Return the pole p [rad/s] for `ObserverRule`.

    Parameters
    ----------
    late : float
        Lateness of the torque [s].
    resonance : float
        Lowest one of elastic joints [Hz].

    """
    return min(POLE, MAX_POLE_LATENESS / late, MAX_POLE_PER_RESONANCE * 2.0 * pi * resonance)


def pole_over_resonance(config: ControllerConfig) -> float:
    """
    Return the fastest pole over the lowest resonance.

    It is 0 for stiff joints.
    """
    stiffness = np.diag(matrix(config.kp, len(config.joint_names)))
    fastest = np.sqrt(stiffness.max())
    return float(fastest / (2.0 * pi * config.resonance))


def estimator_bandwidth(pole: float, resolution: float, has_slope: bool = True) -> float:
    """
    Return ω of the observer [rad/s].

    Fine positions allow twice the pole. Without a slope another factor of two gives the same
    noise of P̂, or less.

    Parameters
    ----------
    pole : float
        p [rad/s].
    resolution : float
        As in `KnownLoop`.
    has_slope : bool
        `estimator_slope`.

    """
    ratio = 2.0 if resolution <= FINE_RESOLUTION else 1.0
    return ratio * pole * (1.0 if has_slope else 2.0)


def model_torque(config: ControllerConfig, model: Model) -> Array | None:
    """
    Return the largest expected torque of the model.

    Its shape is (n,) [N·m].

    At 100 positions that are drawn, the robot is held and one joint accelerates by 20 rad/s². The
    limits of the torque bound it. None for a model of the user's that has no number at such a
    position.
    """
    positions = np.random.default_rng(0).uniform(-np.pi, np.pi, (100, model.n)).tolist()
    try:
        torques = [np.abs(model.gravity_torque(q)) + 20.0 * np.diagonal(model.mass_matrix(q))
                   for q in positions]
    except (ArithmeticError, ValueError):
        return None
    largest: Array = np.minimum(
        np.max(torques, axis=0), config.largest_torque(model.effort_limits))
    return largest


def gain_rule(law: str) -> GainRule:
    """Return the rule of a law, or raise `CtcError`."""
    rule: GainRule | None = law_class(law).gain_rule
    if rule is None:
        raise CtcError(f'law {law} has no recommended gains, because it declares no gain_rule; '
                       'choose the gains, or give the law a rule (docs/laws.md)')
    return rule


def recommended_gains(law: str, loop: KnownLoop) -> dict[str, Any]:
    """
    Return the recommended gains of a law, by parameter.

    Raises
    ------
    CtcError
        If the law declares no rule.

    """
    values = gain_rule(law).gains(loop)
    if 'ka' not in values and takes(law, 'ka'):
        values['ka'] = loop.ka_for_model_errors()
    # In the order of their declaration, for files and messages.
    gains = {}
    n = len(loop.config.joint_names)
    for name, spec in loop.config.parameters().items():
        if name in values and takes(law, name):
            gains[name] = spec.coerce(values[name], n)
    return gains


def gain_owner(law: str) -> str:
    """Return the law if its gains are separate, else ''."""
    rule = law_class(law).gain_rule
    return law if rule is not None and rule.is_separate else ''


class GainChoice:
    """
    Choice of gains for a law without any.

    Attributes
    ----------
    torque : callable
        Returns `model_torque`, or None. It is called where the gains depend on it.

    """

    def __init__(self, torque: Callable[[], Array | None] = unknown_torque) -> None:
        self.torque = torque
        #: Gains in force when a law was replaced, by `gain_owner`.
        self._previous: dict[str, dict[str, Any]] = {}

    def suitable(self, law: str, config: ControllerConfig) -> dict[str, Any]:
        """
        Return gains for a law, by parameter.

        Those of `config` do not suit it.
        """
        if gain_owner(law):
            return recommended_gains(law, KnownLoop(config, self.torque))
        declared = config.parameters()
        n = len(config.joint_names)
        return {name: declared[name].default_for(n) for name in COMMON_GAINS}

    def of_law(self, law: str, config: ControllerConfig) -> dict[str, Any]:
        """
        Return gains that replace those of `config`.

        They are those of `law`, by parameter.

        There are none if both laws share gains. Else those that it had before. Else the
        recommended ones, or, for laws that share gains, the defaults of kp and kv.
        """
        owner = gain_owner(law)
        previous_owner = gain_owner(config.law)
        if owner == previous_owner:
            return {}
        values = config.as_mapping()
        self._previous[previous_owner] = {name: values[name] for name in GAINS}
        return self._previous.get(owner) or self.suitable(law, config)

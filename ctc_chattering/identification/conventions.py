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
Conventions of a recorded torque.

They are its unit, its sign, the order of its joints, and the mounting of the base.

`identify` calls these checks once the windows are computed. They refuse a torque of another unit,
sign or order, since the regression would make wrong masses out of it. The torque of each joint is
fitted by the weight and the inertial torque of the model, each with a factor of its own, beside
friction. A factor of the weight far from 1 means another unit. Friction or inertia below 0 means
the other sign. Where gravity along another direction explains the torque much better, the base is
mounted that way.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import NamedTuple

from ctc_chattering.identification.findings import Estimate, Finding, Reason, Severity
from ctc_chattering.identification.recording import RecordingError, RecordingFault
from ctc_chattering.identification.regression import correlation_length, Observations
from ctc_chattering.identification.stretches import COMMAND, EFFORT
from ctc_chattering.numerics.linear_algebra import Array, Flags
import numpy as np
from scipy.optimize import linear_sum_assignment  # type: ignore[import-untyped]


@dataclasses.dataclass(frozen=True)
class ConventionLimits:
    """
    Limits beyond which a torque has another unit or order.

    Attributes
    ----------
    min_factor, max_factor : float
        Factors of the model's weight that a torque in N·m may have.
    max_unexplained : float
        Largest fraction of a torque's variance that commands in another order may leave.
    min_improvement : float
        Least ratio of the remaining variance as recorded and in another order.

    """

    min_factor: float = 0.5
    max_factor: float = 2.0
    max_unexplained: float = 0.3
    min_improvement: float = 4.0


LIMITS = ConventionLimits()


#: Names of the torque in messages.
SIGNAL_NAMES = {COMMAND: 'commanded torque', EFFORT: 'effort'}


class Conventions(NamedTuple):
    """
    Factors that make a signal the torque of the model.

    Attributes
    ----------
    constant : ndarray, shape (n,)
        Torque at the joint per unit of the signal.
    findings : tuple of Finding
        Doubts about these.
    estimates : tuple of Estimate, length n
        Identified constants, empty where the signal is a torque.

    """

    constant: Array
    findings: tuple[Finding, ...]
    estimates: tuple[Estimate, ...] = ()


# Factors of a torque.

class Factor(NamedTuple):
    """Factor of a column, with its standard error or inf."""

    value: float
    error: float

    @property
    def sign(self) -> float:
        """Sign of the factor; 0 within three standard errors of 0."""
        return float(np.sign(self.value)) if abs(self.value) > 3.0 * self.error else 0.0

    @property
    def is_known(self) -> bool:
        """Return whether the factor is known to 15 %."""
        return self.error < 0.15 * max(abs(self.value), 0.5)


class Factors(NamedTuple):
    """
    Factors of columns that explain a torque.

    Attributes
    ----------
    factors : tuple of Factor
        Factor of each column.
    unexplained : float
        Fraction of the torque's variance that remains.

    """

    factors: tuple[Factor, ...]
    unexplained: float

    @classmethod
    def fit(cls, columns: Array, target: Array) -> Factors:
        """Return the factors with the least squared residual."""
        sizes = np.maximum(np.abs(columns).max(axis=0, initial=0.0), 1e-300)
        scaled = columns / sizes
        value, _, rank, _ = np.linalg.lstsq(scaled, target, rcond=1e-9)
        residual = target - scaled @ value
        variance = float(residual @ residual) / max(len(target) - len(value), 1)
        variance *= correlation_length(residual)
        normal = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12)
        error = np.sqrt(np.maximum(variance * normal.diagonal(), 0.0))
        if rank < len(value):
            error = np.where(np.abs(columns).max(axis=0) > 0.0, error, np.inf)
        power = float(np.square(target - target.mean()).sum()) if len(target) else 0.0
        factors = map(Factor, (value / sizes).tolist(), (error / sizes).tolist())
        unexplained = float(residual @ residual) / power if power > 0.0 else 1.0
        return cls(tuple(factors), unexplained)


def fit_model(data: Observations, joint: int, signal: int | None = None) -> Factors:
    """
    Return factors of a torque.

    The first two are those of weight and inertial torque.

    With `signal`, it is the torque of another joint, over the motion of this one.
    """
    used = data.used[:, joint]
    if signal is None:
        signal = joint
    else:
        used = used & data.used[:, signal]
    torque = data.torque[used, signal]
    weight = data.windows.weight[used, joint]
    inertial = data.windows.model_torque[used, joint] - weight
    columns = np.column_stack((weight, inertial, friction_columns(data, joint, used)))
    fitted = Factors.fit(columns, torque)
    # Weight below 2 % of the torque shows no factor.
    if np.std(weight) > 0.02 * max(float(np.std(torque)), 1e-300):
        return fitted
    weight_factor, *further = fitted.factors
    return fitted._replace(factors=(weight_factor._replace(error=np.inf), *further))


def fit_beside_any_gravity(data: Observations, joint: int) -> Factors:
    """
    Return factors of a torque beside weight along any direction.

    The first two are those of the direction and of the inertial torque.
    """
    windows, used = data.windows, data.used[:, joint]
    weight = windows.weight[used, joint]
    inertial = windows.model_torque[used, joint] - weight
    direction, velocity, constant = friction_columns(data, joint, used).T
    pull = windows.bodies[used, joint, -3:] if windows.bodies.shape[2] else weight[:, None]
    columns = np.column_stack((direction, inertial, velocity, constant, pull))
    return Factors.fit(columns, data.torque[used, joint])


def friction_columns(data: Observations, joint: int, used: Flags) -> Array:
    """Return direction, velocity and a constant, shape (rows, 3)."""
    windows = data.windows
    return np.column_stack((
        windows.direction[used, joint], windows.velocity[used, joint], np.ones(int(used.sum()))))


# Unit, sign and order.

def check_torque(data: Observations, source: str) -> tuple[Finding, ...]:
    """
    Return the joints whose torque has another unit.

    Parameters
    ----------
    data : Observations
        Windows with the torque.
    source : str
        `COMMAND` or `EFFORT`.

    Raises
    ------
    RecordingError
        If the torque has another unit, or no weight.

    """
    moving = np.flatnonzero(data.moving).tolist()
    weights = {joint: fit_model(data, joint).factors[0] for joint in moving}
    weights = {joint: factor for joint, factor in weights.items() if factor.is_known}
    if not weights:
        return ()
    # The joint with the median load decides: a tool is much for the joints near the tip.
    loads = np.array([float(np.std(data.windows.weight[:, joint])) for joint in weights])
    factors = np.array([factor.value for factor in weights.values()])
    order = np.argsort(factors)
    middle = int(np.searchsorted(np.cumsum(loads[order]), 0.5 * loads.sum()))
    median = float(factors[order][min(middle, len(order) - 1)])
    if not LIMITS.min_factor <= median <= LIMITS.max_factor:
        raise RecordingError(
            RecordingFault.UNIT,
            f'the {SIGNAL_NAMES[source]} has {median:.2g} times the weight of the model. Either '
            'it is no torque in N*m at the joint, or the model is of another robot. Give --effort '
            'current for a current, --torque-constant for another unit, or --gravity 0 for a '
            'robot that carries its weight itself')
    return tuple(_other_unit(joint, factor, source)
                 for joint, factor in weights.items() if not _is_possible(factor))


def _is_possible(factor: Factor) -> bool:
    """Return whether this robot may have such a weight."""
    half = 2.0 * factor.error
    return factor.value + half > LIMITS.min_factor and factor.value - half < LIMITS.max_factor


def _other_unit(joint: int, factor: Factor, source: str) -> Finding:
    """Return the finding on another weight than the model's."""
    reason, severity = Reason.UNITS, Severity.REFUSED
    if factor.value > LIMITS.max_factor:
        reason, severity = Reason.TOOL, Severity.CARE
    return Finding(reason, severity, joint, {
        'signal': SIGNAL_NAMES[source], 'factor': factor.value, 'error': 2.0 * factor.error})


def check_sign(data: Observations, source: str) -> Conventions:
    """
    Return the sign of each joint's torque.

    Friction and inertia have the same sign however the base is mounted. Where neither shows, the
    weight decides, though an arm that hangs from the ceiling has that with the other sign.

    Raises
    ------
    RecordingError
        If the torque has the other sign.

    """
    moving = np.flatnonzero(data.moving).tolist()
    factors = {joint: fit_beside_any_gravity(data, joint).factors[:2] for joint in moving}
    evidence = {joint: sum(factor.sign for factor in x) for joint, x in factors.items()}
    weight_factors = [fit_model(data, joint).factors[0] for joint in moving]
    weights = [factor.value for factor in weight_factors if factor.is_known]
    if any(factor.sign for x in factors.values() for factor in x):
        sign = sum(evidence.values())
    else:
        sign = float(np.median(weights or [0.0]))
    if sign < 0.0:
        weight = f', {np.median(weights):.2f} times the weight of the model' if weights else ''
        cure = 'Turn the sign of the recorded commands, or name their topic with --commands'
        if source == EFFORT:
            cure = 'Turn the sign with --torque-constant=-1'
        raise RecordingError(
            RecordingFault.SIGN,
            f'the {SIGNAL_NAMES[source]} has the other sign. It shows friction or inertia below '
            f'0{weight}. {cure}')
    constant = np.ones(data.joint_count)
    constant[[joint for joint in moving if evidence[joint] < 0.0]] = -1.0
    option = ','.join(f'{x:g}' for x in constant)
    findings = []
    for joint in np.flatnonzero(constant < 0.0).tolist():
        friction = factors[joint][0]
        findings.append(Finding(
            Reason.SIGN, Severity.REFUSED, joint,
            {'signal': SIGNAL_NAMES[source], 'friction': friction.value,
             'error': 2.0 * friction.error, 'option': option}))
    return Conventions(constant, tuple(findings))


def check_order(data: Observations, joints: Sequence[str]) -> None:
    """Raise `RecordingError` if the columns of commands fit other joints better."""
    moving = np.flatnonzero(data.moving).tolist()
    if len(moving) < 2:
        return
    unexplained = np.array([
        [max(fit_model(data, joint, signal).unexplained, 1e-4) for joint in moving]
        for signal in moving])
    _, best = linear_sum_assignment(np.log(unexplained))
    recorded = np.arange(len(moving))
    is_moved = best != recorded
    if not is_moved.any():
        return
    as_recorded = unexplained.diagonal()[is_moved]
    reordered = unexplained[recorded, best][is_moved]
    improvement = np.log(as_recorded / reordered).mean()
    is_better = improvement > np.log(LIMITS.min_improvement)
    if is_better and (reordered < LIMITS.max_unexplained).all():
        raise RecordingError(
            RecordingFault.ORDER,
            f'the commands do not fit the joints in the order {",".join(joints)}: they leave '
            f"{as_recorded.max():.0%} of a joint's torque unexplained, but {reordered.max():.0%} "
            'in another order. Give --joints in the order of the commands')


# Mounting of the base.

def estimate_gravity(data: Observations, gravity: Array) -> Array:
    """
    Return gravity in the frame of the base, shape (3,) [m/s²].

    It is that of the model, if no other direction explains the torque much better.

    Parameters
    ----------
    data : Observations
        Windows with the torque, and with the columns of gravity.
    gravity : ndarray, shape (3,)
        Gravity of the model [m/s²].

    """
    strength = float(np.linalg.norm(gravity))
    moving = np.flatnonzero(data.moving).tolist()
    if not strength or not moving or not data.windows.bodies.shape[2]:
        return gravity
    equations = [_gravity_equations(data, joint, gravity) for joint in moving]
    columns, target = map(np.concatenate, zip(*equations))
    fitted = np.linalg.lstsq(columns, target, rcond=1e-6)[0]
    # Across the plane of a planar arm gravity has no torque: there it stays as in the model.
    fitted += gravity - np.linalg.lstsq(columns, columns @ gravity, rcond=1e-6)[0]
    remaining = float(np.square(target - columns @ fitted).sum())
    original = float(np.square(target - columns @ gravity).sum())
    size = float(np.linalg.norm(fitted))
    turned = np.asarray(strength * fitted / max(size, 1e-300), float)
    is_better = remaining / max(original, 1e-300) < 0.5
    is_possible = 0.6 < size / strength < 1.6
    if is_better and is_possible and angle_between(gravity, turned) > 0.03:  # [rad]
        return turned
    return gravity


def _gravity_equations(data: Observations, joint: int, gravity: Array) -> tuple[Array, Array]:
    """Return columns of gravity and the torque, beside friction and inertia."""
    windows, used = data.windows, data.used[:, joint]
    scale = 1.0 / float(data.deviation[joint])
    pull = windows.bodies[used, joint, -3:]
    torque = data.beyond_model[used, joint] + pull @ gravity
    other_columns = np.column_stack((
        friction_columns(data, joint, used), windows.acceleration[used, joint]))
    basis = np.linalg.qr(other_columns)[0]
    columns = scale * (pull - basis @ (basis.T @ pull))
    return columns, scale * (torque - basis @ (basis.T @ torque))


def angle_between(a: Array, b: Array) -> float:
    """Return the angle between two vectors [rad], exact for small ones."""
    a = a / np.linalg.norm(a)
    b = b / np.linalg.norm(b)
    return float(2.0 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b)))

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
Conventions of a recorded torque: its unit, its sign, and how the base is mounted.

The torque of each joint is fitted by the weight and the inertial torque of the model, each with a
factor of its own, beside friction. A factor of the weight far from 1 means another unit. Friction
or inertia below 0 means the other sign. Where gravity along another direction of the base explains
the torque much better, the base is mounted that way.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import NamedTuple

from ctc_chattering.errors import CtcError
from ctc_chattering.identification.drives import EFFORT
from ctc_chattering.identification.findings import Estimate, Finding, Gap, Reason, Severity
from ctc_chattering.identification.friction_terms import FrictionTerm, TermKind
from ctc_chattering.identification.prior import BodyPrior
from ctc_chattering.identification.regression import (
    correlation_length,
    fit,
    Observations,
    Unknowns,
)
from ctc_chattering.identification.selection import basic_terms
from ctc_chattering.numerics.linear_algebra import Array, Flags
import numpy as np
from scipy.optimize import linear_sum_assignment  # type: ignore[import-untyped]

#: Factor of the model's weight below which a torque has another unit.
LEAST_FACTOR = 0.5
#: Factor above which it has.
MOST_FACTOR = 2.0
#: Standard error of such a factor, as a part of it, up to which it is known.
KNOWN_FACTOR = 0.15
#: Standard error of the torque per ampere up to which it is known, as a part of it.
KNOWN_CONSTANT = 0.25
#: Standard error of a constant that is taken from other joints, as a part of it.
DOUBT_OF_ANOTHER = 0.5
#: Weight, as a part of a joint's torque, from which on it is looked at.
LEAST_WEIGHT = 0.02
#: Part of the squared torque that remains, at most, with gravity along another direction.
MOUNTED_OTHERWISE = 0.5
#: Least turn of the base [rad].
LEAST_TURN = 0.03
#: Least strength of gravity along another direction, as a part of the model's.
LEAST_STRENGTH = 0.6
#: Largest such strength.
MOST_STRENGTH = 1.6
#: Standard errors from which on a sign is known.
KNOWN_SIGN = 3.0
#: Deviation of the torque per unit of the signal before any data.
SCALE_SIZE = 0.3
#: Part of a torque's variance that commands in another order may leave.
MOST_UNEXPLAINED = 0.3
#: Ratio of what commands leave to what they leave in another order.
OTHER_ORDER = 4.0


class Factor(NamedTuple):
    """A factor of a column of the torque, with its standard error; inf where none shows."""

    value: float
    error: float

    @property
    def sign(self) -> float:
        """Sign of the factor; 0 where it is not known."""
        return float(np.sign(self.value)) if abs(self.value) > KNOWN_SIGN * self.error else 0.0


class TorqueShape(NamedTuple):
    """
    The torque of one joint by what explains it.

    Attributes
    ----------
    weight : Factor
        Of the weight of the model.
    unexplained : float
        Part of the torque's variance that is left.

    """

    weight: Factor
    unexplained: float

    @property
    def shows_weight(self) -> bool:
        """Whether the factor of the weight is known."""
        value, error = self.weight
        return error < KNOWN_FACTOR * max(abs(value), LEAST_FACTOR)


def shape(data: Observations, joint: int, signal: int | None = None) -> TorqueShape:
    """Return the shape of the torque of a joint, or of another signal over its motion."""
    windows, used = data.windows, data.used[:, joint]
    if signal is not None:
        used = used & data.used[:, signal]
    torque = data.torque[used, joint if signal is None else signal]
    weight = windows.weight[used, joint]
    inertial = windows.model_torque[used, joint] - weight
    friction = _friction_columns(data, joint, used)
    apart = _least_squares(np.column_stack((weight, inertial, friction)), torque)
    is_shown = np.std(weight) > LEAST_WEIGHT * max(float(np.std(torque)), 1e-300)
    value, error = apart.factors[0]
    return TorqueShape(Factor(value, error if is_shown else np.inf), apart.unexplained)


def _friction_columns(data: Observations, joint: int, used: Flags) -> Array:
    """Return direction, velocity and a constant in some windows, shape (rows, 3)."""
    windows = data.windows
    return np.column_stack((windows.direction[used, joint], windows.velocity[used, joint],
                            np.ones(int(used.sum()))))


class _Solution(NamedTuple):
    """Factors of columns, and the part of the variance that is left."""

    factors: tuple[Factor, ...]
    unexplained: float


def _least_squares(columns: Array, target: Array) -> _Solution:
    """Return the factors of columns that leave least of a target."""
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
    return _Solution(tuple(map(Factor, (value / sizes).tolist(), (error / sizes).tolist())),
                     float(residual @ residual) / power if power > 0.0 else 1.0)


@dataclasses.dataclass(frozen=True)
class Conventions:
    """
    Factors that make a signal the torque of the model.

    Attributes
    ----------
    constant : ndarray, shape (n,)
        Torque at the joint per unit of the signal.
    findings : tuple of Finding
        What was noticed.
    errors : tuple of float, length n
        Standard errors of identified constants, inf where none is known; empty where the signal is
        a torque.

    """

    constant: Array
    findings: tuple[Finding, ...] = ()
    errors: tuple[float, ...] = ()

    def estimates(self) -> list[Estimate]:
        """Return the constants that were identified; none where the signal is a torque."""
        return [Estimate(float(value), 2.0 * error) if np.isfinite(error) else
                Estimate.unknown(Gap.NOT_SHOWN)
                for value, error in zip(self.constant, self.errors)]


def check_torque(data: Observations, signal: str) -> tuple[Finding, ...]:
    """
    Return findings on the joints whose torque has another unit than the others.

    Parameters
    ----------
    data : Observations
        Windows with the torque.
    signal : str
        Name of the torque, for messages.

    Raises
    ------
    CtcError
        If the torque has another unit, or no weight.

    """
    shapes = {joint: shape(data, joint) for joint in np.flatnonzero(data.moving).tolist()}
    weighing = {joint: found.weight for joint, found in shapes.items() if found.shows_weight}
    if not weighing:
        return ()
    # The joint with the median load decides: a tool is much for the joints near the tip.
    loads = np.array([float(np.std(data.windows.weight[:, joint])) for joint in weighing])
    factors = np.array([factor.value for factor in weighing.values()])
    order = np.argsort(factors)
    middle = int(np.searchsorted(np.cumsum(loads[order]), 0.5 * loads.sum()))
    median = float(factors[order][min(middle, len(order) - 1)])
    if not LEAST_FACTOR <= median <= MOST_FACTOR:
        raise CtcError(
            f'the {signal} has {median:.2g} times the weight of the model: it is no torque in '
            'N*m at the joint, or the model is another robot. For a current give --effort '
            'current; for another unit --torque-constant; for a robot that carries its weight '
            'itself --gravity 0')
    return tuple(_other_unit(joint, factor, signal)
                 for joint, factor in weighing.items() if not _is_possible(factor))


def _is_possible(factor: Factor) -> bool:
    """Return whether the weight may be that of a torque of this robot."""
    margin = 2.0 * factor.error
    return factor.value + margin > LEAST_FACTOR and factor.value - margin < MOST_FACTOR


def _other_unit(joint: int, factor: Factor, signal: str) -> Finding:
    """Return that a joint has much less, or much more, weight than the model."""
    reason, severity = ((Reason.TOOL, Severity.CARE) if factor.value > MOST_FACTOR else
                        (Reason.UNITS, Severity.REFUSED))
    return Finding(reason, severity, joint, {
        'signal': signal, 'factor': factor.value, 'error': 2.0 * factor.error})


def check_sign(data: Observations, joints: Sequence[str], signal: str) -> Conventions:
    """
    Return the signs of the torque; friction and inertia of the other sign would drive a joint.

    They have the same sign however the base is mounted. Where neither shows, the weight decides,
    though an arm that hangs from the ceiling has that with the other sign.

    Raises
    ------
    CtcError
        If the torque has the other sign.

    """
    moving = np.flatnonzero(data.moving).tolist()
    factors = {joint: _beside_any_gravity(data, joint).factors[:2] for joint in moving}
    evidence = {joint: sum(factor.sign for factor in found) for joint, found in factors.items()}
    weights = [found.weight.value for joint in moving
               if (found := shape(data, joint)).shows_weight]
    is_shown = any(factor.sign for found in factors.values() for factor in found)
    if (sum(evidence.values()) if is_shown else float(np.median(weights or [0.0]))) < 0.0:
        words = f', and {np.median(weights):.2f} times the weight of the model' if weights else ''
        cure = 'Turn the sign with --torque-constant=-1' if signal == EFFORT else (
            'Turn the sign of the recorded commands, or name their topic with --commands')
        raise CtcError(
            f'the {signal} has the other sign: friction or inertia below 0{words}. {cure}')
    constant = np.ones(len(joints))
    constant[[joint for joint in moving if evidence[joint] < 0.0]] = -1.0
    option = ','.join(f'{sign:g}' for sign in constant)
    return Conventions(constant, tuple(Finding(Reason.SIGN, Severity.REFUSED, joint, {
        'signal': signal, 'friction': factors[joint][0].value,
        'error': 2.0 * factors[joint][0].error, 'option': option})
        for joint in np.flatnonzero(constant < 0.0).tolist()))


def _beside_any_gravity(data: Observations, joint: int) -> _Solution:
    """Return the factors of direction and inertial torque, beside weight along any direction."""
    windows, used = data.windows, data.used[:, joint]
    direction, velocity, constant = _friction_columns(data, joint, used).T
    inertial = windows.model_torque[used, joint] - windows.weight[used, joint]
    pull = windows.bodies[used, joint, -3:] if windows.bodies.shape[2] else (
        windows.weight[used, joint][:, None])
    return _least_squares(np.column_stack((direction, inertial, velocity, constant, pull)),
                          data.torque[used, joint])


def constants_of_currents(data: Observations, joints: Sequence[str], rotors: Array,
                          efforts: Array) -> Conventions:
    """
    Return the torque per ampere of each joint.

    It is that with which the current carries the model. For a joint whose current does not show
    it, that of the others is taken, in proportion to the effort limits.

    Parameters
    ----------
    data : Observations
        Windows with the currents.
    joints : sequence of str, length n
        Names.
    rotors : ndarray, shape (J, n)
        Torque of the rotors that are assumed beside the model [N·m]. How much the constant changes
        without them is part of its error.
    efforts : ndarray, shape (n,)
        Effort limits [N·m]; 0 where there is none.

    """
    constant, errors, findings = np.ones(len(joints)), np.full(len(joints), np.inf), []
    model, unknown = data.windows.model_torque, []
    for joint in np.flatnonzero(data.moving).tolist():
        value, error = _carried(data, joint, model + rotors)
        error = float(np.hypot(error, value - _carried(data, joint, model).value))
        if error > KNOWN_CONSTANT * abs(value):
            unknown.append(joint)
            continue
        constant[joint], errors[joint] = 1.0 / value, error / value ** 2
        findings.append(Finding(Reason.URDF_CONSTANT, Severity.CARE, joint, {
            'constant': constant[joint], 'error': 2.0 * error / abs(value)}))
    shown = np.isfinite(errors) & (efforts > 0.0)
    per_effort = float(np.median(np.abs(constant[shown]) / efforts[shown])) if shown.any() else 0.0
    for joint in unknown:
        size = per_effort * efforts[joint]
        if not size:
            findings.append(Finding(Reason.NO_CONSTANT, Severity.REFUSED, joint))
            continue
        sign = _beside_any_gravity(data, joint).factors[0].sign or 1.0
        constant[joint], errors[joint] = sign * size, DOUBT_OF_ANOTHER * size
        findings.append(Finding(
            Reason.OTHERS_CONSTANT, Severity.CARE, joint, {'constant': constant[joint]}))
    return Conventions(constant, tuple(findings), tuple(errors.tolist()))


def _carried(data: Observations, joint: int, model_torque: Array) -> Factor:
    """Return the factor of a torque of the model, shape (J, n) [N·m], in that of a joint."""
    used = data.used[:, joint]
    columns = np.column_stack((model_torque[used, joint], _friction_columns(data, joint, used)))
    return _least_squares(columns, data.torque[used, joint]).factors[0]


def mounted_gravity(data: Observations, gravity: Array) -> Array:
    """
    Return gravity in the frame of the base, shape (3,) [m/s²]: that of the model, or another one.

    Parameters
    ----------
    data : Observations
        Windows with the torque, and with the columns of gravity.
    gravity : ndarray, shape (3,)
        That of the model [m/s²].

    """
    strength = float(np.linalg.norm(gravity))
    moving = np.flatnonzero(data.moving).tolist()
    if not strength or not moving or not data.windows.bodies.shape[2]:
        return gravity
    equations = [_gravity_equations(data, joint, gravity) for joint in moving]
    columns, target = (np.concatenate(parts) for parts in zip(*equations))
    other = np.linalg.lstsq(columns, target, rcond=1e-6)[0]
    # Across the plane of a planar arm gravity has no torque: there it stays as in the model.
    other += gravity - np.linalg.lstsq(columns, columns @ gravity, rcond=1e-6)[0]
    remaining = float(np.square(target - columns @ other).sum())
    share = remaining / max(float(np.square(target - columns @ gravity).sum()), 1e-300)
    size = float(np.linalg.norm(other))
    turned = np.asarray(strength * other / max(size, 1e-300), float)
    is_possible = LEAST_STRENGTH < size / strength < MOST_STRENGTH
    if share < MOUNTED_OTHERWISE and is_possible and angle_between(gravity, turned) > LEAST_TURN:
        return turned
    return gravity


def _gravity_equations(data: Observations, joint: int, gravity: Array) -> tuple[Array, Array]:
    """Return columns of gravity and the torque without inertial torque, beside friction."""
    windows, used = data.windows, data.used[:, joint]
    scale = 1.0 / float(data.deviation[joint])
    pull = windows.bodies[used, joint, -3:]
    torque = data.beyond_model[used, joint] + pull @ gravity
    beside = np.column_stack((
        _friction_columns(data, joint, used), windows.acceleration[used, joint]))
    basis = np.linalg.qr(beside)[0]
    return (scale * (pull - basis @ (basis.T @ pull)),
            scale * (torque - basis @ (basis.T @ torque)))


def angle_between(a: Array, b: Array) -> float:
    """Return the angle between two vectors, exact also for small ones [rad]."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    return float(2.0 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b)))


def check_order(data: Observations, joints: Sequence[str]) -> None:
    """Raise `CtcError` if the columns of commands fit other joints better."""
    moving = np.flatnonzero(data.moving).tolist()
    if len(moving) < 2:
        return
    unexplained = np.array([[max(shape(data, joint, signal).unexplained, 1e-4)
                             for joint in moving] for signal in moving])
    _, fitting = linear_sum_assignment(np.log(unexplained))
    here = np.arange(len(moving))
    moved = fitting != here
    as_recorded = unexplained.diagonal()[moved]
    otherwise = unexplained[here, fitting][moved]
    if moved.any() and (otherwise < MOST_UNEXPLAINED).all() and (
            np.log(as_recorded / otherwise).mean() > np.log(OTHER_ORDER)):
        raise CtcError(
            f'the commands do not fit the joints in the order {",".join(joints)}: they leave '
            f"{as_recorded.max():.0%} of a joint's torque unexplained, and {otherwise.max():.0%} "
            'in another order; give --joints in their order')


class ScaledTorque(NamedTuple):
    """Windows with the torque at the joints, and that torque per unit of the signal."""

    data: Observations
    constant: list[Estimate]


def payload_scale(data: Observations, prior: BodyPrior) -> ScaledTorque:
    """
    Return windows with the torque that a known payload shows to be at the joints.

    Motions with and without a known payload tell torque constants from masses: the payload is in
    the torque of the model, and the bodies are the same in all of them.

    Parameters
    ----------
    data : Observations
        Windows of motions with and without a known payload.
    prior : BodyPrior
        Of the bodies.

    """
    moving = np.flatnonzero(data.moving).tolist()
    terms = [term for joint in moving for term in basic_terms(data, joint)]
    scales = [FrictionTerm(TermKind.SCALE, joint, SCALE_SIZE) for joint in moving]
    solution = fit(data, Unknowns(prior, (*terms, *scales)))
    constant = np.ones(data.joint_count)
    estimates = [Estimate.unknown(Gap.HARDLY_MOVES)] * data.joint_count
    for joint in moving:
        row = solution.unknowns.row(joint, TermKind.SCALE)
        # The signal is 1 + x times the torque.
        constant[joint] = 1.0 / (1.0 + float(row @ solution.value))
        half = float(solution.half_interval(row)) * constant[joint] ** 2
        estimates[joint] = Estimate(float(constant[joint]), half)
    return ScaledTorque(data.scaled(constant), estimates)

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
factor of its own, beside friction. Factors of the weight far from 1 mean another unit; weight and
friction below 0 mean the other sign; and where gravity along another direction of the base
explains the torque much better, the base is mounted that way.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import NamedTuple

from ctc_chattering.errors import CtcError
from ctc_chattering.identification.findings import Estimate, Finding, Reason, Severity
from ctc_chattering.identification.friction_terms import FrictionTerm, TermKind
from ctc_chattering.identification.prior import BodyPrior
from ctc_chattering.identification.regression import correlation_length, Observations, fit, Unknowns
from ctc_chattering.identification.selection import basic_terms
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.optimize import linear_sum_assignment  # type: ignore[import-untyped]

#: Factors of the model's weight beyond which a torque has another unit.
LEAST_FACTOR, MOST_FACTOR = 0.5, 2.0
#: Standard error of such a factor, as a part of it, up to which it is known.
KNOWN_FACTOR = 0.15
#: Standard error of the torque per unit of a current up to which it is known, as a part of it.
KNOWN_CONSTANT = 0.25
#: Weight, as a part of a joint's torque, from which on it is looked at.
LEAST_WEIGHT = 0.02
#: Part of the squared torque that remains with gravity along another direction.
MOUNTED_OTHERWISE = 0.5
#: Least turn of the base [rad], and strengths of gravity that are possible, as a part of it.
LEAST_TURN, LEAST_STRENGTH, MOST_STRENGTH = 0.03, 0.6, 1.6
#: Standard errors from which on the sign of friction is known.
KNOWN_SIGN = 3.0
#: Deviation of the torque per unit of the signal before any data.
SCALE_SIZE = 0.3
#: Part of a torque's variance that commands may leave, and ratio to that in another order.
MOST_UNEXPLAINED, OTHER_ORDER = 0.3, 4.0


class Shape(NamedTuple):
    """
    The torque of one joint by what explains it.

    Attributes
    ----------
    weight, weight_error : float
        Factor of the weight of the model, and its standard error; inf where it is not shown.
    whole, whole_error : float
        Factor of weight and inertial torque together.
    friction, friction_error : float
        Coulomb friction [unit of the torque].
    unexplained : float
        Part of the torque's variance that is left.

    """

    weight: float
    weight_error: float
    whole: float
    whole_error: float
    friction: float
    friction_error: float
    unexplained: float

    @property
    def weight_is_known(self) -> bool:
        """Whether the factor of the weight is known."""
        return self.weight_error < KNOWN_FACTOR * abs(self.weight) or (
            self.weight_error < KNOWN_FACTOR * LEAST_FACTOR)


def shape(data: Observations, joint: int, signal: int | None = None) -> Shape:
    """Return the shape of the torque of a joint, or of another signal over its motion."""
    windows, used = data.windows, data.used[:, joint]
    if signal is not None:
        used = used & data.used[:, signal]
    torque = data.torque[used, joint if signal is None else signal]
    weight = windows.weight[used, joint]
    inertial = windows.model_torque[used, joint] - weight
    friction = np.column_stack((windows.direction[used, joint], windows.velocity[used, joint],
                                np.ones(len(torque))))
    apart = _least_squares(np.column_stack((weight, inertial, friction)), torque)
    together = _least_squares(np.column_stack((weight + inertial, friction)), torque)
    shown = np.std(weight) > LEAST_WEIGHT * max(float(np.std(torque)), 1e-300)
    return Shape(apart.value[0], apart.error[0] if shown else np.inf, together.value[0],
                 together.error[0], apart.value[2], apart.error[2], apart.unexplained)


class _Solution(NamedTuple):
    """Coefficients of columns with their standard errors, and the part of variance left."""

    value: Array
    error: Array
    unexplained: float


def _least_squares(columns: Array, target: Array) -> _Solution:
    """Return the coefficients of columns that leave least of a target."""
    sizes = np.maximum(np.abs(columns).max(axis=0, initial=0.0), 1e-300)
    value, _, rank, _ = np.linalg.lstsq(columns / sizes, target, rcond=1e-9)
    residual = target - columns @ (value / sizes)
    variance = float(residual @ residual) / max(len(target) - len(value), 1)
    variance *= correlation_length(residual)
    normal = np.linalg.pinv((columns / sizes).T @ (columns / sizes), rcond=1e-12)
    error = np.sqrt(np.maximum(variance * normal.diagonal(), 0.0))
    if rank < len(value):
        error = np.where(np.abs(columns).max(axis=0) > 0.0, error, np.inf)
    power = float(np.square(target - target.mean()).sum()) if len(target) else 0.0
    return _Solution(value / sizes, error / sizes,
                     float(residual @ residual) / power if power > 0.0 else 1.0)


@dataclasses.dataclass(frozen=True)
class Conventions:
    """
    What a torque needs to be that of the model.

    Attributes
    ----------
    constant : ndarray, shape (n,)
        Torque at the joint per unit of the signal.
    findings : tuple of Finding
        What was noticed.
    errors : tuple of float, length n
        Standard errors of identified constants, inf where none is known; empty for given ones.

    """

    constant: Array
    findings: tuple[Finding, ...] = ()
    errors: tuple[float, ...] = ()

    def estimates(self) -> list[Estimate]:
        """Return the constants that were identified; none where they are 1 by declaration."""
        return [Estimate(float(value), 2.0 * error) if np.isfinite(error) else
                Estimate.unknown('the motion does not show it')
                for value, error in zip(self.constant, self.errors)]


def check_torque(data: Observations, joints: Sequence[str], signal: str) -> tuple[Finding, ...]:
    """
    Return the joints whose torque has another unit than the others.

    Parameters
    ----------
    data : Observations
        Windows with the torque.
    joints : sequence of str, length n
        Names.
    signal : str
        Name of the torque, for messages.

    Raises
    ------
    CtcError
        If the torque has another unit, or no weight.

    """
    moving = np.flatnonzero(data.moving).tolist()
    shapes = {joint: shape(data, joint) for joint in moving}
    known = [joint for joint in moving if shapes[joint].weight_is_known]
    if not known:
        return ()
    loads = np.array([float(np.std(data.windows.weight[:, joint])) for joint in known])
    factors = np.array([shapes[joint].weight for joint in known])
    # The joint with the median load decides: a wrong tool is much for joints near the tip.
    order = np.argsort(factors)
    middle = int(np.searchsorted(np.cumsum(loads[order]), 0.5 * loads.sum()))
    factor = float(factors[order][min(middle, len(order) - 1)])
    if not LEAST_FACTOR <= factor <= MOST_FACTOR:
        raise CtcError(
            f'the {signal} has {factor:.2g} times the weight of the model: it is no torque in '
            'N*m at the joint, or the model is another robot. For a current give --effort '
            'current; for another unit --torque-constant; for a robot that carries its weight '
            'itself --gravity 0')
    return tuple(_other_unit(joints[joint], joint, shapes[joint], signal)
                 for joint in known if not _possible(shapes[joint]))


def _possible(found: Shape) -> bool:
    """Return whether the factor of the weight may be that of a torque of this robot."""
    margin = 2.0 * found.weight_error
    return found.weight + margin > LEAST_FACTOR and found.weight - margin < MOST_FACTOR


def _other_unit(name: str, joint: int, found: Shape, signal: str) -> Finding:
    """Return that a joint has much less, or much more, weight than the model."""
    heavy = found.weight > MOST_FACTOR
    return Finding(
        Reason.UNITS, Severity.CARE if heavy else Severity.REFUSED, joint,
        f'the {signal} of {name} has {found.weight:.2g} ± {2.0 * found.weight_error:.1g} times '
        'the weight of the model: ' + (
            'a tool or payload that the URDF lacks, or another unit' if heavy else
            'another unit, another gear ratio, or a wrong mass in the URDF'),
        'add the tool to the URDF' if heavy else 'give --torque-constant, or correct the URDF')


def check_sign(data: Observations, joints: Sequence[str], signal: str) -> None:
    """
    Raise `CtcError` if a torque has the other sign: friction then drives the joints.

    Without clear friction the weight decides: with the other sign it is that of an arm that hangs
    from the ceiling.
    """
    moving = np.flatnonzero(data.moving).tolist()
    friction = [_least_squares(*_beside_any_gravity(data, joint)) for joint in moving]
    signs = [np.sign(x.value[0]) for x in friction if abs(x.value[0]) > KNOWN_SIGN * x.error[0]]
    weights = [x.weight for x in (shape(data, joint) for joint in moving) if x.weight_is_known]
    evidence = float(np.mean(signs)) if signs else float(np.median([*weights, 0.0, 0.0][:max(
        len(weights), 1)]))
    if evidence < 0.0:
        flipped = ','.join(['-1'] * len(joints))
        raise CtcError(
            f'the {signal} has the other sign: friction in it drives the joints, and its weight '
            f'is {np.median([*weights, *[np.nan] * (not weights)]):.2f} times that of the model; '
            f'turn the sign with --torque-constant={flipped}')


def _beside_any_gravity(data: Observations, joint: int) -> tuple[Array, Array]:
    """Return columns of friction, then of weight along any direction, and the torque."""
    windows, used = data.windows, data.used[:, joint]
    inertial = windows.model_torque[used, joint] - windows.weight[used, joint]
    pull = windows.bodies[used, joint, -3:] if windows.bodies.shape[2] else (
        windows.weight[used, joint][:, None])
    return np.column_stack((
        windows.direction[used, joint], windows.velocity[used, joint], np.ones(int(used.sum())),
        inertial, pull)), data.torque[used, joint]


def constants_of_currents(data: Observations, joints: Sequence[str]) -> Conventions:
    """Return the torque per ampere of each joint for which the currents carry the model."""
    constant, findings = np.ones(len(joints)), []
    errors = [np.inf] * len(joints)
    for joint in np.flatnonzero(data.moving).tolist():
        found = shape(data, joint)
        if found.whole_error > KNOWN_CONSTANT * abs(found.whole):
            findings.append(Finding(
                Reason.SCALE, Severity.REFUSED, joint, f'the current of {joints[joint]} shows '
                'neither weight nor inertia of the model: its torque constant is not known',
                'give --torque-constant with N*m at the joint per ampere'))
            continue
        constant[joint] = 1.0 / found.whole
        errors[joint] = found.whole_error / found.whole ** 2
        findings.append(Finding(
            Reason.SCALE, Severity.CARE, joint, f'its torque constant is taken from the weight '
            f'and inertia of the URDF: {constant[joint]:.3g} N*m per ampere ± '
            f'{2.0 * found.whole_error / abs(found.whole):.0%}, and all its numbers are as wrong '
            'as the masses of the URDF', 'give --torque-constant of the data sheet'))
    return Conventions(constant, tuple(findings), tuple(errors))


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
    moving = np.flatnonzero(data.moving)
    if not strength or not len(moving) or not data.windows.bodies.shape[2]:
        return gravity
    columns, targets, before = [], [], 0.0
    for joint in moving.tolist():
        used, windows = data.used[:, joint], data.windows
        size = 1.0 / float(data.deviation[joint])
        pull = windows.bodies[used, joint, -3:]
        own = np.column_stack((
            windows.direction[used, joint], windows.velocity[used, joint],
            np.ones(int(used.sum())), windows.acceleration[used, joint]))
        basis = np.linalg.qr(own)[0]
        torque = data.beyond_model[used, joint] + pull @ gravity

        def remaining(x: Array, basis: Array = basis) -> Array:
            return np.asarray(x - basis @ (basis.T @ x))
        columns.append(size * remaining(pull))
        targets.append(size * remaining(torque))
        before += float(np.square(targets[-1] - columns[-1] @ gravity).sum())
    whole, target = np.concatenate(columns), np.concatenate(targets)
    other = np.linalg.lstsq(whole, target, rcond=1e-6)[0]
    # Across the plane of a planar arm gravity has no torque: there it stays as in the model.
    other += gravity - np.linalg.lstsq(whole, whole @ gravity, rcond=1e-6)[0]
    after = float(np.square(target - whole @ other).sum())
    part = float(np.linalg.norm(other)) / strength
    turned = np.asarray(strength * other / max(float(np.linalg.norm(other)), 1e-300), float)
    if after < MOUNTED_OTHERWISE * before and LEAST_STRENGTH < part < MOST_STRENGTH and (
            angle_between(gravity, turned) > LEAST_TURN):
        return turned
    return gravity


def angle_between(a: Array, b: Array) -> float:
    """Return the angle between two vectors, exact also for small ones [rad]."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    return float(2.0 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b)))


def check_order(data: Observations, joints: Sequence[str]) -> None:
    """Raise `CtcError` if the columns of commands fit other joints better."""
    moving = np.flatnonzero(data.moving).tolist()
    if len(moving) < 2:
        return
    left = np.array([[max(shape(data, joint, signal).unexplained, 1e-4) for joint in moving]
                     for signal in moving])
    _, fitting = linear_sum_assignment(np.log(left))
    as_given, best = left.diagonal(), left[np.arange(len(moving)), fitting]
    moved = fitting != np.arange(len(moving))
    if (moved.any() and (best[moved] < MOST_UNEXPLAINED).all()
            and np.log(as_given[moved] / best[moved]).mean() > np.log(OTHER_ORDER)):
        raise CtcError(
            f'the commands do not fit the joints in the order {",".join(joints)}: they leave '
            f"{as_given[moved].max():.0%} of a joint's torque unexplained, and "
            f'{best[moved].max():.0%} in another order; give --joints in their order')


def payload_scale(data: Observations, prior: BodyPrior) -> tuple[Observations, list[Estimate]]:
    """
    Return the windows with the torque at the joints, and that torque per unit of the signal.

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
    found = fit(data, Unknowns(prior, (*terms, *scales)))
    constant = np.ones(data.joint_count)
    estimates = [Estimate.unknown('the joint hardly moves')] * data.joint_count
    for joint in moving:
        index = found.unknowns.index(joint, TermKind.SCALE)
        assert index is not None
        row = np.eye(found.unknowns.count)[index] * SCALE_SIZE
        # The signal is 1 + x times the torque.
        constant[joint] = 1.0 / (1.0 + float(row @ found.value))
        half = float(found.half_interval(row)) * constant[joint] ** 2
        estimates[joint] = Estimate(float(constant[joint]), half)
    return data.scaled(constant), estimates

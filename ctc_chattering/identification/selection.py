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
Selection of the terms of friction: those without which unseen torque is predicted worse.

Every joint in motion has Coulomb friction, viscous friction and an offset. Stribeck friction,
friction of the load, a dead band of the drive and friction of a coupled joint are tried one by
one: a term stays if it makes the torque of blocks of time that were left out clearly smaller.
"""

from __future__ import annotations

from collections.abc import Iterator
import dataclasses
from typing import NamedTuple

from ctc_chattering.identification.friction_terms import (
    ALWAYS,
    FrictionTerm,
    NOT_NEGATIVE,
    TermKind,
)
from ctc_chattering.identification.prior import BodyPrior
from ctc_chattering.identification.regression import (
    BLOCKS,
    blocks_of_time,
    FEWEST_WINDOWS,
    Fit,
    fit,
    mean_sign,
    Observations,
    resting_weight,
    static_friction,
    Unknowns,
)
from ctc_chattering.identification.windows import STRIBECK_VELOCITIES
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.optimize import minimize_scalar  # type: ignore[import-untyped]

#: Deviation of Coulomb and viscous friction, over the deviation of the joint's torque, and over
#: that and the largest velocity.
FRICTION_SIZE = 10.0
#: Deviation of an offset, over the deviation of the joint's torque.
OFFSET_SIZE = 1.0
#: Deviation of other terms, over the deviation of the joint's torque.
OTHER_SIZE = 3.0
#: Deviation of friction as a part of the load.
LOAD_SIZE = 0.3
#: Velocity, over that of Stribeck friction, at which it has faded.
FADED = 1.5
#: Part of the squared torque that a term must take away where it was left out.
LEAST_GAIN = 0.1
#: Part that terms of another joint must take away, which no law compensates.
LEAST_COUPLED_GAIN = 0.7
#: Blocks of time in which a term must help.
LEAST_BLOCKS = 7
#: Most terms that are added to a joint.
MOST_ADDED = 3
#: Part of the power of a term that other terms of its joint may have: beyond it, data do not tell
#: them apart.
MOST_ALIKE = 0.95


class Option(NamedTuple):
    """Terms that are added together, and the gain that they must have."""

    terms: tuple[FrictionTerm, ...]
    least_gain: float = LEAST_GAIN


def friction_sizes(data: Observations, joint: int) -> dict[TermKind, float]:
    """Return the deviation of each kind of friction before any data."""
    torque, speed = float(data.deviation[joint]), float(data.fastest[joint])
    return {TermKind.COULOMB: FRICTION_SIZE * torque, TermKind.OFFSET: OFFSET_SIZE * torque,
            TermKind.VISCOUS: FRICTION_SIZE * torque / speed, TermKind.LOAD: LOAD_SIZE,
            TermKind.STRIBECK: OTHER_SIZE * torque, TermKind.DEAD_BAND: OTHER_SIZE * torque,
            TermKind.COUPLED_COULOMB: OTHER_SIZE * torque,
            TermKind.COUPLED_VISCOUS: OTHER_SIZE * torque / speed}


def basic_terms(data: Observations, joint: int) -> list[FrictionTerm]:
    """Return the terms that every joint in motion has."""
    sizes = friction_sizes(data, joint)
    return [FrictionTerm(kind, joint, sizes[kind]) for kind in ALWAYS]


def friction_columns(data: Observations, joint: int) -> Array:
    """Return the columns of these terms, shape (J, 3) [N·m]."""
    return np.column_stack([term.column(data.windows, data.drive_sign)
                            for term in basic_terms(data, joint)])


class Selected(NamedTuple):
    """
    The selected terms.

    Attributes
    ----------
    best, basic : Fit
        The regression with the terms that predict unseen torque best, and with the basic ones.
    curved : tuple of int
        Joints of which friction that is quadratic in the velocity predicts as well as Stribeck
        friction.

    """

    best: Fit
    basic: Fit
    curved: tuple[int, ...] = ()


def select(data: Observations, prior: BodyPrior, commanded: bool) -> Selected:
    """
    Return the regression with the terms that predict unseen torque best.

    Parameters
    ----------
    data : Observations
        The windows.
    prior : BodyPrior
        Of the bodies.
    commanded : bool
        Whether torques are commands, of which a drive may take a dead band.

    """
    moving = np.flatnonzero(data.moving).tolist()
    terms = [term for joint in moving for term in basic_terms(data, joint)]
    basic = fit(data, Unknowns(prior, tuple(terms)))
    predicted = data.windows.model_torque + basic.held_out
    data = dataclasses.replace(data, drive_sign=mean_sign(predicted))
    best = dataclasses.replace(basic, data=data)
    for _ in range(MOST_ADDED):
        added = [term for joint in moving for term in _best_option(best, joint, commanded)]
        if not added:
            break
        terms += added
        best = fit(data, Unknowns(prior, tuple(terms)))
    curved = tuple(joint for joint in moving if _is_quadratic(basic, best, joint))
    return Selected(best, basic, curved)


def _is_quadratic(basic: Fit, best: Fit, joint: int) -> bool:
    """Return whether quadratic friction predicts as well as the Stribeck friction of a joint."""
    index = best.unknowns.index(joint, TermKind.STRIBECK)
    if index is None:
        return False
    trial, stribeck = _JointTrial(basic, joint), best.unknowns.term(index)
    quadratic = stribeck._replace(kind=TermKind.QUADRATIC)
    return bool(trial.squares((quadratic,)).sum() <= trial.squares((stribeck,)).sum())


def _options(data: Observations, joint: int, commanded: bool) -> Iterator[Option]:
    """Yield the terms that may be added to a joint."""
    sizes = friction_sizes(data, joint)
    speed = np.abs(data.windows.velocity[data.used[:, joint], joint])
    for k, velocity in enumerate(STRIBECK_VELOCITIES):
        slow, fast = (speed < velocity).sum(), (speed > FADED * velocity).sum()
        if min(slow, fast) >= FEWEST_WINDOWS:
            yield Option((FrictionTerm(TermKind.STRIBECK, joint, sizes[TermKind.STRIBECK], k),))
    yield Option((FrictionTerm(TermKind.LOAD, joint, sizes[TermKind.LOAD]),))
    if commanded:
        yield Option((FrictionTerm(TermKind.DEAD_BAND, joint, sizes[TermKind.DEAD_BAND]),))
    coupled = (TermKind.COUPLED_COULOMB, TermKind.COUPLED_VISCOUS)
    for other in np.flatnonzero(data.moving).tolist():
        if other != joint:
            terms = tuple(FrictionTerm(kind, joint, sizes[kind], other) for kind in coupled)
            yield Option(terms, LEAST_COUPLED_GAIN)


def _best_option(solution: Fit, joint: int, commanded: bool) -> tuple[FrictionTerm, ...]:
    """Return the terms that help a joint most, or none."""
    unknowns = solution.unknowns
    present = {unknowns.term(k).kind for k in unknowns.of_joint(joint)}
    trial = _JointTrial(solution, joint)
    best_gain = 0.0
    best_terms: tuple[FrictionTerm, ...] = ()
    for option in _options(solution.data, joint, commanded):
        if option.terms[0].kind in present or trial.alike(option.terms[0]) > MOST_ALIKE:
            continue
        squares = trial.squares(option.terms)
        gain = 1.0 - float(squares.sum() / trial.without.sum())
        helps = (squares < trial.without).sum() >= LEAST_BLOCKS
        if helps and gain > max(option.least_gain, best_gain):
            best_gain, best_terms = gain, option.terms
    if best_terms and best_terms[0].kind == TermKind.STRIBECK:
        return (_refined(trial, best_terms[0]),)
    return best_terms


def _refined(trial: _JointTrial, term: FrictionTerm) -> FrictionTerm:
    """Return a term of Stribeck friction with the velocity that predicts best, near its own."""
    low, high = max(term.which - 1.0, 0.0), min(term.which + 1.0, len(STRIBECK_VELOCITIES) - 1.0)
    best = minimize_scalar(lambda x: trial.squares((term._replace(which=x),)).sum(),
                           bounds=(low, high), method='bounded', options={'xatol': 0.02})
    return term._replace(which=float(best.x))


class _JointTrial:
    """Friction of one joint fitted anew with further terms, the bodies staying as they are."""

    def __init__(self, solution: Fit, joint: int) -> None:
        data, unknowns = solution.data, solution.unknowns
        used = data.used[:, joint]
        columns = unknowns.columns(data, joint)[used]
        bodies = unknowns.body_count
        self._data, self._used = data, used
        self._block = blocks_of_time(len(used))[used]
        # Not those of outliers: what a term explains is an outlier without it.
        self._weight = np.sqrt(resting_weight(
            data.windows.resting[used, joint],
            static_friction(unknowns, joint, solution.value),
            float(solution.noise.deviation[joint])))
        self._friction = columns[:, unknowns.of_joint(joint)]
        # What each block's bodies leave, of all windows: those of other blocks are fitted.
        self._targets = [data.beyond_model[used, joint] - columns[:, :bodies] @ value[:bodies]
                         for value in solution.left_out]
        self._ridge = 1.0 / float(np.sqrt(solution.noise.information[joint]))
        self.without = self.squares(())

    def alike(self, term: FrictionTerm) -> float:
        """Return the part of the power of a term that the terms of the joint have already."""
        weight = self._weight[:, None]
        column = term.column(self._data.windows, self._data.drive_sign)[self._used] * weight[:, 0]
        basis = np.linalg.qr(self._friction * weight)[0]
        power = float(column @ column)
        return float(np.square(basis.T @ column).sum()) / power if power else 1.0

    def squares(self, terms: tuple[FrictionTerm, ...]) -> Array:
        """
        Return the sum of squares of each block, as the others predict it, with more terms.

        It is infinite where a coefficient cannot be what the others say.
        """
        added = [term.column(self._data.windows, self._data.drive_sign)[self._used]
                 for term in terms]
        columns = np.column_stack((self._friction, *added)) * self._weight[:, None]
        ridge = self._ridge * np.eye(columns.shape[1])
        first = self._friction.shape[1]
        not_negative = [first + k for k, term in enumerate(terms) if term.kind in NOT_NEGATIVE]
        squares = np.zeros(BLOCKS)
        for k, target in enumerate(self._targets):
            left_out = self._block == k
            if not left_out.any():
                continue
            y = self._weight * target
            value = np.linalg.lstsq(
                np.vstack((columns[~left_out], ridge)),
                np.concatenate((y[~left_out], np.zeros(len(ridge)))), rcond=None)[0]
            squares[k] = np.square(y[left_out] - columns[left_out] @ value).sum()
            if (value[not_negative] < 0.0).any():
                squares[k] = np.inf
        return squares

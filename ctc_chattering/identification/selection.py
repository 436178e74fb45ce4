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
Selection of the terms of friction that predict unseen torque.

Every joint in motion has Coulomb friction, viscous friction and an offset. Stribeck friction,
friction of the load, a dead band of the drive and friction of a coupled joint are tried one by
one. A term stays if it makes the unexplained torque of blocks that were left out clearly smaller.
`identify` takes the selected regression as its result.
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


@dataclasses.dataclass(frozen=True)
class SelectionLimits:
    """Conditions on a term that is added to a joint."""

    #: Part of the squared torque that it takes away in blocks that were left out.
    min_gain: float = 0.1
    #: The same of terms of another joint, which no law compensates.
    min_coupled_gain: float = 0.7
    #: Blocks of time in which it helps.
    min_blocks: int = 7
    #: Number of terms that are added to a joint.
    max_added: int = 3
    #: Part of its power that other terms of the joint may have. Beyond it, data do not tell them
    #: apart.
    max_alike: float = 0.95
    #: Velocity at which Stribeck friction has faded, over its own.
    faded: float = 1.5


SELECTION = SelectionLimits()


class Option(NamedTuple):
    """Terms that are added together, with their required gain."""

    terms: tuple[FrictionTerm, ...]
    min_gain: float = SELECTION.min_gain


def friction_sizes(data: Observations, joint: int) -> dict[TermKind, float]:
    """Return the prior deviation of each kind of friction."""
    torque, speed = float(data.deviation[joint]), float(data.fastest[joint])
    return {
        TermKind.COULOMB: 10.0 * torque,
        TermKind.OFFSET: torque,
        TermKind.VISCOUS: 10.0 * torque / speed,
        TermKind.LOAD: 0.3,
        TermKind.STRIBECK: 3.0 * torque,
        TermKind.DEAD_BAND: 3.0 * torque,
        TermKind.COUPLED_COULOMB: 3.0 * torque,
        TermKind.COUPLED_VISCOUS: 3.0 * torque / speed,
    }


def basic_terms(data: Observations, joint: int) -> list[FrictionTerm]:
    """Return the terms that every joint in motion has."""
    sizes = friction_sizes(data, joint)
    return [FrictionTerm(x, joint, sizes[x]) for x in ALWAYS]


def friction_columns(data: Observations, joint: int) -> Array:
    """Return the columns of these terms, shape (J, 3) [N·m]."""
    return np.column_stack(
        [term.column(data.windows, data.drive_sign) for term in basic_terms(data, joint)]
    )


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
    for _ in range(SELECTION.max_added):
        added = [term for joint in moving for term in _best_option(best, joint, commanded)]
        if not added:
            break
        terms += added
        best = fit(data, Unknowns(prior, tuple(terms)))
    curved = tuple(joint for joint in moving if _is_quadratic(basic, best, joint))
    return Selected(best, basic, curved)


def _is_quadratic(basic: Fit, best: Fit, joint: int) -> bool:
    """Return whether quadratic friction predicts as well as Stribeck's."""
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
        slow, fast = (speed < velocity).sum(), (speed > SELECTION.faded * velocity).sum()
        if min(slow, fast) >= FEWEST_WINDOWS:
            yield Option((FrictionTerm(TermKind.STRIBECK, joint, sizes[TermKind.STRIBECK], k),))
    yield Option((FrictionTerm(TermKind.LOAD, joint, sizes[TermKind.LOAD]),))
    if commanded:
        yield Option((FrictionTerm(TermKind.DEAD_BAND, joint, sizes[TermKind.DEAD_BAND]),))
    coupled = (TermKind.COUPLED_COULOMB, TermKind.COUPLED_VISCOUS)
    for index in np.flatnonzero(data.moving).tolist():
        if index != joint:
            terms = tuple(FrictionTerm(x, joint, sizes[x], index) for x in coupled)
            yield Option(terms, SELECTION.min_coupled_gain)


def _best_option(solution: Fit, joint: int, commanded: bool) -> tuple[FrictionTerm, ...]:
    """Return the terms that help a joint most, or none."""
    unknowns = solution.unknowns
    present = {unknowns.term(k).kind for k in unknowns.of_joint(joint)}
    trial = _JointTrial(solution, joint)
    best_gain = 0.0
    best_terms: tuple[FrictionTerm, ...] = ()
    for option in _options(solution.data, joint, commanded):
        if option.terms[0].kind in present or trial.alike(option.terms[0]) > SELECTION.max_alike:
            continue
        squares = trial.squares(option.terms)
        gain = 1.0 - float(squares.sum() / trial.without.sum())
        helps = (squares < trial.without).sum() >= SELECTION.min_blocks
        if helps and gain > max(option.min_gain, best_gain):
            best_gain, best_terms = gain, option.terms
    if best_terms and best_terms[0].kind == TermKind.STRIBECK:
        return (_refined(trial, best_terms[0]),)
    return best_terms


def _refined(trial: _JointTrial, term: FrictionTerm) -> FrictionTerm:
    """Return a Stribeck term with the best velocity nearby."""
    low, high = max(term.which - 1.0, 0.0), min(term.which + 1.0, len(STRIBECK_VELOCITIES) - 1.0)
    best = minimize_scalar(
        lambda x: trial.squares((term._replace(which=x),)).sum(),
        bounds=(low, high),
        method='bounded',
        options={'xatol': 0.02},
    )
    return term._replace(which=float(best.x))


class _JointTrial:
    """Friction of one joint, fitted anew with further terms."""

    def __init__(self, solution: Fit, joint: int) -> None:
        data, unknowns = solution.data, solution.unknowns
        used = data.used[:, joint]
        columns = unknowns.columns(data, joint)[used]
        bodies = unknowns.body_count
        self._data, self._used = data, used
        self._block = blocks_of_time(len(used))[used]
        # Outliers keep their weight: a torque that a term explains is an outlier without it.
        self._weight = np.sqrt(
            resting_weight(
                data.windows.resting[used, joint],
                static_friction(unknowns, joint, solution.value),
                float(solution.noise.deviation[joint]),
            )
        )
        self._friction = columns[:, unknowns.of_joint(joint)]
        # The torque that the bodies without each block leave, in all windows.
        self._targets = [
            data.beyond_model[used, joint] - columns[:, :bodies] @ value[:bodies]
            for value in solution.left_out
        ]
        self._ridge = 1.0 / float(np.sqrt(solution.noise.information[joint]))
        self.without = self.squares(())

    def alike(self, term: FrictionTerm) -> float:
        """Return the part of a term's power in present terms."""
        weight = self._weight[:, None]
        column = term.column(self._data.windows, self._data.drive_sign)[self._used] * weight[:, 0]
        basis = np.linalg.qr(self._friction * weight)[0]
        power = float(column @ column)
        return float(np.square(basis.T @ column).sum()) / power if power else 1.0

    def squares(self, terms: tuple[FrictionTerm, ...]) -> Array:
        """
        Return the unexplained squares of each block with more terms.

        The other blocks predict it. It is infinite where they give an impossible coefficient.
        """
        added = [
            term.column(self._data.windows, self._data.drive_sign)[self._used] for term in terms
        ]
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
                np.concatenate((y[~left_out], np.zeros(len(ridge)))),
                rcond=None,
            )[0]
            squares[k] = np.square(y[left_out] - columns[left_out] @ value).sum()
            if (value[not_negative] < 0.0).any():
                squares[k] = np.inf
        return squares

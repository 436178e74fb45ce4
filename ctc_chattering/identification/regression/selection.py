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
The regression with the columns that the data contain: friction beside the errors of the model.

Where few causes explain the errors, these are its columns; else all that the motion shows of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses

from ctc_chattering.identification.regression.attribution import (
    explain,
    Explanation,
    possible,
    Projected,
    without_noise,
)
from ctc_chattering.identification.regression.causes import ALL, Cause, CauseKind, DRIVE
from ctc_chattering.identification.regression.error_columns import ErrorColumns
from ctc_chattering.identification.regression.friction_terms import (
    coulomb_level,
    friction_terms,
    further_terms,
    refined,
    without_weak,
)
from ctc_chattering.identification.regression.intervals import Spread, spread
from ctc_chattering.identification.regression.least_squares import (
    BENT,
    Data,
    Fit,
    solve,
    Term,
    TermKind,
)
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Most causes that are believed: with more, others would explain as much.
_CAUSES = 3
#: Deviation of a torque constant where the motion does not show it.
_SCALE = 0.03
#: Largest part that all torques together are in doubt by.
_COMMON = 0.06
#: By how much more, as it is an estimate itself.
_MARGIN = 1.1
#: Part of the difference between both forms of load-dependent friction that is in doubt.
_FORM = 0.05
#: Part of a joint's torque that errors of the model may have without a name.
_TRIFLE = 1e-3
#: Terms of what drives make of commands.
_DRIVE = (TermKind.SCALE, *BENT)
#: Halves of an interval by which friction may differ beside causes and beside all errors.
_AGREES = 2.0


@dataclasses.dataclass(frozen=True)
class Selected:
    """
    The regression with the columns that the data contain.

    Attributes
    ----------
    fit : Fit
        Its solution.
    spread : Spread
        Standard errors.
    missing : dict of (kind, joint) to str
        Why a term of friction has no number.
    levels : ndarray, shape (n,)
        Coulomb friction that the motors' load is made of, by `Data.loaded` [N·m].
    mixing : ndarray, shape (m, k)
        Coefficients of the model's errors in the `MODEL` terms, by `Data.mixed`.
    explanation : Explanation or None
        Causes of the model's errors; None where no column is known.
    attributed : bool
        Whether these explain all that the torque shows of them.
    alike : tuple of Explanation
        Other causes that explain as much.
    projected : Projected or None
        The windows without friction.
    scales : Explanation or None
        Causes, whose torque scales are no errors of bodies; None where they are not believed.
    friction : tuple of Term
        Terms of the friction in `projected`.

    """

    fit: Fit
    spread: Spread
    missing: dict[tuple[TermKind, int], str]
    levels: Array
    mixing: Array
    explanation: Explanation | None = None
    attributed: bool = True
    alike: tuple[Explanation, ...] = ()
    projected: Projected | None = None
    scales: Explanation | None = None
    friction: tuple[Term, ...] = ()

    def interval(self, term: Term) -> tuple[float, float]:
        """Return value and half the interval of a term of the fit."""
        return self.combined({term: 1.0})

    def combined(self, weights: Mapping[Term, float]) -> tuple[float, float]:
        """Return value and half the interval of a sum of terms of the fit with weights."""
        row = np.array([weights.get(term, 0.0) for term in self.fit.terms])
        return float(row @ self.fit.value), self.spread.half(row)


def select(data: Data, joints: Sequence[str], columns: ErrorColumns | None = None,
           options: Sequence[Cause] = ()) -> Selected:
    """
    Return the regression with the columns that the data contain.

    Parameters
    ----------
    data : Data
        All windows.
    joints : sequence of str, length n
        Names, for reasons.
    columns : ErrorColumns, optional
        To which `data.more` belongs.
    options : sequence of Cause
        Causes that are looked for.

    """
    terms, missing = friction_terms(data, joints)
    none = np.zeros((data.more.shape[2], 0))
    if not terms:
        fit = solve(data, [])
        return Selected(fit, Spread(np.zeros((0, 0)), 0.0, 1), missing, np.zeros(len(joints)),
                        none)
    levels = np.array([coulomb_level(data, terms, i) for i in range(len(joints))])
    data = data.loaded(levels)
    terms = [*terms, *further_terms(data, terms, joints, levels, missing)]
    projected = Projected(data := without_noise(data, terms), terms, columns) if columns else None
    if columns is None or projected is None or not projected.joints:
        fit, errors = _final(data.mixed(none), terms, missing)
        return Selected(fit, errors, missing, levels, none)
    options = [x for x in options if x.kind not in DRIVE
               or x.which in (ALL, *projected.joints)]
    causes = explain(projected, options)
    mixing, scales = _mixed(columns, causes)
    named = _final(data.mixed(mixing), [*terms, *scales], missing)
    beside = _beside(projected, causes, options)
    free = drive_terms(beside.causes)
    whole = _final(data.mixed(projected.saturated), [*terms, *free], dict(missing))
    count = projected.saturated.shape[1] + beside.count - causes.count
    size = np.square(data.torque[:, projected.joints]).mean(axis=0)
    explained = causes.square <= beside.square + projected.cost * count and _agree(named, whole)
    trifling = bool((causes.left - beside.left <= _TRIFLE ** 2 * size).all())
    if trifling and not explained:
        named = named[0], _containing(*named, whole[0])
    if len(causes.causes) <= _CAUSES and (explained or trifling):
        alike = _alike(projected, causes, options)
        for other in alike:
            mixed, others = _mixed(columns, other)
            again = solve(data.mixed(mixed), _all([*terms, *others], mixed.shape[1]))
            named = named[0], _containing(*named, again)
        return Selected(*named, missing, levels, mixing, causes, True, alike, projected, causes,
                        tuple(terms))
    whole = whole[0], _in_doubt(*whole, projected, causes, beside, options)
    return Selected(*whole, missing, levels, projected.saturated, causes, False, (), projected,
                    None, tuple(terms))


def _beside(projected: Projected, found: Explanation, options: Sequence[Cause]) -> Explanation:
    """Return the torque scales beside all errors of the model, which show some of them only."""
    scales = [x for x in found.causes if x.kind == CauseKind.SCALE and x.which != ALL]
    if len(scales) >= len(projected.joints):
        scales = []
    if any(x.kind in DRIVE for x in found.causes):
        return projected.fit([*scales, *(x for x in found.causes if x.kind in DRIVE[1:])],
                             saturated=True)
    return explain(projected, [x for x in options if x.kind in DRIVE and not (
        x.kind == CauseKind.SCALE and x.which == ALL)], saturated=True)


def _containing(fit: Fit, errors: Spread, other: Fit) -> Spread:
    """Return the spread with intervals of friction that contain another fit's as well."""
    off = np.array([other.of(term) - value if term in other.terms and term.joint >= 0
                    and term.kind not in BENT else 0.0
                    for term, value in zip(fit.terms, fit.value)]) / errors.factor
    return dataclasses.replace(errors, covariance=errors.covariance + np.outer(off, off))


def _common(projected: Projected, causes: Explanation, options: Sequence[Cause]) -> float:
    """
    Return by which part all torques together may be off.

    All torques times a number are all bodies times another one: beside all errors of bodies only
    the likely causes tell, and the model's masses.
    """
    whole = [x for x in options if x.kind == CauseKind.SCALE and x.which == ALL]
    sizes = [_COMMON]
    for rest in ((), causes.causes):
        others = [x for x in rest if possible(whole[0], [x])] if whole else []
        sizes += [abs(float(projected.fit([*others, x]).values[-1][0])) for x in whole]
    return _MARGIN * min(sizes) if whole else 0.0


def _in_doubt(fit: Fit, errors: Spread, projected: Projected, causes: Explanation,
              beside: Explanation, options: Sequence[Cause]) -> Spread:
    """Return the spread with what the scales of torques may be off by."""
    covariance = errors.covariance.copy()
    common = max(_common(projected, causes, options),
                 max((abs(float(x[0])) for cause, x in zip(beside.causes, beside.values)
                      if cause.kind == CauseKind.SCALE), default=0.0))
    doubts = {-1: common / errors.factor}
    for option in options:
        if option.kind == CauseKind.SCALE and option.which != ALL and not any(
                option is x for x in beside.causes):
            doubts[option.which] = min(projected.deviation(beside, option, True), _SCALE)
    for i, doubt in doubts.items():
        off = doubt * np.array([
            value if term.kind not in _DRIVE and term.joint >= 0 and i in (-1, term.joint)
            else 0.0 for term, value in zip(fit.terms, fit.value)])
        covariance += np.outer(off, off)
    return dataclasses.replace(errors, covariance=covariance)


def _mixed(columns: ErrorColumns, found: Explanation) -> tuple[Array, list[Term]]:
    """Return the columns of causes, shape (m, k), and the terms of those in the torque."""
    mixing = [np.zeros((columns.basis.shape[1], 0))]
    scales = []
    for cause, value in zip(found.causes, found.values):
        if cause.kind in DRIVE:
            scales += drive_terms([cause])
        else:
            mixing.append(cause.design(columns, value))
    return np.concatenate(mixing, axis=1), scales


def drive_terms(causes: Sequence[Cause]) -> list[Term]:
    """Return the terms of causes that are in the torque, in the order of their numbers."""
    found = []
    for cause in causes:
        kind = TermKind(cause.kind.value)
        joints = range(len(cause.size)) if cause.which == ALL and kind in BENT else [cause.which]
        found += [Term(kind, i) for i in joints]
    return found


def _all(terms: Sequence[Term], count: int) -> list[Term]:
    """Return the terms with so many errors of the model."""
    return [*terms, *(Term(TermKind.MODEL, -1, k) for k in range(count))]


def _other_load(data: Data, fit: Fit, errors: Spread) -> Spread:
    """
    Return the spread with what the form of load-dependent friction is uncertain by.

    Whether it goes with the torque of the gear or of the motor is known less well than a
    coefficient: a part of the difference between both is in the intervals.
    """
    if not any(term.kind == TermKind.LOAD for term in fit.terms):
        return errors
    swapped = [term._replace(which=1 - term.which) if term.kind == TermKind.LOAD else term
               for term in fit.terms]
    other = solve(data, swapped)
    own = [term.joint >= 0 and term.kind not in BENT for term in fit.terms]
    off = _FORM * np.where(own, other.value - fit.value, 0.0) / errors.factor
    return dataclasses.replace(errors, covariance=errors.covariance + np.outer(off, off))


def _final(data: Data, terms: Sequence[Term], missing: dict[tuple[TermKind, int], str]
           ) -> tuple[Fit, Spread]:
    """Return the fit of these terms and all columns of `data`, with its errors."""
    every = _all(terms, data.more.shape[2])
    found = refined(data, without_weak(data, refined(data, every), missing))
    # As with the slopes of Stribeck columns, intervals contain what the lag is uncertain by.
    n = data.way.shape[1]
    lags = [Term(TermKind.LAG_SLOPE, i) for i in range(n) if data.late[:, i].any()]
    fit = solve(data, [*found, *lags])
    return fit, _other_load(data, fit, spread(fit, data.starts))


def _agree(named: tuple[Fit, Spread], whole: tuple[Fit, Spread]) -> bool:
    """Return whether two fits have the same friction, within the intervals of the second."""
    # Beside all errors of the model a scale of all torques does not show.
    factor = 1.0 + named[0].of(Term(TermKind.SCALE, -1))
    for kind in (TermKind.FORWARDS, TermKind.BACKWARDS, TermKind.VISCOUS):
        for k, term in enumerate(whole[0].terms):
            if term.kind == kind:
                half = whole[1].factor * whole[1].error[k]
                if abs(named[0].of(term) - factor * whole[0].value[k]) > _AGREES * half:
                    return False
    return True


def _alike(projected: Projected, found: Explanation, options: Sequence[Cause]
           ) -> tuple[Explanation, ...]:
    """Return explanations with another cause in place of one that explain as much."""
    others = []
    for k in range(len(found.causes)):
        rest = [x for j, x in enumerate(found.causes) if j != k]
        values = [x for j, x in enumerate(found.values) if j != k]
        for option in options:
            if any(option is x for x in found.causes) or not possible(option, rest):
                continue
            other = projected.fit([*rest, option], values)
            # No motion tells a torque constant of all drives from the mass of all links.
            both = {option.kind, found.causes[k].kind} == {CauseKind.SCALE, CauseKind.MASSES}
            more = projected.cost * (found.count + 1.0 - other.count)
            if (both and option.which == found.causes[k].which) or (
                    other.square < found.square + more):
                others.append(other)
    return tuple(others)

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
Which terms of friction the data contain: what a motion does not show has a reason, not a number.

Friction of a joint needs motion of it in both directions and at different speeds. Further terms of
it are looked for beside all errors that the model may have.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses

from ctc_chattering.identification.attribution import (
    explain,
    Explanation,
    possible,
    Projected,
    without_noise,
)
from ctc_chattering.identification.findings import Estimate, NONE, NONE_ABOVE
from ctc_chattering.identification.least_squares import (
    BENT,
    coefficients,
    correlation_length,
    Data,
    Fit,
    orthonormal,
    solve,
    Spread,
    spread,
    stribeck_velocity,
    Term,
    TermKind,
)
from ctc_chattering.identification.model_errors import ALL, Cause, CauseKind, DRIVE, ErrorColumns
from ctc_chattering.identification.windows import STRIBECK
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Fewest windows in a direction, and the ratio of speeds that viscous friction needs.
_WINDOWS, _RATIO = 20, 2.0
#: Standard errors above which a further term of friction counts.
_CLEAR = 4.0
#: Twice the logarithm of the likelihood ratio that a further term of friction must gain.
_GAIN = 30.0
#: Part of the Coulomb friction below which it is none.
_NEGLIGIBLE = 0.02
#: Steps in which the velocity of Stribeck friction is refined.
_REFINEMENTS = 6
#: Part of the Coulomb friction from which on Stribeck friction would show, and deviations of it.
_EXCLUDED, _SURE = 0.1, 3.0
#: Windows that are slow enough for it, for each velocity.
_SLOW = 10


def friction_terms(data: Data, joints: Sequence[str]
                   ) -> tuple[list[Term], dict[tuple[TermKind, int], str]]:
    """Return the terms of friction that the motion contains, and why it lacks the others."""
    terms, missing = [], {}
    for i, name in enumerate(joints):
        ways = {kind: int((data.way[:, i] == sign).sum())
                for kind, sign in ((TermKind.FORWARDS, 1.0), (TermKind.BACKWARDS, -1.0))}
        if not any(count >= _WINDOWS for count in ways.values()):
            for kind in (*ways, TermKind.VISCOUS, TermKind.STRIBECK, TermKind.LOAD):
                missing[kind, i] = f'{name} hardly moves'
            continue
        for kind, count in ways.items():
            if count >= _WINDOWS:
                terms.append(Term(kind, i))
            else:
                missing[kind, i] = f'{name} hardly moves {kind.value}'
        speed = np.abs(data.velocity[data.way[:, i] != 0.0, i])
        low, high = np.percentile(speed, (10.0, 90.0))
        if high >= _RATIO * low:
            terms.append(Term(TermKind.VISCOUS, i))
        else:
            missing[TermKind.VISCOUS, i] = (
                f'{name} moves at {low:.3g} to {high:.3g} rad/s only: viscous and Coulomb '
                'friction look the same')
    return terms, missing


def further_terms(data: Data, terms: Sequence[Term], joints: Sequence[str], levels: Array,
                  missing: dict[tuple[TermKind, int], str]) -> list[Term]:
    """Return terms of Stribeck and load-dependent friction where the torque clearly has them."""
    found: list[Term] = []
    for i in range(len(joints)):
        used = data.way[:, i] != 0.0
        if not any(term.joint == i for term in terms):
            continue
        speed = np.abs(data.velocity[used, i])
        slow = [k for k, v in enumerate(STRIBECK) if (speed < v).sum() >= _SLOW]
        largest = float(data.load[used, i].max(initial=0.0))
        least = {TermKind.STRIBECK: _NEGLIGIBLE * levels[i],
                 TermKind.LOAD: _NEGLIGIBLE * levels[i] / max(largest, 1e-12)}
        options = [*(Term(TermKind.STRIBECK, i, k) for k in slow),
                   *(Term(TermKind.LOAD, i, which) for which in (0, 1))]
        while best := _best(data, [*terms, *found], options, least, i):
            found.append(best)
            options = [x for x in options if x.kind != best.kind]
            del least[best.kind]
        missing.update({(kind, i): NONE for kind in least})
        if TermKind.STRIBECK in least:
            bound = _excluded(data, [*terms, *found], i, levels[i]) if slow else None
            missing[TermKind.STRIBECK, i] = (
                f'{joints[i]} does not slide slowly enough: at least '
                f'{np.percentile(speed, 1.0):.2g} rad/s') if bound is None else (
                f'{NONE_ABOVE}{bound:.2g} rad/s, the slowest that {joints[i]} slides at')
    return found


def _excluded(data: Data, terms: Sequence[Term], i: int, level: float) -> float | None:
    """Return the velocity above which joint i has no Stribeck friction; None if none is shown."""
    used = data.way[:, i] != 0.0
    rest, basis = _beside(data, terms, i)
    variance = (float(rest.dot(rest)) / len(rest) * correlation_length(rest)
                + float(data.floor[i if len(data.floor) > 1 else 0]) ** 2)
    columns = data.stribeck[used, i]
    columns = columns - basis @ (basis.T @ columns)
    power = np.maximum(np.square(columns).sum(axis=0), 1e-300)
    most = columns.T @ rest / power + _SURE * np.sqrt(variance / power)
    small = np.flatnonzero(most > _EXCLUDED * level)
    first = int(small[-1]) + 1 if len(small) else 0
    return STRIBECK[first] if first < len(STRIBECK) else None


def coulomb_level(data: Data, terms: Sequence[Term], i: int) -> float:
    """Return about how large the Coulomb friction of joint i is [N·m]."""
    used = data.way[:, i] != 0.0
    mine = [term for term in terms if term.joint == i]
    if not mine:
        return 0.0
    x = np.concatenate((data.columns(mine)[used, i], data.more[used, i]), axis=1)
    value = coefficients(x, data.residual[used, i], 1e-7)
    levels = [v for term, v in zip(mine, value)
              if term.kind in (TermKind.FORWARDS, TermKind.BACKWARDS)]
    return max(float(np.mean(levels)), 0.0)


def _best(data: Data, terms: Sequence[Term], options: Sequence[Term],
          least: Mapping[TermKind, float], i: int) -> Term | None:
    """Return the best of further terms of joint i above the least sizes, if it clearly helps."""
    used, y = data.way[:, i] != 0.0, data.residual[data.way[:, i] != 0.0, i]
    rest, basis = _beside(data, terms, i)
    before = lowest = float(rest.dot(rest))
    best, after = None, rest
    for option in options:
        whole = data.columns([option])[used, i, 0]
        column = whole - basis @ (basis.T @ whole)
        power = float(column.dot(column))
        if power <= 1e-6 * float(whole.dot(whole)):
            continue
        value = float(column.dot(rest)) / power
        squares = before - value ** 2 * power
        if value > least[option.kind] and squares < lowest:
            best, lowest, after = option, squares, rest - value * column
    floor = len(y) * float(data.floor[i if len(data.floor) > 1 else 0]) ** 2
    gain = (before - lowest - floor) / max(lowest + floor, 1e-300) * len(y)
    return best if gain > _GAIN * correlation_length(after) else None


def _beside(data: Data, terms: Sequence[Term], i: int) -> tuple[Array, Array]:
    """Return what terms and all errors of the model leave of joint i, and their basis."""
    used = data.way[:, i] != 0.0
    mine = [term for term in terms if term.joint == i]
    x, y = np.concatenate((data.columns(mine)[used, i], data.more[used, i]), axis=1), (
        data.residual[used, i])
    basis = orthonormal(x, 1e-7)
    return y - basis @ (basis.T @ y), basis


def refined(data: Data, terms: Sequence[Term]) -> list[Term]:
    """Return the terms with their best Stribeck velocities, and a slope beside each of these."""
    found = [term for term in terms if term.kind != TermKind.STRIBECK_SLOPE]
    if not any(term.kind == TermKind.STRIBECK for term in found):
        return found
    for _ in range(_REFINEMENTS):
        slopes = [Term(TermKind.STRIBECK_SLOPE, term.joint, term.which) for term in found
                  if term.kind == TermKind.STRIBECK]
        fit = solve(data, [*found, *slopes])
        moved = []
        for term in found:
            if term.kind == TermKind.STRIBECK:
                size = fit.of(term)
                slope = fit.of(Term(TermKind.STRIBECK_SLOPE, term.joint, term.which))
                step = slope / size if size else 0.0
                place = term.which + float(np.clip(step, -1.0, 1.0))
                term = term._replace(which=float(np.clip(place, 0.0, len(STRIBECK) - 1.0)))
            moved.append(term)
        found = moved
    return [*found, *(Term(TermKind.STRIBECK_SLOPE, term.joint, term.which) for term in found
                      if term.kind == TermKind.STRIBECK)]


def without_weak(data: Data, terms: Sequence[Term], missing: dict[tuple[TermKind, int], str]
                 ) -> list[Term]:
    """Return the terms without Stribeck and load-dependent friction that are not clear."""
    fit = solve(data, terms)
    error = spread(fit, data.starts).error
    weak = {(term.kind, term.joint) for term, value, e in zip(terms, fit.value, error)
            if term.kind in (TermKind.STRIBECK, TermKind.LOAD) and value < _CLEAR * e}
    missing.update(dict.fromkeys(weak, NONE))
    gone = weak | {(TermKind.STRIBECK_SLOPE, i) for kind, i in weak if kind == TermKind.STRIBECK}
    return [term for term in terms if (term.kind, term.joint) not in gone]


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
        return float(row @ self.fit.value), float(self.spread.half(row))

    def torque(self, data: Data, kinds: Sequence[TermKind]) -> tuple[Array, Array]:
        """Return the torque of terms of some kinds, and half its interval, each (J, n) [N·m]."""
        columns = data.columns(self.fit.terms) * [x.kind in kinds for x in self.fit.terms]
        return columns @ self.fit.value, self.spread.half(columns)


def select(data: Data, joints: Sequence[str], columns: ErrorColumns | None = None,
           options: Sequence[Cause] = (), loaded: bool = False) -> Selected:
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
    loaded : bool
        Whether there is a known payload, which tells torque constants from masses.

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
    beside = _scales_beside(projected, causes, options, loaded)
    free = drive_terms(beside.causes)
    whole = _final(data.mixed(projected.saturated), [*terms, *free], dict(missing))
    count = projected.saturated.shape[1] + beside.count - causes.count
    size = np.square(data.torque[:, projected.joints]).mean(axis=0)
    explained = causes.square <= beside.square + projected.cost * count and _agree(named, whole)
    trifling = bool((causes.left - beside.left <= _TRIFLE ** 2 * size).all())
    if trifling and not explained:
        named = named[0], _containing(*named, whole[0])
    if len(causes.causes) <= _CAUSES and (explained or trifling):
        alike = _alike(projected, causes, options, loaded)
        for other in alike:
            mixed, others = _mixed(columns, other)
            again = solve(data.mixed(mixed), _all([*terms, *others], mixed.shape[1]))
            named = named[0], _containing(*named, again)
        return Selected(*named, missing, levels, mixing, causes, True, alike, projected, causes,
                        tuple(terms))
    whole = whole[0], _in_doubt(*whole, projected, causes, beside, options, loaded)
    return Selected(*whole, missing, levels, projected.saturated, causes, False, (), projected,
                    None, tuple(terms))


def _scales_beside(projected: Projected, found: Explanation, options: Sequence[Cause],
                   loaded: bool) -> Explanation:
    """Return the torque scales beside all errors of the model, which show some of them only."""
    scales = [x for x in found.causes if x.kind == CauseKind.SCALE
              and (loaded or x.which != ALL)]
    if len(scales) >= len(projected.joints):
        scales = []
    if any(x.kind in DRIVE for x in found.causes):
        return projected.fit([*scales, *(x for x in found.causes if x.kind in DRIVE[1:])],
                             saturated=True)
    return explain(projected, [x for x in options if x.kind in DRIVE and not (
        x.kind == CauseKind.SCALE and x.which == ALL and not loaded)], saturated=True)


def _containing(fit: Fit, errors: Spread, other: Fit) -> Spread:
    """Return the spread with intervals of friction that contain another fit's as well."""
    return errors.wider(np.array([
        other.of(term) - value if term in other.terms and term.joint >= 0
        and term.kind not in BENT else 0.0 for term, value in zip(fit.terms, fit.value)]))


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
              beside: Explanation, options: Sequence[Cause], loaded: bool) -> Spread:
    """Return the spread with what the scales of torques may be off by."""
    common = max(0.0 if loaded else _common(projected, causes, options),
                 max((abs(float(x[0])) for cause, x in zip(beside.causes, beside.values)
                      if cause.kind == CauseKind.SCALE), default=0.0))
    doubts = {-1: common}
    for option in options:
        if option.kind == CauseKind.SCALE and option.which != ALL and not any(
                option is x for x in beside.causes):
            doubts[option.which] = errors.factor * min(
                projected.deviation(beside, option, True), _SCALE)
    for i, doubt in doubts.items():
        errors = errors.wider(doubt * np.array([
            value if term.kind not in _DRIVE and term.joint >= 0 and i in (-1, term.joint)
            else 0.0 for term, value in zip(fit.terms, fit.value)]))
    return errors


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
    return errors.wider(_FORM * np.where(own, other.value - fit.value, 0.0))


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


def _alike(projected: Projected, found: Explanation, options: Sequence[Cause], loaded: bool
           ) -> tuple[Explanation, ...]:
    """Return explanations with another cause in place of one that explain as much."""
    others = []
    for k in range(len(found.causes)):
        rest = [x for j, x in enumerate(found.causes) if j != k]
        values = [x for j, x in enumerate(found.values) if j != k]
        for option in options:
            if any(option is x for x in found.causes) or not possible(option, rest) or (
                    option.contains(found.causes[k])):
                continue
            other = projected.fit([*rest, option], values)
            # No motion tells a torque constant of all drives from the mass of all links.
            both = not loaded and {option.kind, found.causes[k].kind} == {
                CauseKind.SCALE, CauseKind.MASSES}
            more = projected.cost * (found.count + 1.0 - other.count)
            if (both and option.which == found.causes[k].which) or (
                    other.square < found.square + more):
                others.append(other)
    return tuple(others)


#: Part of friction that no interval is shorter than: so well models are evaluated along a motion.
_TRUSTED = 1e-4


@dataclasses.dataclass(frozen=True)
class JointFriction:
    """
    Friction of one joint.

    Attributes
    ----------
    coulomb, forwards, backwards : Estimate
        Coulomb friction: mean of both directions, and each [N·m].
    offset : Estimate
        Half of forwards less backwards [N·m]: friction that depends on the direction, or a
        constant torque that the model lacks; no motion can distinguish these.
    viscous : Estimate
        [N·m·s/rad].
    stribeck, stribeck_velocity : Estimate
        Ks [N·m] and v_s [rad/s].
    load : Estimate
        Part of the torque's magnitude.

    """

    coulomb: Estimate
    forwards: Estimate
    backwards: Estimate
    offset: Estimate
    viscous: Estimate
    stribeck: Estimate
    stribeck_velocity: Estimate
    load: Estimate


def joint_friction(selected: Selected, i: int) -> JointFriction:
    """Return the friction of joint i."""
    terms, missing = selected.fit.terms, selected.missing

    def number(kind: TermKind, unit: str) -> Estimate:
        for term in terms:
            if (term.kind, term.joint) == (kind, i):
                return estimate({term: 1.0}, unit)
        return Estimate.none(missing.get((kind, i), NONE))

    def estimate(weights: Mapping[Term, float], unit: str) -> Estimate:
        value, half = selected.combined(weights)
        size = sum(abs(x * selected.fit.of(term)) for term, x in weights.items())
        return Estimate(value, half + _TRUSTED * size, unit)

    forwards, backwards = number(TermKind.FORWARDS, 'N*m'), number(TermKind.BACKWARDS, 'N*m')
    both = forwards.value is not None and backwards.value is not None
    if both:
        a, b = Term(TermKind.FORWARDS, i), Term(TermKind.BACKWARDS, i)
        coulomb, offset = (estimate({a: 0.5, b: sign}, 'N*m') for sign in (0.5, -0.5))
    else:
        reason = forwards.reason or backwards.reason
        coulomb = offset = Estimate.none(reason)
        if 'hardly moves' in reason:
            coulomb = offset = Estimate.none(f'{reason}: friction and a constant torque look the '
                                             'same in one direction')
    return JointFriction(coulomb, forwards, backwards, offset,
                         number(TermKind.VISCOUS, 'N*m*s/rad'),
                         number(TermKind.STRIBECK, 'N*m'), _stribeck_velocity(selected, i),
                         number(TermKind.LOAD, ''))


def _stribeck_velocity(selected: Selected, i: int) -> Estimate:
    """Return v_s of joint i with its interval, from the slope of the column by its place."""
    for term in selected.fit.terms:
        if (term.kind, term.joint) == (TermKind.STRIBECK, i):
            size = selected.fit.of(term)
            _, half = selected.interval(Term(TermKind.STRIBECK_SLOPE, i, term.which))
            velocity = stribeck_velocity(term.which)
            ratio = float(np.log(STRIBECK[1] / STRIBECK[0]))
            return Estimate(velocity, velocity * ratio * half / size, 'rad/s')
    return Estimate.none(selected.missing.get((TermKind.STRIBECK, i), NONE))

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

from collections.abc import Iterator, Mapping, Sequence
import dataclasses
from math import inf, log

from ctc_chattering.identification.attribution import (
    ALL,
    Cause,
    CauseKind,
    DRIVE,
    explain,
    Explanation,
    mixed,
    possible,
    Projected,
    without_noise,
)
from ctc_chattering.identification.findings import Estimate, Finding, Kind, NONE, NONE_ABOVE
from ctc_chattering.identification.least_squares import (
    coefficients,
    correlation_length,
    Data,
    Fit,
    FRICTION,
    inverted,
    orthonormal,
    solve,
    Spread,
    spread,
    sums_of,
    Term,
    TermKind,
    without,
)
from ctc_chattering.identification.model_errors import ErrorColumns
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
#: Steps in which the velocity of Stribeck friction is refined, and the least one [indices].
_REFINEMENTS, _REFINED = 8, 0.01
#: Part of the Coulomb friction from which on Stribeck friction would show, and deviations of it.
_EXCLUDED, _SURE = 0.1, 3.0
#: Windows that are slow enough for it, for each velocity.
_SLOW = 10


def friction_terms(data: Data, joints: Sequence[str]
                   ) -> tuple[list[Term], dict[tuple[TermKind, int], str]]:
    """Return the terms of friction that the motion contains, and why it lacks the others."""
    terms, missing = [], {}
    for i, name in enumerate(joints):
        counts = {TermKind.FORWARDS: int((data.way[:, i] > 0.0).sum()),
                  TermKind.BACKWARDS: int((data.way[:, i] < 0.0).sum())}
        if max(counts.values()) < _WINDOWS:
            missing.update({(kind, i): f'{name} hardly moves' for kind in FRICTION})
            continue
        for kind, count in counts.items():
            if count >= _WINDOWS:
                terms.append(Term(kind, i))
            else:
                missing[kind, i] = f'{name} hardly moves {kind.value}'
        low, high = np.percentile(np.abs(data.velocity[data.way[:, i] != 0.0, i]), (10.0, 90.0))
        if high >= _RATIO * low:
            terms.append(Term(TermKind.VISCOUS, i))
        else:
            missing[TermKind.VISCOUS, i] = (
                f'{name} moves at {low:.3g} to {high:.3g} rad/s only: viscous and Coulomb '
                'friction look the same')
    return terms, missing


def further_terms(data: Data, terms: Sequence[Term], joints: Sequence[str],
                  missing: dict[tuple[TermKind, int], str]) -> list[Term]:
    """Return terms of Stribeck and load-dependent friction where the torque clearly has them."""
    found: list[Term] = []
    for i in {term.joint: None for term in terms}:
        used = data.way[:, i] != 0.0
        speed, level = np.abs(data.velocity[used, i]), coulomb_level(data, terms, i)
        least = {TermKind.STRIBECK: _NEGLIGIBLE * level, TermKind.LOAD: _NEGLIGIBLE * level / max(
            float(data.load[used, i].max()), 1e-12)}
        options = [*(Term(TermKind.STRIBECK, i, k) for k, v in enumerate(STRIBECK)
                     if (speed < v).sum() >= _SLOW)]
        slow = bool(options)
        options += [Term(TermKind.LOAD, i, of_drive) for of_drive in (0, 1)]
        while options and (best := _best(data, [*terms, *found], options, least, i)):
            found.append(best)
            options = [x for x in options if x.kind != best.kind]
            del least[best.kind]
        missing.update({(kind, i): NONE for kind in least})
        if TermKind.STRIBECK in least:
            bound = _excluded(data, [*terms, *found], i, level) if slow else None
            missing[TermKind.STRIBECK, i] = (
                f'{joints[i]} does not slide slowly enough: at least '
                f'{np.percentile(speed, 1.0):.2g} rad/s') if bound is None else (
                f'{NONE_ABOVE}{bound:.2g} rad/s, the slowest that {joints[i]} slides at')
    return found


def _excluded(data: Data, terms: Sequence[Term], i: int, level: float) -> float | None:
    """Return the velocity above which joint i has no Stribeck friction; None if none is shown."""
    rest, basis = _beside(data, terms, i)
    variance = float(rest @ rest) / len(rest) * correlation_length(rest) + data.floor[i] ** 2
    columns = data.stribeck[data.way[:, i] != 0.0, i]
    columns = columns - basis @ (basis.T @ columns)
    power = np.maximum(np.square(columns).sum(axis=0), 1e-300)
    most = columns.T @ rest / power + _SURE * np.sqrt(variance / power)
    first = int(np.flatnonzero(np.append(True, most > _EXCLUDED * level))[-1])
    return STRIBECK[first] if first < len(STRIBECK) else None


def coulomb_level(data: Data, terms: Sequence[Term], i: int) -> float:
    """Return about how large the Coulomb friction of joint i is [N·m]."""
    mine = [term for term in terms if term.joint == i]
    if not mine:
        return 0.0
    value = coefficients(*_alone(data, mine, i))
    levels = [v for term, v in zip(mine, value)
              if term.kind in (TermKind.FORWARDS, TermKind.BACKWARDS)]
    return max(float(np.mean(levels)), 0.0)


def _best(data: Data, terms: Sequence[Term], options: Sequence[Term],
          least: Mapping[TermKind, float], i: int) -> Term | None:
    """Return the best of further terms of joint i above the least sizes, if it clearly helps."""
    rest, basis = _beside(data, terms, i)
    _, whole = data.of_joint(options, i)
    columns = whole - basis @ (basis.T @ whole)
    power = np.square(columns).sum(axis=0)
    own = power > 1e-6 * np.square(whole).sum(axis=0)
    value = columns.T @ rest / np.where(own, power, 1.0)
    gain = np.where(own & (value > [least[x.kind] for x in options]), value ** 2 * power, 0.0)
    k, floor = int(np.argmax(gain)), len(rest) * float(data.floor[i]) ** 2
    after = rest - value[k] * columns[:, k] * (gain[k] > 0.0)
    left = max(float(after @ after) + floor, 1e-300)
    clear = (gain[k] - floor) / left * len(rest) > _GAIN * correlation_length(after)
    return options[k] if clear else None


def _beside(data: Data, terms: Sequence[Term], i: int) -> tuple[Array, Array]:
    """Return what terms and all errors of the model leave of joint i, and their basis."""
    columns, y = _alone(data, terms, i)
    basis = orthonormal(columns, 1e-7)
    return y - basis @ (basis.T @ y), basis


def _alone(data: Data, terms: Sequence[Term], i: int) -> tuple[Array, Array]:
    """Return the columns of joint i beside all errors of the model, and what they explain."""
    used, own = data.of_joint(terms, i)
    return np.concatenate((own, data.more[used, i]), axis=1), data.residual[used, i]


#: Most causes that are believed: with more, others would explain as much.
_CAUSES = 3
#: Deviation of a torque constant where the motion does not show it, and the largest part that all
#: torques together are in doubt by.
_SCALE, _COMMON = 0.03, 0.066
#: Part of a joint's torque that errors of the model may have without a name.
_TRIFLE = 1e-3
#: Doubt of the load at its change of sign, in what the magnitude of the mean would change.
_FORM = 3.0
#: Part of the sign of the torque that friction must leave where a dead band shows, and part of
#: the Coulomb friction up to which it must be known.
_SHOWN, TOLD = 1e-4, 0.2
#: Halves of an interval by which friction may differ beside causes and beside all errors.
_AGREES = 2.0


@dataclasses.dataclass(frozen=True)
class Selected:
    """
    The regression with the columns that the data contain; n joints.

    Attributes
    ----------
    fit : Fit
        Its solution.
    spread : Spread
        Standard errors.
    missing : dict of (kind, joint) to str
        Why a term of friction has no number.
    design : ndarray, shape (n, m + 3, k)
        Coefficients of `Data.errors` in the `MODEL` terms.
    explanation : Explanation or None
        Causes of the model's errors; None where no column is known.
    attributed : bool
        Whether these explain all that the torque shows of them.
    alike : tuple of Explanation
        Other causes that explain as much.
    projected : Projected or None
        The windows without friction.
    friction : tuple of Term
        Terms of the friction in `projected`.

    """

    fit: Fit
    spread: Spread
    missing: dict[tuple[TermKind, int], str]
    design: Array
    explanation: Explanation | None = None
    attributed: bool = True
    alike: tuple[Explanation, ...] = ()
    projected: Projected | None = None
    friction: tuple[Term, ...] = ()

    @property
    def believed(self) -> Explanation | None:
        """Return the causes if they explain all that the torque shows, else None."""
        return self.explanation if self.attributed else None

    def combined(self, weights: Mapping[Term, float]) -> tuple[float, float]:
        """Return value and half the interval of a sum of terms of the fit with weights."""
        row = np.array([weights.get(term, 0.0) for term in self.fit.terms])
        return float(row @ self.fit.value), float(self.spread.half(row))

    def torque(self, data: Data, kinds: Sequence[TermKind] = tuple(TermKind)
               ) -> tuple[Array, Array]:
        """Return the torque of terms of some kinds, and half its interval, each (J, n) [N·m]."""
        data, wanted = data.mixed(self.design), [x.kind in kinds for x in self.fit.terms]
        value, half = np.empty((2, *data.way.shape))
        for i in range(value.shape[1]):  # Joint by joint, for long series.
            columns = data.columns(self.fit.terms, i) * wanted
            value[:, i], half[:, i] = columns @ self.fit.value, self.spread.half(columns)
        return value, half


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
    measured = data
    data = without_noise(measured, terms)
    terms += further_terms(data, terms, joints, missing)
    data = _shown(without_noise(measured, terms), terms)
    none = np.zeros((len(joints), data.more.shape[2] + 3, 0))
    projected = Projected(data, terms, columns) if columns else None
    if projected is None or not projected.joints:
        return Selected(*_final(data, terms, none, missing), missing, none)
    options = [x for x in options if x.kind not in DRIVE or x.which in (ALL, *projected.joints)]
    causes = explain(projected, options)
    design = mixed(projected, causes.causes, False)
    named = _final(data, terms, design, missing)
    drives = [x for x in options if x.kind in DRIVE
              and (loaded or (x.kind, x.which) != (CauseKind.SCALE, ALL))]
    beside = _drives_beside(projected, causes, drives)
    saturated = mixed(projected, beside.causes, True)
    whole = _final(data, terms, saturated, dict(missing))
    count = saturated.shape[2] - causes.count
    size = np.square(data.torque[:, projected.joints]).mean(axis=0)
    explained = causes.square <= beside.square + projected.cost * count and _agree(
        named, whole, causes)
    trifling = bool((causes.left - beside.left <= _TRIFLE ** 2 * size).all())
    if len(causes.causes) <= _CAUSES and (explained or trifling):
        if not explained:
            named = named[0], _containing(*named, whole[0])
        alike = _alike(projected, causes, options, loaded)
        for other in alike:
            mine = mixed(projected, other.causes, False)
            named = named[0], _containing(*named, solve(
                data.mixed(mine), _all(named[0].terms, mine.shape[2])))
        named = named[0], _with_bands(*named, data, projected, causes)
        return Selected(*named, missing, design, causes, True, alike, projected, tuple(terms))
    whole = whole[0], _in_doubt(*whole, projected, beside, loaded)
    return Selected(*whole, missing, saturated, causes, False, (), projected, tuple(terms))


def _drives_beside(projected: Projected, found: Explanation, drives: Sequence[Cause]
                   ) -> Explanation:
    """Return the causes in drives beside all errors of the model, which show some of them only."""
    if not any(x.kind in DRIVE for x in found.causes):
        return explain(projected, drives, True)
    mine = [x for x in found.causes if any(x is y for y in drives)]
    scales = sum(x.kind == CauseKind.SCALE for x in mine)
    return projected.fit([x for x in mine if x.kind != CauseKind.SCALE
                          or scales < len(projected.joints)], True)


def _all(terms: Sequence[Term], count: int) -> list[Term]:
    """Return the terms with so many errors of the model."""
    return [*(x for x in terms if x.kind != TermKind.MODEL),
            *(Term(TermKind.MODEL, -1, k) for k in range(count))]


def _final(data: Data, terms: Sequence[Term], design: Array,
           missing: dict[tuple[TermKind, int], str]) -> tuple[Fit, Spread]:
    """Return the fit of friction beside combinations of the model's errors, with its errors."""
    data, known = data.mixed(design), list(terms)
    # Intervals contain what the lag is uncertain by.
    lags = [Term(TermKind.LAG_SLOPE, i) for i in range(data.way.shape[1]) if data.late[:, i].any()]
    while True:
        for _ in range(_REFINEMENTS):
            slopes = {x: x._replace(kind=TermKind.STRIBECK_SLOPE) for x in known
                      if x.kind == TermKind.STRIBECK}
            fit = solve(data, _all([*known, *slopes.values(), *lags], design.shape[2]))
            # The slope says at which other velocity the column would be better.
            step = {x: float(np.clip(fit.of(slope) / (fit.of(x) or np.inf), -1.0, 1.0))
                    for x, slope in slopes.items()}
            if all(abs(x) < _REFINED for x in step.values()):
                break
            known = [x._replace(which=float(np.clip(
                x.which + step[x], 0.0, len(STRIBECK) - 1.0))) if x in step else x for x in known]
        errors = spread(fit, data.starts)
        # By kind and joint: the velocity may have been refined once more after the fit.
        weak = [(x.kind, x.joint) for x, value, e in zip(fit.terms, fit.value, errors.error)
                if x.kind in (TermKind.STRIBECK, TermKind.LOAD) and value < _CLEAR * e]
        if not weak:
            break
        missing.update(dict.fromkeys(weak, NONE))
        known = [x for x in known if (x.kind, x.joint) not in weak]
    # Where a load changes its sign in a window, its mean magnitude is known less well.
    other = solve(dataclasses.replace(data, load=np.abs(data.base)), fit.terms)
    return fit, errors.wider(_FORM * np.where(
        [term.joint >= 0 for term in fit.terms], other.value - fit.value, 0.0))


def _shown(data: Data, terms: Sequence[Term]) -> Data:
    """
    Return the windows without the dead bands that look like friction.

    Where no torque is against the motion a dead band of the drive is a part of Coulomb friction,
    and where the torque has one sign, of the difference of both directions.
    """
    bent = data.bent.copy()
    for i in {term.joint: None for term in terms}:
        used, own = data.of_joint(terms, i)
        column = bent[used, i, 0]
        if np.linalg.norm(without(own, column)) <= _SHOWN * np.linalg.norm(column):
            bent[:, i, 0] = 0.0
    return dataclasses.replace(data, bent=bent)


def _with_bands(fit: Fit, errors: Spread, data: Data, projected: Projected, beside: Explanation
                ) -> Spread:
    """Return the spread with what friction would change by the dead bands that may be there."""
    # In the whole fit: a column of another joint's cause is rounding in the rows of this one.
    _, normal, _ = sums_of(fit)
    inverse = inverted(normal)
    for i in projected.joints:
        half = errors.factor * projected.deviation(beside, i, kind=CauseKind.DEAD_BAND)
        # What is less well known is part of what is called friction.
        if half < TOLD * coulomb_level(data, fit.terms, i):
            errors = errors.wider(half * fit.weight[i] * (
                inverse @ (fit.columns(i).T @ data.bent[:, i, 0])))
    return errors


def _containing(fit: Fit, errors: Spread, other: Fit) -> Spread:
    """Return the spread with intervals of friction that contain another fit's as well."""
    return errors.wider(np.array([
        other.of(term) - value if term in other.terms and term.joint >= 0 else 0.0
        for term, value in zip(fit.terms, fit.value)]))


def _in_doubt(fit: Fit, errors: Spread, projected: Projected, beside: Explanation, loaded: bool
              ) -> Spread:
    """
    Return the spread with what the scales of torques may be off by.

    All torques times a number are all bodies times another one: beside all errors of bodies
    nothing tells it.
    """
    scales = {cause.which: abs(float(value[0])) for cause, value in zip(
        beside.causes, beside.values) if cause.kind == CauseKind.SCALE}
    doubts = {i: errors.factor * min(projected.deviation(beside, i, True), _SCALE)
              for i in projected.joints if i not in scales}
    doubts[ALL] = max([0.0 if loaded else _COMMON, *scales.values()])
    for i, doubt in doubts.items():
        errors = errors.wider(doubt * np.array([
            value if term.joint >= 0 and i in (ALL, term.joint) else 0.0
            for term, value in zip(fit.terms, fit.value)]))
    return errors


def _agree(named: tuple[Fit, Spread], whole: tuple[Fit, Spread], causes: Explanation) -> bool:
    """Return whether two fits have the same friction, within the intervals of the second."""
    # Beside all errors of the model a scale of all torques does not show.
    factor = 1.0 + sum(float(value[0]) for cause, value in zip(causes.causes, causes.values)
                       if (cause.kind, cause.which) == (CauseKind.SCALE, ALL))
    half = _AGREES * whole[1].factor * whole[1].error
    return all(abs(named[0].of(term) - factor * whole[0].of(term)) <= half[k]
               for k, term in enumerate(whole[0].terms)
               if term.kind in (TermKind.FORWARDS, TermKind.BACKWARDS, TermKind.VISCOUS))


def _alike(projected: Projected, found: Explanation, options: Sequence[Cause], loaded: bool
           ) -> tuple[Explanation, ...]:
    """Return explanations with another cause in place of one that explain as much."""
    others = []
    for mine in found.causes:
        rest = [x for x in found.causes if x is not mine]
        for option in options:
            if option is mine or not possible(option, rest) or option.contains(mine):
                continue
            other = projected.fit([*rest, option])
            # No motion tells a torque constant of all drives from the mass of all links.
            both = not loaded and {option.kind, mine.kind} == {
                CauseKind.SCALE, CauseKind.MASSES} and option.which == mine.which
            if both or other.square < found.square + projected.cost * (
                    found.count + 1.0 - other.count):
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
        Part of the magnitude of the torque: through the gear, or of the drive, whichever explains
        more.

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
    mine = {term.kind: term for term in selected.fit.terms if term.joint == i}

    def number(unit: str, **weights: float) -> Estimate:
        lacks = [kind for kind in map(TermKind, weights) if kind not in mine]
        if lacks:
            return Estimate.none(selected.missing.get((lacks[0], i), NONE))
        known = {mine[TermKind(name)]: x for name, x in weights.items()}
        value, half = selected.combined(known)
        size = sum(abs(x * selected.fit.of(term)) for term, x in known.items())
        return Estimate(value, half + _TRUSTED * size, unit)

    coulomb, offset = (number('N*m', forwards=0.5, backwards=sign) for sign in (0.5, -0.5))
    if 'hardly moves' in coulomb.reason:
        coulomb = offset = Estimate.none(f'{coulomb.reason}: friction and a constant torque look '
                                         'the same in one direction')
    return JointFriction(
        coulomb, number('N*m', forwards=1.0), number('N*m', backwards=1.0), offset,
        number('N*m*s/rad', viscous=1.0), number('N*m', stribeck=1.0),
        _stribeck_velocity(selected, i), number('', load=1.0))


def _stribeck_velocity(selected: Selected, i: int) -> Estimate:
    """Return v_s of joint i with its interval, from the slope of the column by its index."""
    for term in selected.fit.terms:
        if (term.kind, term.joint) == (TermKind.STRIBECK, i):
            _, half = selected.combined({term._replace(kind=TermKind.STRIBECK_SLOPE): 1.0})
            ratio = STRIBECK[1] / STRIBECK[0]
            velocity = STRIBECK[0] * ratio ** term.which
            return Estimate(
                velocity, velocity * log(ratio) * half / selected.fit.of(term), 'rad/s')
    return Estimate.none(selected.missing.get((TermKind.STRIBECK, i), NONE))


#: Part of the Coulomb friction below which another friction is nothing (viscous: at 1 rad/s).
_NOTHING = 1e-4
_SIDE = 'check the description and what the effort is (--effort)'


def physical(friction: Sequence[JointFriction]) -> Iterator[Finding]:
    """Yield numbers of friction that no joint can have."""
    for i, one in enumerate(friction):
        for what, number in (('Coulomb friction', one.coulomb), ('viscous friction', one.viscous)):
            least = _NOTHING * abs(one.coulomb.value or 0.0)
            if number.value is not None and number.value < -least:
                yield Finding(Kind.NEGATIVE_FRICTION, i, f'{what} of {number}, allowed: at least '
                              '0; the model, the torque signal or its side of the gear is wrong',
                              _SIDE, -number.value / max(number.half, 1e-300))
        load = one.load.value
        if load is not None and not 0.0 <= load < Kind.LOAD.refused:
            yield Finding(Kind.LOAD, i, f'friction of {load:.2f} times the load, allowed: 0 to '
                          f'{Kind.LOAD.refused:g}', _SIDE, inf)

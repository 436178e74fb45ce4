"""
Which columns the data contain: what a motion does not show is named with its reason, not a number.

Friction of a joint needs motion of it in both directions and at different speeds. All errors of
the model are in the regression at first; those that are not clearly above their standard errors
are then taken out, the least first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses

from ctc_chattering.identification.regression.estimate import NONE
from ctc_chattering.identification.regression.intervals import correlation_length, Spread, spread
from ctc_chattering.identification.regression.least_squares import (
    Data,
    dependent,
    Fit,
    Kind,
    solve,
    Term,
)
from ctc_chattering.identification.regression.rows import STRIBECK
import numpy as np

#: Fewest windows in a direction, and the ratio of speeds that viscous friction needs.
_WINDOWS, _RATIO = 20, 2.0
#: Standard errors above which an error of the model counts, and its least size: a part of a
#: link's mass, or kg.
_CLEAR, _LEAST = 4.0, 0.01
#: Twice the logarithm of the likelihood ratio that a further term of friction must gain.
_GAIN = 30.0
#: Part of the Coulomb friction below which it is none.
_NEGLIGIBLE = 0.02
#: Rounds in which further terms of friction and errors of the model are looked for.
_ROUNDS = 3
#: Steps in which the velocity of Stribeck friction is refined.
_REFINEMENTS = 6
#: Windows that are slow enough for it, for each velocity.
_SLOW = 10


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
    unseen : dict of int to str
        Why a model's error, by its index, cannot be told.

    """

    fit: Fit
    spread: Spread
    missing: dict[tuple[Kind, int], str]
    unseen: dict[int, str]

    def interval(self, term: Term) -> tuple[float, float]:
        """Return value and half the interval of a term of the fit."""
        return self.combined({term: 1.0})

    def combined(self, weights: Mapping[Term, float]) -> tuple[float, float]:
        """Return value and half the interval of a sum of terms of the fit with weights."""
        row = np.array([weights.get(term, 0.0) for term in self.fit.terms])
        return float(row @ self.fit.value), self.spread.half(row)


def select(data: Data, joints: Sequence[str], models: Sequence[str]) -> Selected:
    """
    Return the regression with the columns that the data contain.

    Parameters
    ----------
    data : Data
        All windows.
    joints : sequence of str, length n
        Names, for reasons.
    models : sequence of str, length m
        Names of the errors of the model.

    """
    terms, missing = _friction(data, joints)
    unseen: dict[int, str] = {}
    if not terms:
        fit = solve(data, [])
        return Selected(fit, Spread(np.zeros((0, 0)), 0.0, 1), missing,
                        dict.fromkeys(range(len(models)), 'no joint moves'))
    errors = [Term(Kind.MODEL, -1, k) for k in range(len(models))]
    for term in dependent(data, [*terms, *errors]):
        unseen[int(term.which)] = (
            'this motion shows no more of it than of friction and of: '
            + ', '.join(models[int(e.which)] for e in errors if e != term))
        errors.remove(term)
    kept = errors
    for _ in range(_ROUNDS):
        more = _further(data, [*terms, *kept], joints, missing)
        terms = _refined(data, [*terms, *more])
        kept = _without_small(data, terms, errors)
        if not more:
            break
    terms = _refined(data, _without_weak(data, [*terms, *kept], missing))
    # As with the slopes of Stribeck columns, intervals contain what the lag is uncertain by.
    lags = [Term(Kind.LAG_SLOPE, i) for i in range(len(joints)) if data.late[:, i].any()]
    fit = solve(data, [*terms, *lags])
    return Selected(fit, spread(fit, data.starts), missing, unseen)


def _friction(data: Data, joints: Sequence[str]
              ) -> tuple[list[Term], dict[tuple[Kind, int], str]]:
    """Return the terms of friction that the motion contains, and why it lacks the others."""
    terms, missing = [], {}
    for i, name in enumerate(joints):
        ways = {kind: int((data.way[:, i] == sign).sum())
                for kind, sign in ((Kind.FORWARDS, 1.0), (Kind.BACKWARDS, -1.0))}
        if not any(count >= _WINDOWS for count in ways.values()):
            for kind in (Kind.FORWARDS, Kind.BACKWARDS, Kind.VISCOUS, Kind.STRIBECK, Kind.LOAD):
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
            terms.append(Term(Kind.VISCOUS, i))
        else:
            missing[Kind.VISCOUS, i] = (
                f'{name} moves at {low:.3g} to {high:.3g} rad/s only: viscous and Coulomb '
                'friction look the same')
    return terms, missing


def _further(data: Data, terms: Sequence[Term], joints: Sequence[str],
             missing: dict[tuple[Kind, int], str]) -> list[Term]:
    """Return terms of Stribeck and load-dependent friction where the torque clearly has them."""
    found: list[Term] = []
    for i in range(len(joints)):
        used = data.way[:, i] != 0.0
        if not used.any() or not _is_friction(terms, i):
            continue
        fit = solve(data, [*terms, *found])
        level = 0.5 * (fit.of(Term(Kind.FORWARDS, i)) + fit.of(Term(Kind.BACKWARDS, i)))
        size = _NEGLIGIBLE * max(level, 0.0)
        speed = np.abs(data.velocity[used, i])
        slow = [k for k, v in enumerate(STRIBECK) if (speed < v).sum() >= _SLOW]
        choices = [Term(Kind.STRIBECK, i, k) for k in slow]
        largest = float(data.load[used, i].max(initial=0.0))
        for kind, options, least in (
                (Kind.STRIBECK, choices, size),
                (Kind.LOAD, [Term(Kind.LOAD, i)], size / max(largest, 1e-12))):
            if any((term.kind, term.joint) == (kind, i) for term in terms):
                continue
            best = _best(data, [*terms, *found], options, i)
            if best is not None and best[1] > least:
                found.append(best[0])
                missing.pop((kind, i), None)
            elif kind == Kind.STRIBECK and not slow:
                missing[kind, i] = (f'{joints[i]} does not move slowly enough: at least '
                                    f'{np.percentile(speed, 1.0):.2g} rad/s')
            else:
                missing[kind, i] = NONE
    return found


def _best(data: Data, terms: Sequence[Term], options: Sequence[Term], i: int
          ) -> tuple[Term, float] | None:
    """Return the best of further terms of joint i with its coefficient, if it clearly helps."""
    used = data.way[:, i] != 0.0
    mine = [term for term in terms if term.joint in (i, -1)]
    x, y = data.columns(mine)[used, i], data.residual[used, i]
    length = np.sqrt(np.square(x).sum(axis=0))
    basis = np.linalg.svd(x / np.where(length > 0.0, length, 1.0), full_matrices=False)[0]
    rest = y - basis @ (basis.T @ y)
    before = least = float(rest.dot(rest))
    best, after = None, rest
    for option in options:
        whole = data.columns([option])[used, i, 0]
        column = whole - basis @ (basis.T @ whole)
        power = float(column.dot(column))
        if power <= 1e-6 * float(whole.dot(whole)):
            continue
        value = float(column.dot(rest)) / power
        squares = before - value ** 2 * power
        if value > 0.0 and squares < least:
            best, least, after = (option, value), squares, rest - value * column
    gain = (before - least) / max(least, 1e-300) * len(y)
    return best if gain > _GAIN * correlation_length(after) else None


def _refined(data: Data, terms: Sequence[Term]) -> list[Term]:
    """Return the terms with their best Stribeck velocities, and a slope beside each of these."""
    found = [term for term in terms if term.kind != Kind.STRIBECK_SLOPE]
    if not any(term.kind == Kind.STRIBECK for term in found):
        return found
    for _ in range(_REFINEMENTS):
        slopes = [Term(Kind.STRIBECK_SLOPE, term.joint, term.which) for term in found
                  if term.kind == Kind.STRIBECK]
        fit = solve(data, [*found, *slopes])
        moved = []
        for term in found:
            if term.kind == Kind.STRIBECK:
                size = fit.of(term)
                slope = fit.of(Term(Kind.STRIBECK_SLOPE, term.joint, term.which))
                step = slope / size if size else 0.0
                place = term.which + float(np.clip(step, -1.0, 1.0))
                term = term._replace(which=float(np.clip(place, 0.0, len(STRIBECK) - 1.0)))
            moved.append(term)
        found = moved
    return [*found, *(Term(Kind.STRIBECK_SLOPE, term.joint, term.which) for term in found
                      if term.kind == Kind.STRIBECK)]


def _is_friction(terms: Sequence[Term], i: int) -> bool:
    """Return whether Coulomb friction of joint i is among the terms."""
    return Term(Kind.FORWARDS, i) in terms or Term(Kind.BACKWARDS, i) in terms


def _without_small(data: Data, terms: Sequence[Term], errors: Sequence[Term]) -> list[Term]:
    """Return those errors of the model that are clear beside the terms of friction."""
    kept = list(errors)
    while kept:
        fit = solve(data, [*terms, *kept])
        error = spread(fit, data.starts).error[len(terms):]
        value = np.abs(fit.value[len(terms):])
        clear = value / np.maximum(error, 1e-300)
        weak = (clear < _CLEAR) | (value < _LEAST)
        if not weak.any():
            break
        kept.pop(int(np.argmin(np.where(weak, clear, np.inf))))
    return kept


def _without_weak(data: Data, terms: Sequence[Term], missing: dict[tuple[Kind, int], str]
                  ) -> list[Term]:
    """Return the terms without Stribeck and load-dependent friction that are not clear."""
    fit = solve(data, terms)
    error = spread(fit, data.starts).error
    weak = {(term.kind, term.joint) for term, value, e in zip(terms, fit.value, error)
            if term.kind in (Kind.STRIBECK, Kind.LOAD) and value < _CLEAR * e}
    missing.update(dict.fromkeys(weak, NONE))
    gone = weak | {(Kind.STRIBECK_SLOPE, i) for kind, i in weak if kind == Kind.STRIBECK}
    return [term for term in terms if (term.kind, term.joint) not in gone]

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

from collections.abc import Sequence
from typing import NamedTuple

from ctc_chattering.identification.regression.estimate import NONE, NONE_ABOVE
from ctc_chattering.identification.regression.intervals import correlation_length, spread
from ctc_chattering.identification.regression.least_squares import (
    Data,
    solve,
    Term,
    TermKind,
)
from ctc_chattering.identification.regression.rows import STRIBECK
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
        if not used.any() or not _isfriction_terms(terms, i):
            continue
        speed = np.abs(data.velocity[used, i])
        slow = [k for k, v in enumerate(STRIBECK) if (speed < v).sum() >= _SLOW]
        options = {TermKind.STRIBECK: [Term(TermKind.STRIBECK, i, k) for k in slow],
                   TermKind.LOAD: [Term(TermKind.LOAD, i, which) for which in (0, 1)]}
        largest = float(data.load[used, i].max(initial=0.0))
        size = _NEGLIGIBLE * levels[i]
        least = {TermKind.STRIBECK: size, TermKind.LOAD: size / max(largest, 1e-12)}
        while options:
            tried = [(kind, _best(data, [*terms, *found], choices, i))
                     for kind, choices in options.items()]
            better = [(best, kind) for kind, best in tried
                      if best is not None and best.value > least[kind]]
            if not better:
                break
            best, kind = max(better, key=lambda x: x[0].gain)
            found.append(best.term)
            del options[kind]
        for kind in options:
            missing[kind, i] = NONE
        if TermKind.STRIBECK in options:
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
    length = np.sqrt(np.square(x).sum(axis=0))
    length = np.where(length > 0.0, length, 1.0)
    value = np.linalg.lstsq(x / length, data.residual[used, i], rcond=1e-7)[0] / length
    levels = [v for term, v in zip(mine, value)
              if term.kind in (TermKind.FORWARDS, TermKind.BACKWARDS)]
    return max(float(np.mean(levels)), 0.0)


class _Gain(NamedTuple):
    """A further term with its coefficient, and by how much it helps."""

    term: Term
    value: float
    gain: float


def _best(data: Data, terms: Sequence[Term], options: Sequence[Term], i: int) -> _Gain | None:
    """Return the best of further terms of joint i, if it clearly helps."""
    used, y = data.way[:, i] != 0.0, data.residual[data.way[:, i] != 0.0, i]
    rest, basis = _beside(data, terms, i)
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
    least += len(y) * float(data.floor[i if len(data.floor) > 1 else 0]) ** 2
    gain = (before - least) / max(least, 1e-300) * len(y)
    return _Gain(*best, gain) if best and gain > _GAIN * correlation_length(after) else None


def _beside(data: Data, terms: Sequence[Term], i: int) -> tuple[Array, Array]:
    """Return what terms and all errors of the model leave of joint i, and their basis."""
    used = data.way[:, i] != 0.0
    mine = [term for term in terms if term.joint == i]
    x, y = np.concatenate((data.columns(mine)[used, i], data.more[used, i]), axis=1), (
        data.residual[used, i])
    length = np.sqrt(np.square(x).sum(axis=0))
    basis, sizes, _ = np.linalg.svd(x / np.where(length > 0.0, length, 1.0), full_matrices=False)
    basis = basis[:, sizes > 1e-7 * sizes[0]]
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


def _isfriction_terms(terms: Sequence[Term], i: int) -> bool:
    """Return whether Coulomb friction of joint i is among the terms."""
    return Term(TermKind.FORWARDS, i) in terms or Term(TermKind.BACKWARDS, i) in terms


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

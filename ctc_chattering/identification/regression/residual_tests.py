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
What the residuals of a fit depend on, each with the physical cause that it points to.

The residual torque of a joint is regressed on its columns of friction and on those of a cause. A
cause counts if its columns explain more than chance does, with as many samples as are
independent. The one that explains most comes first, then what explains the rest. Its worth is the
torque that it explains, or the change of Coulomb friction with it, as a part of the friction.
Intervals of the friction are widened by both.
"""

from __future__ import annotations

from collections.abc import Iterator
import dataclasses
from typing import Any, NamedTuple, TypeVar

from ctc_chattering.identification.regression.estimate import Estimate
from ctc_chattering.identification.regression.finding import Finding, Severity
from ctc_chattering.identification.regression.intervals import correlation_length
from ctc_chattering.identification.regression.least_squares import Term, TermKind
from ctc_chattering.identification.regression.physical_causes import (
    causes,
    FittedMotion,
    Guess,
    periodic,
    TIME,
)
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.stats import chi2  # type: ignore[import-untyped]

Friction = TypeVar('Friction', bound=Any)
#: Part by which friction may be off without care, and above which the joint is refused.
NEGLIGIBLE, TOO_MUCH = 0.02, 0.3
#: Part of the worst effect below which another one is not named.
_MINOR = 0.2
#: Peak of an unexplained torque over its RMS: a ramp has 1.7.
_PEAK = 2.0
#: Probability by chance below which a dependence counts.
_CHANCE = 1e-6
#: How much more than the shift of a coefficient its interval is widened by.
_SURE = 1.5
#: Fewest windows of a joint, and most effects that are named.
_FEWEST, _MOST = 60, 3
#: Singular value, of columns of length 1, below which columns are like those of the friction.
_ALIKE = 0.03
#: Distances of windows that have no sample in common.
_APART = range(4, 13)


class Effect(NamedTuple):
    """
    What a cause explains of a residual.

    Attributes
    ----------
    cause : Guess
        What it may be.
    size : float
        RMS of the torque that it explains [N·m].
    shift : ndarray, shape (p,)
        Change of the coefficients of the friction with it.
    before, torque : ndarray, shape (K,)
        What was left without it, and what it explains of that [N·m].

    """

    cause: Guess
    size: float
    shift: Array
    before: Array
    torque: Array

    def drift(self) -> str:
        """Return by how much friction changes, of an effect of time; else nothing."""
        if self.cause.against != TIME:
            return ''
        thirds = np.linalg.lstsq(self.cause.columns, self.torque, rcond=1e-9)[0]
        return f', by {thirds[-1] - thirds[-3]:+.2g} N*m from the first third to the last'

    def off(self, whole: Unexplained) -> float:
        """Return by which part the friction may be off with it."""
        shift = float(np.abs(self.shift[:2]).max(initial=0.0))
        return whole.part(_PEAK * self.size + _SURE * shift)


class Unexplained(NamedTuple):
    """
    What is left of the torque of a joint.

    Attributes
    ----------
    effects : tuple of Effect
        The largest first, each of what those before it leave.
    rest : float
        Torque that is correlated in time, and depends on nothing of these [N·m].
    friction : float
        RMS of the identified friction [N·m].

    """

    effects: tuple[Effect, ...]
    rest: float
    friction: float

    def part(self, size: float) -> float:
        """Return a torque as a part of the friction."""
        return size / max(self.friction, 1e-300)

    def shown(self) -> Effect | None:
        """Return the largest effect, if it is worth to be named."""
        first = next(iter(self.effects), None)
        return first if first and first.off(self) > NEGLIGIBLE else None

    @property
    def off(self) -> float:
        """Return by how much friction may be off without its shifts [N·m]."""
        return _PEAK * float(np.sqrt(sum(x.size ** 2 for x in self.effects) + self.rest ** 2))


def effect(cause: Guess, friction: Array, others: Array, residual: Array, tried: int = 1
           ) -> Effect | None:
    """
    Return what the columns of a cause explain of a residual, None for what chance explains.

    Parameters
    ----------
    cause : Guess
        With K rows.
    friction, others : ndarray, shapes (K, p) and (K, m)
        Columns of the fit, and those of causes that were found before.
    residual : ndarray, shape (K,)
        Of the fit with both [N·m].
    tried : int
        How many such causes this one is the best of.

    """
    basis = np.linalg.qr(_scaled(np.column_stack((friction, others))))[0]
    columns = _scaled(cause.columns)
    u, s, v = np.linalg.svd(columns - basis @ (basis.T @ columns), full_matrices=False)
    kept = s > _ALIKE
    u, s, v = u[:, kept], s[kept], v[kept]
    found = u.T @ residual
    rest = residual - basis @ (basis.T @ residual) - u @ found
    degrees = max(len(residual) - len(s) - basis.shape[1], 1)
    noise = float(rest.dot(rest)) / degrees * correlation_length(rest)
    power = float(found.dot(found))
    chance = noise * float(chi2.isf(_CHANCE / tried, max(len(s), 1)))
    if power <= chance:
        return None
    whole = columns @ (v.T @ (found / s))
    shift = np.linalg.lstsq(friction, -whole, rcond=1e-9)[0]
    return Effect(cause, float(np.sqrt(power / len(residual))), shift, residual, u @ found)


def _scaled(columns: Array) -> Array:
    """Return columns of the length 1; those of length 0 as they are."""
    length = np.sqrt(np.square(columns).sum(axis=0))
    found: Array = columns / np.where(length > 0.0, length, 1.0)
    return found


def unexplained(found: FittedMotion, i: int) -> Unexplained | None:
    """Return what is left of the torque of joint i; None if it hardly slides."""
    fit, used = found.fit, found.data.way[:, i] != 0.0
    mine = [k for k, term in enumerate(fit.terms) if term.joint == i]
    if used.sum() < _FEWEST or not mine:
        return None
    friction, rest = fit.design[used, i][:, mine], fit.residual[used, i]
    level = float(np.sqrt(np.square(friction @ fit.value[mine]).mean()))
    effects: list[Effect] = []
    others, options = np.zeros((len(rest), 0)), list(causes(found, i))
    while len(effects) < _MOST:
        shown = [effect(cause, friction, others, rest) for cause in options]
        if len(effects) in (0, _MOST - 1) or not any(shown):
            wave, tried = periodic(found, i, rest)
            shown += [effect(wave, friction, others, rest, tried)] if wave else []
        best = max((x for x in shown if x is not None), key=lambda x: x.size, default=None)
        if best is None:
            break
        effects.append(best)
        options = [x for x in options if x.against != best.cause.against]
        others = np.column_stack((others, best.cause.columns))
        scaled = _scaled(np.column_stack((friction, others)))
        rest = rest - scaled @ np.linalg.lstsq(scaled, rest, rcond=1e-6)[0]
    whole = np.zeros(len(used))
    whole[used] = rest
    return Unexplained(tuple(effects), _correlated(whole, used.astype(float)), level)


def _correlated(x: Array, used: Array) -> float:
    """
    Return the size of the part of a series that correlates in time; 0 for what chance does.

    Parameters
    ----------
    x, used : ndarray, shape (J,)
        Series, 0 where it has no value, and 1 where it has one.

    """
    count = np.array([used[k:] @ used[:-k] for k in _APART])
    power = float(x.dot(x)) / max(used.sum(), 1.0)
    if count.min() < _FEWEST or not power:
        return 0.0
    covariance = np.array([x[k:] @ x[:-k] for k in _APART]) / count
    if (count * np.square(covariance / power)).sum() <= chi2.isf(_CHANCE, len(_APART)):
        return 0.0
    return float(np.sqrt(np.abs(covariance).mean()))


def findings(i: int, left: Unexplained) -> Iterator[Finding]:
    """Yield what a joint depends on that the model lacks."""
    worst = max((x.off(left) for x in left.effects), default=0.0)
    for x in left.effects:
        off = x.off(left)
        if off > max(NEGLIGIBLE, _MINOR * worst):
            yield Finding(_severity(off), i, f'{left.part(x.size):.1%} of the friction, '
                          f'{x.size:.2g} N*m RMS, depends on {x.cause.against}: '
                          f'{x.cause.points_to}{x.drift()}; friction may be off by {off:.0%}',
                          x.cause.cure)
    off = left.part(_PEAK * left.rest)
    if off > NEGLIGIBLE:
        yield Finding(_severity(off), i, f'{left.part(left.rest):.1%} of the friction, '
                      f'{left.rest:.2g} N*m RMS, is not explained and correlates in time; '
                      f'friction may be off by {off:.0%}',
                      'look at the figure of what is not explained')


def _severity(off: float) -> Severity:
    """Return what follows if friction may be off by a part of it."""
    return Severity.REFUSED if off > TOO_MUCH else Severity.CARE


def widened(found: FittedMotion, i: int, friction: Friction, left: Unexplained) -> Friction:
    """
    Return the friction of joint i with intervals that contain what is unexplained.

    Parameters
    ----------
    found, i
        Fit with its motion, and the joint.
    friction : JointFriction
        Its friction.
    left : Unexplained
        What is left of its torque.

    """
    if not left.off:
        return friction
    terms = [term for term in found.fit.terms if term.joint == i]
    speed = np.abs(found.data.velocity[found.data.way[:, i] != 0.0, i])
    ways = (TermKind.FORWARDS, TermKind.BACKWARDS)
    changes = {}
    for name, kinds in (('coulomb', ways), ('forwards', ways[:1]), ('backwards', ways[1:]),
                        ('offset', ways), ('viscous', (TermKind.VISCOUS,)), ('stribeck', ())):
        number: Estimate = getattr(friction, name)
        least = left.off / max(float(np.std(speed)), 1e-9) if name == 'viscous' else left.off
        places = [terms.index(Term(kind, i)) for kind in kinds if Term(kind, i) in terms]
        shift = sum(float(np.abs(x.shift[places]).max(initial=0.0)) for x in left.effects)
        changes[name] = number if number.value is None else dataclasses.replace(
            number, half=number.half + _SURE * shift + least)
    return dataclasses.replace(friction, **changes)

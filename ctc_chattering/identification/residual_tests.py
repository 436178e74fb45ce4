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

"""Columns that effects would have which the regression lacks: on what a torque then depends."""

from __future__ import annotations

from collections.abc import Iterator
import dataclasses
from typing import NamedTuple

from ctc_chattering.identification.findings import Estimate, Finding, Kind
from ctc_chattering.identification.friction import JointFriction
from ctc_chattering.identification.least_squares import (
    correlation_length,
    Data,
    Fit,
    scaled,
    Term,
    TermKind,
    without,
)
from ctc_chattering.identification.windows import BUILD_UP
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.special import chdtri  # type: ignore[import-untyped]


class Guess(NamedTuple):
    """
    Columns that a physical effect would have.

    Attributes
    ----------
    against : str
        What the torque then depends on.
    points_to : str
        The effect.
    cure : str
        What to record or to give.
    columns : ndarray, shape (K, p)
        In the windows in which the joint slides.

    """

    against: str
    points_to: str
    cure: str
    columns: Array


def causes(data: Data, i: int) -> Iterator[Guess]:
    """Yield what the torque of joint i may depend on besides the model."""
    used = data.way[:, i] != 0.0
    way, t, q = data.way[used, i], data.t[used], data.position[used, i]
    speed, base = np.abs(data.velocity[used, i]), data.base[used, i]
    turn = np.column_stack((np.sin(q), np.cos(q), np.sin(2.0 * q), np.cos(2.0 * q), q, q * q))
    yield Guess('position', 'a weight, spring, cable or cogging that the model lacks',
                'correct the model', turn)
    yield Guess('position and direction', 'friction that depends on the position',
                'record the positions that you will use', turn * way[:, None])
    yield Guess('speed', 'a law of friction that is not Coulomb, viscous and Stribeck',
                'record the speeds that you will use', way[:, None] * np.maximum(
                    speed[:, None] - np.quantile(speed, (0.1, 0.25, 0.5, 0.75)), 0.0))
    yield Guess('acceleration', 'an inertia of rotor or link that the model lacks, or a lag of '
                'the drive', 'correct the inertia in the model',
                np.column_stack((data.acceleration[used, i], base - data.gravity[used, i])))
    yield Guess('the way since a reversal', 'backlash, an elastic joint, or friction that builds '
                f'up over a way (looked for up to {BUILD_UP[-1]:g} rad)',
                'reduce the backlash, or measure behind the elasticity', data.build_up[used, i])
    late = (t - t.min()) / max(float(np.ptp(t)), 1e-9)
    thirds = np.eye(3)[np.minimum((3.0 * late).astype(int), 2)]
    yield Guess('time', 'friction that drifts, with temperature say',
                'warm the robot up, and record a shorter run',
                np.column_stack((thirds, thirds * way[:, None])))
    load = way * np.abs(base)
    yield Guess('the load', 'friction that depends on the load',
                'record the load that you will have',
                np.column_stack((load, load * speed, np.sign(base))))
    others = [k for k in range(data.way.shape[1]) if k != i]
    if others:
        torque = (data.base + data.residual)[used][:, others]
        yield Guess('the torques of other joints', 'coupled joints, or sensors of torque that '
                    'mix axes', 'check --joints and the calibration of the torques',
                    np.column_stack((torque, data.acceleration[used][:, others])))


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

    """

    cause: Guess
    size: float
    shift: Array

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

    @property
    def off(self) -> float:
        """Return by how much friction may be off without its shifts [N·m]."""
        return _PEAK * float(np.sqrt(sum(x.size ** 2 for x in self.effects) + self.rest ** 2))


def effect(cause: Guess, friction: Array, others: Array, residual: Array) -> Effect | None:
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

    """
    basis = np.linalg.qr(scaled(np.column_stack((friction, others)))[0])[0]
    columns = scaled(cause.columns)[0]
    u, s, v = np.linalg.svd(columns - basis @ (basis.T @ columns), full_matrices=False)
    kept = s > _ALIKE
    u, s, v = u[:, kept], s[kept], v[kept]
    found = u.T @ residual
    rest = residual - basis @ (basis.T @ residual) - u @ found
    degrees = max(len(residual) - len(s) - basis.shape[1], 1)
    noise = float(rest.dot(rest)) / degrees * correlation_length(rest)
    power = float(found.dot(found))
    if power <= noise * float(chdtri(max(len(s), 1), _CHANCE)):
        return None
    shift = np.linalg.lstsq(friction, -columns @ (v.T @ (found / s)), rcond=1e-9)[0]
    return Effect(cause, float(np.sqrt(power / len(residual))), shift)


def unexplained(data: Data, fit: Fit, i: int) -> Unexplained | None:
    """Return what a fit leaves of the torque of joint i; None if it hardly slides."""
    used = data.way[:, i] != 0.0
    mine = [k for k, term in enumerate(fit.terms) if term.joint == i]
    if used.sum() < _FEWEST or not mine:
        return None
    friction, rest = fit.columns(i)[used][:, mine], fit.residual[used, i]
    level = float(np.sqrt(np.square(friction @ fit.value[mine]).mean()))
    effects: list[Effect] = []
    others, options = np.zeros((len(rest), 0)), list(causes(data, i))
    while len(effects) < _MOST:
        shown = [effect(cause, friction, others, rest) for cause in options]
        best = max((x for x in shown if x is not None), key=lambda x: x.size, default=None)
        if best is None:
            break
        effects.append(best)
        options = [x for x in options if x is not best.cause]
        others = np.column_stack((others, best.cause.columns))
        rest = without(np.column_stack((friction, others)), rest, 1e-6)
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
    if (count * np.square(covariance / power)).sum() <= chdtri(len(_APART), _CHANCE):
        return 0.0
    return float(np.sqrt(np.abs(covariance).mean()))


def findings(i: int, left: Unexplained) -> Iterator[Finding]:
    """Yield what a joint depends on that the model lacks."""
    for x in left.effects:
        off = x.off(left)
        if off > Kind.FRICTION_OFF.care:
            yield Finding(Kind.FRICTION_OFF, i, f'{left.part(x.size):.1%} of the friction, '
                          f'{x.size:.2g} N*m RMS, depends on {x.cause.against}: '
                          f'{x.cause.points_to}; friction may be off by {off:.0%}',
                          x.cause.cure, off)
    off = left.part(_PEAK * left.rest)
    if off > Kind.FRICTION_OFF.care:
        yield Finding(Kind.FRICTION_OFF, i, f'{left.part(left.rest):.1%} of the friction, '
                      f'{left.rest:.2g} N*m RMS, is not explained and correlates in time; '
                      f'friction may be off by {off:.0%}',
                      'record another motion, and compare the numbers', off)


def wider(data: Data, fit: Fit, i: int, friction: JointFriction, left: Unexplained
          ) -> JointFriction:
    """Return the friction of joint i with intervals that contain what is unexplained."""
    terms = [term for term in fit.terms if term.joint == i]
    speed = np.abs(data.velocity[data.way[:, i] != 0.0, i])
    ways = (TermKind.FORWARDS, TermKind.BACKWARDS)
    changes = {}
    for name, kinds in (('coulomb', ways), ('forwards', ways[:1]), ('backwards', ways[1:]),
                        ('offset', ways), ('viscous', (TermKind.VISCOUS,)), ('stribeck', ())):
        number: Estimate = getattr(friction, name)
        least = left.off / max(float(np.std(speed)), 1e-9) if name == 'viscous' else left.off
        mine = [terms.index(Term(kind, i)) for kind in kinds if Term(kind, i) in terms]
        shift = sum(float(np.abs(x.shift[mine]).max(initial=0.0)) for x in left.effects)
        changes[name] = number if number.value is None else dataclasses.replace(
            number, half=number.half + _SURE * shift + least)
    return dataclasses.replace(friction, **changes)

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

"""The perturbation P of a run, which the chattering term must hold, and its prediction."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import dataclasses

from ctc_chattering.identification.regression.finding import Finding, Severity
from ctc_chattering.identification.regression.identify import Identification
from ctc_chattering.identification.regression.least_squares import (
    Data,
    Fit,
    stribeck_velocity,
    TermKind,
)
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import numpy.typing as npt

Flags = npt.NDArray[np.bool_]
#: Part of the friction that an unexplained torque may have on a run not used for the fit.
_GOOD = 0.05
#: Kinds of friction; all other terms are errors of the model. Slopes are 0 in a fit.
_FRICTION = (TermKind.FORWARDS, TermKind.BACKWARDS, TermKind.VISCOUS, TermKind.STRIBECK,
             TermKind.STRIBECK_SLOPE, TermKind.LOAD, TermKind.LAG_SLOPE)
#: An outlier is this many times beyond the bound of what is unexplained, and this part of P.
_FAR, _SEEN = 3.0, 0.1
#: What a joint at rest may have beyond the friction of sliding: in bounds of what is unexplained,
#: and as a part of the friction.
_TAILS, _BREAK_AWAY = 3.0, 0.1
#: Windows beside an outlier that share samples with it.
_BESIDE = 4
#: Fewest windows of which a tail is told.
_ENOUGH = 100
#: Deviations of noise in short windows, and over which part of |P| these are looked at.
_NOISE, _BEYOND = 4.0, 1.2


@dataclasses.dataclass(frozen=True)
class MeasuredPerturbation:
    """
    P over the windows of a run; J windows, n joints.

    Attributes
    ----------
    t : ndarray, shape (J,)
        Centres of the windows [s].
    measured, predicted : ndarray, shape (J, n)
        Torque less the model's, and friction plus errors of the model as identified, nan where a
        joint does not slide [N·m].
    envelope : ndarray, shape (J, n)
        Largest |P| that what was identified allows at the state of a window, at a stop or
        a break-away as well [N·m].
    trusted : ndarray of bool, shape (J,)
        Windows that are no outliers of any joint, nor beside one.
    tail, error : ndarray, shape (n,)
        Bound of what is not predicted in trusted windows, and largest error of the model there
        [N·m].
    impact : ndarray, shape (n,)
        By what |P| in short windows exceeds that in the windows above [N·m].

    """

    t: Array
    measured: Array
    predicted: Array
    envelope: Array
    trusted: Flags
    tail: Array
    error: Array
    impact: Array

    @property
    def rest(self) -> Array:
        """Return what is not predicted of P, shape (J, n) [N·m]; NaN where nothing is."""
        rest: Array = self.measured - self.predicted
        return rest

    @property
    def peak(self) -> Array:
        """
        Largest |P| of each joint, shape (n,) [N·m].

        That of the envelope with what is not predicted, and what was measured where the joint
        does not slide, before it breaks away; with impacts.
        """
        return self.smooth_peak + self.impact

    @property
    def smooth_peak(self) -> Array:
        """Return the same without impacts, shape (n,) [N·m]."""
        slides = np.isfinite(self.predicted) & self.trusted[:, None]
        known = np.where(slides, self.envelope, 0.0).max(axis=0, initial=0.0) + self.tail
        held = [tail_bound(np.abs(x[self.trusted & ~mine]))
                for x, mine in zip(self.measured.T, slides.T)]
        found: Array = np.maximum(known, held)
        return found

    def outliers(self) -> Iterator[Finding]:
        """Yield for each joint which windows were left out of the peak."""
        rest = np.abs(self.rest)
        far = np.where(np.isfinite(rest), rest, 0.0) > _FAR * self.tail
        far &= ~self.trusted[:, None]
        for i in range(self.measured.shape[1]):
            size = np.where(far[:, i], rest[:, i], 0.0)
            if size.any():
                k = int(np.argmax(size))
                yield Finding(
                    Severity.CARE, i, f'{int(far[:, i].sum())} windows of 0.1 s have a torque '
                    f'that nothing explains, up to {size[k]:.3g} N*m at {self.t[k]:.2f} s: a '
                    'contact, or wrong stamps; they are not in the largest |P|',
                    'look at the recording there')

    def break_away(self, joints: Sequence[str]) -> Iterator[Finding]:
        """Yield the joints with more friction at rest, or breaking away, than sliding shows."""
        held = self.trusted[:, None] & ~np.isfinite(self.predicted)
        more = np.abs(self.measured) - self.envelope
        for i, name in enumerate(joints):
            beyond = tail_bound(np.maximum(more[held[:, i], i], 0.0))
            level = float(np.median(self.envelope[:, i]))
            if beyond > max(_TAILS * self.tail[i], _BREAK_AWAY * level):
                yield Finding(
                    Severity.CARE, i, f'at rest or breaking away |P| is up to {beyond:.3g} N*m '
                    f'more than {name} shows while it slides: Stribeck friction below the '
                    'velocities shown, or a joint that is held by something else',
                    'record slower reversals, as those of `ctc excite`')

    def misfit(self) -> tuple[Array, Array]:
        """Return the RMS of P and of what is not predicted of it, each of shape (n,) [N·m]."""
        known = np.isfinite(self.predicted)
        count = np.maximum(known.sum(axis=0), 1)
        rest = np.where(known, self.rest, 0.0)
        whole = np.where(known, self.measured, 0.0)
        return (np.sqrt(np.square(whole).sum(axis=0) / count),
                np.sqrt(np.square(rest).sum(axis=0) / count))

    def good(self) -> Flags:
        """Return for which joints what was identified predicts P, shape (n,)."""
        whole, rest = self.misfit()
        found: Flags = rest <= _GOOD * whole
        return found


def perturbation(found: Identification, data: Data | None = None) -> MeasuredPerturbation:
    """
    Return P of the identified run, or of another one.

    Parameters
    ----------
    found : Identification
        What was identified.
    data : Data, optional
        Windows of the other run, with the same joints and errors of the model.

    """
    fit, data = found.selected.fit, data or found.data
    columns, used = data.columns(fit.terms), data.used()
    error = _error(fit, data, columns)
    # The slopes of Stribeck columns are 0, and in the fit for the sake of intervals.
    rest = np.where(used, np.abs(data.residual - columns @ fit.value), np.nan)
    bound = np.array([tail_bound(x[np.isfinite(x)]) for x in rest.T])
    size = np.array([np.median(np.abs(x[mine])) if mine.any() else 0.0
                     for x, mine in zip(data.residual.T, used.T)])
    far: Flags = np.any(rest > np.maximum(_FAR * bound, bound + _SEEN * size), axis=1)
    trusted = ~_widened(far)
    tail = np.array([tail_bound(x[np.isfinite(x) & trusted]) for x in rest.T])
    run = MeasuredPerturbation(
        data.t, data.residual, np.where(used, columns @ fit.value, np.nan),
        np.abs(error) + _friction(fit, data), trusted, tail,
        np.abs(error[trusted]).max(axis=0, initial=0.0), np.zeros(len(tail)))
    return dataclasses.replace(run, impact=_impact(found, run)) if data is found.data else run


def _impact(found: Identification, run: MeasuredPerturbation) -> Array:
    """Return by what |P| in short windows exceeds the peak of a run, shape (n,) [N·m]."""
    if found.short is None:
        return np.zeros(len(found.joints))
    sizes = np.abs(found.short.perturbation[run.trusted[found.short.nearest]])
    largest = sizes.max(axis=0, initial=0.0) - _NOISE * found.short.noise
    peak = run.smooth_peak
    excess: Array = np.where(largest > _BEYOND * peak, largest - peak, 0.0)
    return excess


def tail_bound(sizes: Array) -> float:
    """
    Return what about the largest of these magnitudes is, shape (N,), without single outliers.

    From the quantiles of 90 and 99 % on, the logarithm of the part beyond is taken as straight,
    which is right for exponential tails and too much for lighter ones.
    """
    largest = float(sizes.max(initial=0.0))
    if len(sizes) < _ENOUGH:
        return largest
    most, high = np.percentile(sizes, (90.0, 99.0)).tolist()
    return min(largest, float(high + (high - most) * np.log10(len(sizes) / 100.0)))


def _widened(far: Flags) -> Flags:
    """Return the windows that are far, or beside one that is."""
    found: Flags = np.convolve(far, np.ones(2 * _BESIDE + 1), 'same') > 0.5
    return found


def _error(fit: Fit, data: Data, columns: Array) -> Array:
    """Return the torque of errors of the model in each window, shape (J, n) [N·m]."""
    errors = [k for k, term in enumerate(fit.terms) if term.kind not in _FRICTION]
    error: Array = columns[:, :, errors] @ fit.value[errors]
    for i, used in enumerate(data.used().T):
        if errors and used.any():
            # Of a window in which the joint does not slide: between those in which it does.
            error[:, i] = np.interp(np.arange(len(used)), np.flatnonzero(used), error[used, i])
    return error


def _friction(fit: Fit, data: Data) -> Array:
    """Return the largest friction that the fit allows in each window, shape (J, n) [N·m]."""
    n = data.way.shape[1]
    friction = np.zeros_like(data.way)
    level = np.zeros(n)
    for term, value in zip(fit.terms, fit.value):
        i = term.joint
        if term.kind in (TermKind.FORWARDS, TermKind.BACKWARDS):
            level[i] = max(level[i], abs(value))
        elif term.kind == TermKind.VISCOUS:
            friction[:, i] += value * np.abs(data.velocity[:, i])
        elif term.kind == TermKind.LOAD:
            friction[:, i] += value * data.load[:, i]
        elif term.kind == TermKind.STRIBECK:
            speed = np.abs(data.velocity[:, i]) / stribeck_velocity(term.which)
            friction[:, i] += value * np.exp(-np.square(speed))
    return friction + level

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
Equations of motion under an integral, so that no velocity is differentiated.

With a test function φ that is 0, with its first three derivatives, outside a window of time, the
equation of motion `d(M dq)/dt - Cᵀ dq + G + F = tau` becomes, after integration by parts,

    ∫ φ tau dt = -∫ φ' M dq dt + ∫ φ (G - Cᵀ dq) dt + ∫ φ F dt.                           (WF1)

`dM/dt = C + Cᵀ` was used. The momentum M dq takes the place of accelerations (modulating
functions: Shinbrot 1957, Preisig and Rippin 1993; filtered regressors of the momentum: Hsu,
Bodson, Sastry and Paden 1987). φ = 315/256 (1 - s²)⁴, s from -1 to 1, is a low-pass filter without
delay.
"""

from __future__ import annotations

import dataclasses

from ctc_chattering.dynamics.model import Model
from ctc_chattering.numerics.linear_algebra import Array, Indices
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.interpolate import CubicSpline  # type: ignore[import-untyped]
from scipy.ndimage import correlate1d  # type: ignore[import-untyped]
from scipy.special import perm  # type: ignore[import-untyped]

#: Half the length of φ [s], and the fewest samples in it.
HALF, FEWEST = 0.05, 12
#: Distance of two windows, as a part of half their length.
_STEP = 0.5
#: Most windows, roughly, and those that are evaluated at once where they lie as near as usual.
_MOST_WINDOWS, _BLOCK = 3000, 200
#: Half the length of the polynomials that velocities come from [s], and the fewest samples.
_SMOOTH, _FEWEST_SMOOTH = 0.012, 3
#: Their order.
_ORDER = 3
#: Median magnitude of a normal variable with the deviation 1.
_MEDIAN = 0.6744897501960817
#: Longest step of the grid on which M, C and G are evaluated [s].
_GRID = 0.004


class TestFunction:
    """
    φ on a grid of samples.

    Parameters
    ----------
    period : float
        h [s].
    duration : float
        Of all that is evaluated [s]: beyond some minutes windows lie farther apart.

    Attributes
    ----------
    period : float
        h [s].
    half : int
        Samples on each side of the centre.
    step : int
        Samples from one window to the next.
    at, slope : ndarray, shape (2 half + 1,)
        h φ and h φ' at the samples [1, 1/s].
    over : ndarray, shape (2 half + 1,)
        ∫ φ dt from each sample to the next one; 0 for the last.

    """

    __test__ = False  # No test of pytest.

    def __init__(self, period: float, duration: float = 0.0) -> None:
        self.period = period
        self.half = max(FEWEST, round(HALF / period))
        usual = max(1, round(_STEP * self.half))
        self.step = max(usual, round(duration / period / _MOST_WINDOWS))
        self._block = max(1, _BLOCK * usual // self.step)
        samples = np.arange(-self.half, self.half + 1)
        self.at, self.slope = self.weights(samples, 1)
        s = samples / self.half
        primitive = 315.0 / 256.0 * (
            s - 4.0 * s ** 3 / 3.0 + 6.0 * s ** 5 / 5.0 - 4.0 * s ** 7 / 7.0 + s ** 9 / 9.0)
        self.over = np.append(np.diff(primitive), 0.0)

    def centres(self, count: int, margin: int) -> Indices:
        """Return the centres of windows over `count` samples, without `margin` at both ends."""
        return np.arange(self.half + margin, count - self.half - margin, self.step)

    def weights(self, offset: Indices, step: int) -> tuple[Array, Array]:
        """Return φ and φ' times a step of so many samples, at samples off the centre."""
        s = np.clip(offset / self.half, -1.0, 1.0)
        scale = step * 315.0 / 256.0 / self.half
        return (scale * (1.0 - s * s) ** 4,
                scale * -8.0 * s * (1.0 - s * s) ** 3 / (self.half * self.period))

    def sums(self, x: Array, weights: Array, centres: Indices) -> Array:
        """Return Σ weights x around each centre, shape (J, ...), of x, shape (N, ...)."""
        windows = sliding_window_view(x, 2 * self.half + 1, axis=0)
        return np.concatenate([
            windows[some - self.half] @ weights for some in self.blocks(centres)])

    def blocks(self, centres: Indices) -> list[Indices]:
        """Return the centres in blocks whose samples fit into memory."""
        return np.array_split(centres, -(-max(len(centres), 1) // self._block))


def smoothing_half(period: float) -> int:
    """Return how many samples on each side a velocity comes from."""
    return max(_FEWEST_SMOOTH, round(_SMOOTH / period))


def smooth(q: Array, period: float, order: int = 0) -> Array:
    """
    Return a derivative of some order of positions by local cubics, shape (N, ...).

    That is the filter of Savitzky and Golay, without delay (not SciPy's, which imports 25 MB).
    """
    m = smoothing_half(period)
    found: Array = correlate1d(q, _local(period, order), axis=0)
    for part, ends, at in ((found[:m], q[:2 * m + 1], range(-m, 0)),
                           (found[-m:], q[-2 * m - 1:], range(1, m + 1))):
        part[:] = [np.tensordot(_local(period, order, k), ends, 1) for k in at]
    return found


def _local(period: float, order: int, at: int = 0) -> Array:
    """Return the weights of a derivative `at` samples off the middle, shape (2 m + 1,)."""
    m, powers = smoothing_half(period), np.arange(_ORDER + 1)
    cubic = np.linalg.pinv(np.vander(np.arange(-m, m + 1.0), _ORDER + 1, increasing=True))
    value = perm(powers, order) * float(at) ** np.maximum(powers - order, 0)
    return np.asarray(value @ cubic / period ** order)


def position_noise(q: Array, period: float) -> Array:
    """Return the deviation of the positions from local cubics, shape (n,) [rad]."""
    m = smoothing_half(period)
    hat = _local(period, 0)
    # Joint by joint, for long series. Robust: where a joint stops, no cubic fits.
    spread = np.array([deviation((x - smooth(x, period))[m:-m]) for x in q.T])
    return np.asarray(spread / np.sqrt(1.0 - 2.0 * hat[m] + hat.dot(hat)))


def velocity_deviation(period: float) -> float:
    """Return the deviation of a smoothed velocity per deviation of white position noise [1/s]."""
    return float(np.linalg.norm(_local(period, 1)))


def deviation(x: Array) -> float:
    """Return the deviation of a series, shape (N,), by its median: robust."""
    return float(np.median(np.abs(x - np.median(x)))) / _MEDIAN


@dataclasses.dataclass(frozen=True)
class Dynamics:
    """
    Terms of a model along a stretch, on a coarse grid; K of its samples.

    Attributes
    ----------
    index : ndarray, shape (K,)
        Samples at which they were evaluated.
    mass : ndarray, shape (K, n, n)
        M [kg·m²].
    rest, gravity, bias : ndarray, shape (K, n)
        G - Cᵀ dq, G, and G + C dq [N·m].
    count : int
        Number of samples.

    """

    index: Indices
    mass: Array
    rest: Array
    gravity: Array
    bias: Array
    count: int

    @classmethod
    def along(cls, q: Array, dq: Array, period: float, model: Model) -> Dynamics:
        """Evaluate a model along a motion, each of q and dq of shape (N, n)."""
        step = max(1, int(_GRID / period))
        index = np.append(np.arange(0, len(q) - 1, step), len(q) - 1)
        n = q.shape[1]
        mass, (rest, weight, bias) = np.empty((len(index), n, n)), np.empty((3, len(index), n))
        for b, k in enumerate(index):
            mass[b], C, weight[b] = model.evaluate(q[k], dq[k])
            rest[b], bias[b] = weight[b] - C.T.dot(dq[k]), weight[b] + C.dot(dq[k])
        return cls(index, mass, rest, weight, bias, len(q))

    def weight(self) -> Array:
        """Return G at all samples, shape (N, n) [N·m]."""
        return self._full(self.gravity)

    def torque(self, ddq: Array) -> Array:
        """Return the inverse dynamics at all samples, shape (N, n) [N·m]."""
        coarse = np.einsum('tij,tj->ti', self.mass, ddq[self.index]) + self.bias
        return self._full(coarse)

    def weak(self, moved: Array, phi: TestFunction, centres: Indices) -> Array:
        """
        Return the left side of the equation, without friction, shape (J, n) [N·m].

        Parameters
        ----------
        moved : ndarray, shape (N, n)
            Velocity at the samples [rad/s]; it may be noisy.
        phi : TestFunction
            φ.
        centres : ndarray, shape (J,)
            Of the windows.

        """
        momentum = np.einsum('tij,tj->ti', self._full(self.mass), moved)
        return (phi.sums(self._full(self.rest), phi.at, centres)
                - phi.sums(momentum, phi.slope, centres))

    def _full(self, values: Array) -> Array:
        """Return values of the coarse grid at all samples."""
        return np.asarray(CubicSpline(self.index, values)(np.arange(self.count)))

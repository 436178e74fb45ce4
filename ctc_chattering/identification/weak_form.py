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
Equations of motion under an integral, without derivatives of velocities.

With a test function φ that is 0, with its first three derivatives, outside a window of time, the
equation of motion `d(M dq)/dt - Cᵀ dq + G + F = tau` becomes, after integration by parts,

    ∫ φ tau dt = -∫ φ' M dq dt + ∫ φ (G - Cᵀ dq) dt + ∫ φ F dt.                           (WF1)

`dM/dt = C + Cᵀ` was used. The momentum M dq takes the place of accelerations (modulating
functions: Shinbrot 1957, Preisig and Rippin 1993, and filtered regressors of the momentum: Hsu,
Bodson, Sastry and Paden 1987). φ = 315/256 (1 - s²)⁴, s from -1 to 1, is a low-pass filter without
delay. `windows.py` and `regressor.py` compute the terms of (WF1) with it.
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

#: Highest power of the local polynomials that velocities come from.
_LOCAL_ORDER = 3


class TestFunction:
    """
    φ on a grid of samples.

    Parameters
    ----------
    period : float
        h [s].
    duration : float
        Duration of all that is evaluated [s]. Beyond some minutes windows lie farther apart.

    Attributes
    ----------
    period : float
        h [s].
    half : int
        Samples on each side of the centre.
    step : int
        Samples from one window to the next.
    values, slope : ndarray, shape (2 half + 1,)
        h φ and h φ' at the samples [1, 1/s].
    over : ndarray, shape (2 half + 1,)
        ∫ φ dt from each sample to the next one, 0 for the last.

    """

    __test__ = False  # No test of pytest.

    def __init__(self, period: float, duration: float = 0.0) -> None:
        self.period = period
        # Half a window is 50 ms long, with 12 samples or more. Windows overlap by three quarters.
        self.half = max(12, round(0.05 / period))
        usual_step = max(1, round(0.5 * self.half))
        # About 3000 windows at most. 200 of the usual ones are evaluated at once.
        self.step = max(usual_step, round(duration / period / 3000))
        self._block = max(1, 200 * usual_step // self.step)
        samples = np.arange(-self.half, self.half + 1)
        self.values, self.slope = self.weights(samples, 1)
        s = samples / self.half
        primitive = 315.0 / 256.0 * (
            s - 4.0 * s ** 3 / 3.0 + 6.0 * s ** 5 / 5.0 - 4.0 * s ** 7 / 7.0 + s ** 9 / 9.0)
        self.over = np.append(np.diff(primitive), 0.0)

    def centres(self, count: int, margin: int) -> Indices:
        """Return the centres of windows, without a margin at both ends."""
        return np.arange(self.half + margin, count - self.half - margin, self.step)

    def weights(self, offset: Indices, step: int) -> tuple[Array, Array]:
        """Return φ and φ' off the centre, times a step [samples]."""
        s = np.clip(offset / self.half, -1.0, 1.0)
        scale = step * 315.0 / 256.0 / self.half
        values = scale * (1.0 - s * s) ** 4
        slope = scale * -8.0 * s * (1.0 - s * s) ** 3 / (self.half * self.period)
        return values, slope

    def sums(self, x: Array, weights: Array, centres: Indices) -> Array:
        """Return Σ weights x around centres, shape (J, ...)."""
        windows = sliding_window_view(x, 2 * self.half + 1, axis=0)
        return np.concatenate([
            windows[block - self.half] @ weights for block in self.blocks(centres)])

    def blocks(self, centres: Indices) -> list[Indices]:
        """Return the centres in blocks whose samples fit into memory."""
        return np.array_split(centres, -(-max(len(centres), 1) // self._block))


# Smooth positions and velocities, with their noise.

def smoothing_half(period: float) -> int:
    """Return half the samples of smoothing: 12 ms, or three."""
    return max(3, round(0.012 / period))


def smooth(q: Array, period: float, order: int = 0) -> Array:
    """
    Return a derivative of positions by local cubics, shape (N, ...).

    This is the filter of Savitzky and Golay, without delay. SciPy's needs 25 MB more memory.
    """
    m = smoothing_half(period)
    derivative: Array = correlate1d(q, _local_weights(period, order), axis=0)
    for k in range(m):
        derivative[k] = np.tensordot(
            _local_weights(period, order, k - m),
            q[:2 * m + 1],
            1)
        derivative[k - m] = np.tensordot(
            _local_weights(period, order, k + 1),
            q[-2 * m - 1:],
            1)
    return derivative


def _local_weights(period: float, order: int, offset: int = 0) -> Array:
    """Return the weights of a derivative off the middle."""
    m = smoothing_half(period)
    powers = np.arange(_LOCAL_ORDER + 1)
    samples = np.arange(-m, m + 1.0)
    cubic = np.linalg.pinv(np.vander(samples, _LOCAL_ORDER + 1, increasing=True))
    value = perm(powers, order) * float(offset) ** np.maximum(powers - order, 0)
    return np.asarray(value @ cubic / period ** order)


def position_noise(q: Array, period: float) -> Array:
    """Return the deviation from local cubics, shape (n,) [rad]."""
    m = smoothing_half(period)
    hat = _local_weights(period, 0)
    # Joint by joint, for long series. Robust: where a joint stops, no cubic fits.
    spread = np.array([deviation((x - smooth(x, period))[m:-m]) for x in q.T])
    return np.asarray(spread / np.sqrt(1.0 - 2.0 * hat[m] + hat.dot(hat)))


def velocity_deviation(period: float) -> float:
    """Return the velocity's noise per noise of positions [1/s]."""
    return float(np.linalg.norm(_local_weights(period, 1)))


def deviation(x: Array) -> float:
    """Return the deviation of a series, shape (N,), robust to outliers."""
    # A normal variable of deviation 1 has this median magnitude.
    return float(np.median(np.abs(x - np.median(x)))) / 0.6744897501960817


@dataclasses.dataclass(frozen=True)
class Dynamics:
    """
    Terms of a model at K samples of a stretch.

    Attributes
    ----------
    index : ndarray, shape (K,)
        Samples at which they were evaluated.
    mass : ndarray, shape (K, n, n)
        M [kg·m²].
    remainder, gravity, bias : ndarray, shape (K, n)
        G - Cᵀ dq, G, and G + C dq [N·m].
    count : int
        Number of samples.

    """

    index: Indices
    mass: Array
    remainder: Array
    gravity: Array
    bias: Array
    count: int

    @classmethod
    def along(cls, q: Array, dq: Array, period: float, model: Model) -> Dynamics:
        """Evaluate a model along a motion q, dq, each (N, n)."""
        last = len(q) - 1
        step = max(1, int(0.004 / period))  # 4 ms at most.
        index = np.append(np.arange(0, last, step), last)
        count, n = len(index), q.shape[1]
        mass = np.empty((count, n, n))
        remainder, gravity, bias = np.empty((3, count, n))
        for row, k in enumerate(index):
            M, C, G = model.evaluate(q[k], dq[k])
            mass[row] = M
            gravity[row] = G
            remainder[row] = G - C.T.dot(dq[k])
            bias[row] = G + C.dot(dq[k])
        return cls(index, mass, remainder, gravity, bias, len(q))

    def weight(self) -> Array:
        """Return G at all samples, shape (N, n) [N·m]."""
        return self._interpolate(self.gravity)

    def torque(self, ddq: Array) -> Array:
        """Return the inverse dynamics at all samples, shape (N, n) [N·m]."""
        inertial = np.einsum('tij,tj->ti', self.mass, ddq[self.index])
        return self._interpolate(inertial + self.bias)

    def weak(self, velocity: Array, phi: TestFunction, centres: Indices) -> Array:
        """
        Return the model's torque in (WF1), shape (J, n) [N·m].

        Parameters
        ----------
        velocity : ndarray, shape (N, n)
            Velocity at the samples [rad/s], which may be noisy.
        phi : TestFunction
            φ.
        centres : ndarray, shape (J,)
            Samples at the centres of the windows.

        """
        mass = self._interpolate(self.mass)
        momentum = np.einsum('tij,tj->ti', mass, velocity)
        remainder = self._interpolate(self.remainder)
        return (phi.sums(remainder, phi.values, centres)
                - phi.sums(momentum, phi.slope, centres))

    def _interpolate(self, values: Array) -> Array:
        """Return values of the coarse grid at all samples."""
        return np.asarray(CubicSpline(self.index, values)(np.arange(self.count)))

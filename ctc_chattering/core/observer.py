"""
An estimate of the matched perturbation P = F(dq) - d(t), model error included.

Over one period with the torque τ held, the filter (3) gives, exactly for its pole::

    v[k+1] = y[k] - b h M⁻¹ (N[k] - τ[k] + P[k]),     y[k] = a v[k] + (b h - c) u[k]

with u = Kv de + Kp e, N = M (ddq_d + u) + C dq + G, a = exp(-λ h), c = b (1 - a) / λ. What the
last sample's v says of P is the residual of the closed loop (8), and the estimate follows it with
a bandwidth ω::

    r = M (y[k] - v[k+1]) / (b h) - (N[k] - τ[k]) - P̂ - ½ cut,    P̂ += (1 - exp(-ω h)) r

With ω → ∞ the last residual is believed at once. P̂ is bounded by Ka, in the metric of M⁻¹: where
one joint's estimate meets its bound, the others' make up for it as far as the acceleration is
concerned. `cut` is what the bound ±Ka has cut off the chattering term, where that was less than
Ka: noise around a perturbation close to Ka is cut on one side only, and the mean of what is lost
must be made good, or v rests beside 0. A deeper cut means that v is still far from 0, and is left
out.
"""

from __future__ import annotations

from math import exp

from ctc_chattering.core.model import Model, Vector
from ctc_chattering.core.switching import implicit_term


class PerturbationObserver:
    """
    Estimates the perturbation, sample by sample.

    Parameters
    ----------
    n : int
        Number of joints.

    Attributes
    ----------
    estimate : sequence of float, shape (n,)
        P̂ [N·m].
    gain : float
        Part of the residual that P̂ takes up per sample.

    """

    def __init__(self, n: int) -> None:
        self.estimate: Vector = (0.0,) * n
        self._last: tuple[Vector, Vector, Vector, Vector | None] | None = None

    def configure(self, bandwidth: float, period: float, b: float, bound: Vector) -> None:
        """
        Set what the estimate is made with; P̂ lives on, the last sample is forgotten.

        Parameters
        ----------
        bandwidth : float
            ω [rad/s].
        period : float
            h [s].
        b : float
            Gain of the filter (3).
        bound : sequence of float, shape (n,)
            Ka [N·m].

        """
        self.gain = 1.0 - exp(-bandwidth * period)
        self._scale = b * period
        self._bound = bound
        self._last = None

    def reset(self) -> None:
        """Set P̂ = 0."""
        self.estimate = (0.0,) * len(self.estimate)
        self._last = None

    def expect(self, q: Vector, free: Vector, lack: Vector, cut: Vector | None) -> None:
        """
        Note what the next sample's v would be without a perturbation.

        Parameters
        ----------
        q : sequence of float, shape (n,)
            Position [rad].
        free : sequence of float, shape (n,)
            y [rad/s].
        lack : sequence of float, shape (n,)
            N - τ, with the torque τ that is held from now on [N·m].
        cut : sequence of float, shape (n,), or None
            What the bound has cut off the chattering term [N·m]; None for nothing.

        """
        self._last = (q, free, lack, cut)

    def learn(self, model: Model, v: Vector) -> None:
        """Improve the estimate by what v, shape (n,) [rad/s], has become."""
        if self._last is None:
            return
        q, free, lack, cut = self._last
        scale = self._scale
        missed = model.inertia_times(q, [(y - x) / scale for y, x in zip(free, v)])
        self.estimate = implicit_term(
            model, q, self.followed(self.estimate, missed, lack, cut), self._bound)

    def followed(self, estimate: Vector, missed: Vector, lack: Vector, cut: Vector | None
                 ) -> list[float]:
        """
        Return the next estimate before it is bounded, shape (n,) [N·m].

        Parameters
        ----------
        estimate : sequence of float, shape (n,)
            The last one [N·m].
        missed : sequence of float, shape (n,)
            M (y - v) / (b h) [N·m].
        lack, cut : sequence of float, shape (n,)
            As `expect` has them.

        """
        if cut is not None:
            lack = [f + 0.5 * c if abs(c) < limit else f
                    for f, c, limit in zip(lack, cut, self._bound)]
        gain = self.gain
        return [p + gain * (m - f - p) for p, m, f in zip(estimate, missed, lack)]

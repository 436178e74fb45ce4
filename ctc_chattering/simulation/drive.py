"""
The drives between commanded and applied torque: a first-order lag whose rate is limited.

While the command c is held, the torque τ of a drive follows, with the lag T and the rate limit R::

    dτ/dt = (c - τ) / T, within ±R

It rises at the rate R until |c - τ| = R T, then exponentially; without a lag it rises to c. Both
parts have a closed form, so that no integrator is needed and T may be shorter than its step.
"""

from __future__ import annotations

from math import copysign, exp, inf

from ctc_chattering.numerics.linear_algebra import Vector


def response(gap: float, lag: float, rate: float, s: float) -> tuple[float, float]:
    """
    Return τ - c [N·m] at `s`, and its integral from 0 to `s` [N·m·s].

    Parameters
    ----------
    gap : float
        c - τ at 0 [N·m].
    lag, rate : float
        T [s], 0 for none; R [N·m/s], inf for none.
    s : float
        Time since the command came [s].

    """
    s = max(s, 0.0)  # Rounding apart, it is never less.
    ramp, slope = max(abs(gap) / rate - lag, 0.0), copysign(rate, gap)
    if s < ramp:
        return slope * s - gap, s * (0.5 * slope * s - gap)
    rest, area = -gap, 0.0
    if ramp:
        rest, area = slope * ramp - gap, ramp * (0.5 * slope * ramp - gap)
    now = rest * exp((ramp - s) / lag) if lag else 0.0
    return now, area + lag * (rest - now)


class Drives:
    """
    The drives of all joints.

    Parameters
    ----------
    lag, rate : sequence of float, shape (n,)
        T [s] and R [N·m/s].

    Attributes
    ----------
    ideal : bool
        Whether the torque is what was commanded, at once.
    torque : list of float, shape (n,)
        At the end of the period of the last command [N·m].
    mean : list of float, shape (n,)
        Over that period [N·m].

    """

    def __init__(self, lag: Vector, rate: Vector) -> None:
        self.ideal = not any(lag) and min(rate) == inf
        self._limits = list(zip(lag, rate))
        self._gaps = self.torque = self.mean = [0.0] * len(lag)

    def command(self, tau: Vector, period: float) -> None:
        """Take a command, shape (n,) [N·m], to be held for `period` [s]."""
        self._gaps = [c - x for c, x in zip(tau, self.torque)]
        ends = self._responses(period)
        self.torque = [c + x for c, (x, _) in zip(tau, ends)]
        self.mean = [c + area / period for c, (_, area) in zip(tau, ends)]

    def error(self, s: float) -> list[float]:
        """Return torque less command at `s` [s] after the command, shape (n,) [N·m]."""
        return [x for x, _ in self._responses(s)]

    def middle(self, s: float, half: float) -> list[float]:
        """
        Return the same for the middle of a step from `s` - `half` to `s` + `half` [s].

        With it, Simpson's rule has the exact integral over the step, whatever the lag.
        """
        return [0.75 * (b - a) / half - 0.25 * (x + y) for (x, a), (y, b) in zip(
            self._responses(s - half), self._responses(s + half))]

    def _responses(self, s: float) -> list[tuple[float, float]]:
        return [response(gap, lag, rate, s) for gap, (lag, rate) in zip(self._gaps, self._limits)]
